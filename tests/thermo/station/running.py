"""Running a test on devices in memory, as the launch does it on real ones."""

from drivers.clock import Clock
from drivers.opening import Station
from thermo.planning.sequence import Sequence
from thermo.station import procedure
from thermo.station.job import make_job, resumed_job_in
from thermo.station.outcome import TestOutcome
from thermo.store.store import Store


def run_test(
    sequence: Sequence | None,
    station: Station,
    store: Store,
    clock: Clock,
    *,
    resume: str | None = None,
    **more: object,
) -> TestOutcome:
    """Run a test in an open store, or claim one and go on with it."""
    url = store.url.render_as_string(hide_password=False)
    if resume is None:
        assert sequence is not None
        return procedure.run_test(
            make_job(sequence, url, station.config), station, store, clock, **more
        )
    job = resumed_job_in(store, resume, url, station.config, sequence=sequence)
    store.claim(resume)
    return procedure.run_test(job, station, store, clock, **more)
