"""What a test wrote to its chamber, and tests whose controller dies or whose chamber is changed."""

from drivers.station import StationConfig
from tests.thermo.station.running import run_test
from thermo.station.outcome import RunControl

WRITES = (
    "chamber.hold_temp_c",
    "chamber.ramp_to_c",
    "chamber.make_safe",
    "head.move_to_deg",
    "head.stop",
    "digitiser.configure",
)
PROFILE = ("profile 3 is running",)
ACCEPT = ('gap_rule = "resoak"', 'gap_rule = "accept"')


def writes(world, since=0):
    return [call for call in world.calls[since:] if call in WRITES]


def kinds(store, test_id):
    return [event.kind for event in store.events(test_id)]


def with_rule(station, rule):
    config = StationConfig.model_validate(station.config.model_dump() | {"on_foreign_change": rule})
    object.__setattr__(station, "config", config)


def abort_after(world, control, scans):
    def hook(name: str) -> None:
        if name == "digitiser.scan" and world.calls.count(name) == scans:
            control.abort("interrupted")

    world.hook = hook


def kill_after(store, station, world, sequence, scans, monkeypatch):
    """Begin a test and let its controller die without a word, as far as the store can tell."""
    control = RunControl()
    abort_after(world, control, scans)
    with monkeypatch.context() as dying:
        for name in ("finish_test", "finish_run"):
            dying.setattr(store, name, lambda *_: None)
        dying.setattr("thermo.station.journal.Journal.event", _only_before_the_end(world))
        outcome = run_test(sequence, station, store, world.clock, control=control)
    store.claim(outcome.test_id).release()
    world.hook = lambda _: None
    assert store.test(outcome.test_id).status == "running"
    assert not set(kinds(store, outcome.test_id)) & {"safe", "not safe"}
    return outcome.test_id


def _only_before_the_end(world):
    from thermo.station.journal import Journal

    real = Journal.event

    def event(self, kind, text):
        if "chamber.make_safe" not in world.calls:
            real(self, kind, text)

    return event
