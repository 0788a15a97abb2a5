"""The run-in rule on a running test: the decision to continue or to stop."""

from errormodel.errors import WorkbenchError
from thermo.planning.run_in_rule import RunInRule
from thermo.planning.sequence import Sequence
from thermo.recording.readings_check import flag_readings
from thermo.run_in.cycles import judge_runs
from thermo.run_in.verdict import RunInVerdict
from thermo.station.outcome import Decision
from thermo.store.files import recorded_runs
from thermo.store.store import Store


def judge_stored(
    store: Store, test_id: str, rule: RunInRule, cycles: int | None = None
) -> tuple[RunInVerdict, ...]:
    """Evaluate the run-in of a test from its store; this can be repeated at any time.

    Parameters
    ----------
    store : Store
    test_id : str
    rule : RunInRule
    cycles : int, optional
        Only this number of first runs; default: the finished runs.

    Raises
    ------
    InputError, StoreError
        If the readings do not determine K0 of every cycle.
    """
    finished = [r.number for r in store.test(test_id).runs if r.status == "finished"]
    used = [f"{test_id}-{n}" for n in finished if cycles is None or n <= cycles]
    return tuple(
        verdict
        for record in map(flag_readings, recorded_runs(store, test_id))
        for verdict in judge_runs(record.select(runs=used), rule)
    )


def decide_run_in(store: Store, test_id: str, sequence: Sequence, cycles: int) -> Decision:
    """Decide after a cycle whether to continue a run-in.

    It stops when every accelerometer has settled, or at the most cycles allowed. A cycle that
    cannot be evaluated does not contribute to the decision: the run-in goes on to the next.

    Parameters
    ----------
    store : Store
    test_id : str
    sequence : Sequence
        With its `run_in`.
    cycles : int
        Runs done.
    """
    rule = sequence.run_in
    if rule is None or (cycles < rule.min_cycles and cycles < rule.max_cycles):
        return Decision()
    try:
        verdicts = judge_stored(store, test_id, rule, cycles)
    except WorkbenchError as err:
        reason = f"{cycles} cycles done; not settled as far as the cycles show: {err}"
        return Decision(
            reason=reason, lines=(f"cycle {cycles} does not contribute to the decision: {err}",)
        )
    lines = tuple(v.sentence for v in verdicts)
    unsettled = [v.serial for v in verdicts if not v.settled]
    if not unsettled:
        reason = f"run-in: all accelerometers settled after {cycles} cycles"
        return Decision(stop=True, reason=reason, lines=lines)
    reason = f"{cycles} cycles done, not settled: {', '.join(unsettled)}"
    return Decision(reason=reason, lines=lines)
