"""Emulated chambers of every model on every wire, and controllers that others built."""

import itertools

import pytest

from drivers.chambers.open import open_chamber
from drivers.station import ChamberConfig
from tests.drivers.chambers.emulated_chamber import MODELS, TRANSPORTS, Bench
from tests.drivers.chambers.foreign_controllers import ForeignF4


@pytest.fixture(params=itertools.product(MODELS, TRANSPORTS), ids="-".join)
def bench(request):
    bench = Bench(*request.param)
    yield bench
    bench.close()


@pytest.fixture(params=MODELS)
def tcp_bench(request):
    bench = Bench(request.param, "tcp")
    yield bench
    bench.close()


@pytest.fixture(params=MODELS)
def lagging_bench(request):
    bench = Bench(request.param, "tcp", lag_s=120.0)
    yield bench
    bench.close()


@pytest.fixture
def serve():
    """Return a function that starts a foreign controller, and one that opens a driver on it."""
    started = []

    def make(kind, **settings):
        started.append(kind(**settings))
        return started[-1]

    def drive(bank, **more):
        model = "watlow_f4" if isinstance(bank, ForeignF4) else "watlow_f4t"
        keys = ("permit", "recognition")
        given = {k: more.pop(k) for k in keys if k in more}
        chamber = open_chamber(
            ChamberConfig(model=model, url=bank.url, timeout_s=5.0, **more), **given
        )
        started.append(chamber)
        return chamber

    make.drive = drive
    yield make
    for one in reversed(started):
        one.close()
