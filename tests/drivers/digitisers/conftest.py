"""What every digitiser's test runs under."""

import pytest

import drivers.digitisers.keysight_34970a


@pytest.fixture(autouse=True)
def no_relays(monkeypatch):
    """An emulated scan needs no settling, so that lost answers are given up sooner."""
    monkeypatch.setattr(drivers.digitisers.keysight_34970a, "SETTLE_S", 0.0)
