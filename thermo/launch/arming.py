"""Checks before a test is started: each passed or not, with the remedy.

Nothing is commanded: whatever a driver wanted to write to the chamber is refused.
"""

import os
import shutil
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from drivers.devices import Chamber, Device
from drivers.errors import FencedError, InstrumentError
from drivers.opening import Station, open_station
from drivers.station import StationConfig
from errormodel.errors import StoreError, WorkbenchError
from thermo.planning.sequence import Sequence
from thermo.safety.chamber_lock import ChamberHeldError
from thermo.safety.guarded_sitting import take_lock
from thermo.safety.guardian_process import prove_startable
from thermo.station.job import Job, make_job, make_resumed_job
from thermo.store.database import parse_store_url
from thermo.store.spool.log import default_folder, prove_spool_writable
from thermo.store.store import open_store

READING_BYTES = 400  # of one reading in table and index, as SQLite stores them, twice over
SPARE_BYTES = 200_000_000  # for events, the write-ahead log and the spool


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
        "limits", "store", "disk", "chamber free", "chamber", "digitiser", "head" or "guardian".
    passed : bool
    found : str
        What was found, a line.
    remedy : str
        What to do, a sentence; empty when it passed.
    """

    name: str
    passed: bool
    found: str
    remedy: str = ""


def check_arming(
    sequence: Sequence | None,
    station: StationConfig | None,
    store_url: str,
    *,
    resume: str | None = None,
    take_over: bool = False,
) -> tuple[Check, ...]:
    """Look at everything that a test needs.

    Parameters
    ----------
    sequence : Sequence or None
        None: that of the test to be resumed.
    station : StationConfig or None
        None: the emulated one that goes with the sequence, or that of the test to be resumed.
    store_url : str
    resume : str, optional
        The test to go on with.
    take_over : bool
        Whether a chamber in use is good enough.

    Returns
    -------
    tuple of Check
        In the order in which they are to be put right; with the limits wrong nothing else is
        looked at, and a chamber that somebody holds is asked nothing.
    """
    try:
        if resume is not None:
            job = make_resumed_job(resume, store_url, station, sequence=sequence)
        elif sequence is not None:
            job = make_job(sequence, store_url, station)
        else:
            raise StoreError("no sequence is given, and no test to go on with")
    except WorkbenchError as err:
        remedy = "Change the sequence or the station so that they agree."
        return (Check(name="limits", passed=False, found=str(err), remedy=remedy),)
    plan = job.plan
    low, high = plan.chamber_limits_c
    found = (
        f"chamber {low:g} to {high:g} °C, {plan.readings} readings in {plan.total_s / 3600:.3g} h"
    )
    checks = [Check(name="limits", passed=True, found=found), _store(job), _disk(job)]
    if job.emulated:
        found = "emulated in the test's own process"
        return (*checks, Check(name="instruments", passed=True, found=found))
    return (*checks, *_instruments(job, take_over=take_over), _guardian())


def all_passed(checks: tuple[Check, ...]) -> bool:
    """Return True when every check is green."""
    return all(check.passed for check in checks)


# ---- store and disk


def _store(job: Job) -> Check:
    parsed = parse_store_url(job.store_url)
    path = Path(str(parsed.database)) if parsed.get_backend_name() == "sqlite" else None
    remedy = "See to the store's server or file, or name another store."
    try:
        prove_spool_writable(default_folder())
        if path is not None and not path.exists():
            if not os.access(path.resolve().parent, os.W_OK | os.X_OK):
                raise StoreError(f"{path.resolve().parent}: cannot be written")
            return Check(name="store", passed=True, found=f"{path} will be made")
        with open_store(job.store_url) as store, store.changing():
            pass  # a writer's transaction was had
        if job.resume is not None and store.is_claimed(job.resume):
            raise StoreError(f"test {job.resume} is being run by another process")
    except StoreError as err:
        return Check(name="store", passed=False, found=str(err), remedy=remedy)
    return Check(name="store", passed=True, found="answers and can be written")


def _disk(job: Job) -> Check:
    need = SPARE_BYTES + READING_BYTES * job.plan.readings
    parsed = parse_store_url(job.store_url)
    places = {default_folder()}  # where readings go when the store does not answer
    if parsed.get_backend_name() == "sqlite":
        places.add(Path(str(parsed.database)).resolve().parent)
    free = min((shutil.disk_usage(p).free, str(p)) for p in places if p.exists())
    found = f"{free[0] / 1e6:.0f} MB free in {free[1]}, {need / 1e6:.0f} MB wanted"
    remedy = "Make room on that disk, or put the store on another."
    passed = free[0] >= need
    return Check(name="disk", passed=passed, found=found, remedy="" if passed else remedy)


# ---- instruments


def _instruments(job: Job, *, take_over: bool) -> Generator[Check]:
    """Look at the instruments with the chamber's lock held, so that nobody is disturbed."""
    with ExitStack() as stack:
        try:
            lock = take_lock(job.station.chamber, patience_s=0.0)
            stack.callback(lock.release)
        except ChamberHeldError as err:
            remedy = "Wait for that test to end, or abort it."
            yield Check(name="chamber free", passed=False, found=str(err), remedy=remedy)
            return
        except InstrumentError as err:
            remedy = "Correct the chamber's address in the station file."
            yield Check(name="chamber free", passed=False, found=str(err), remedy=remedy)
            return
        yield Check(name="chamber free", passed=True, found="no other process has it")
        try:
            station = stack.enter_context(open_station(job.station, permit=_refuse_all))
        except InstrumentError as err:
            remedy = "See to power, cable and address of the instrument named."
            yield Check(name="instruments", passed=False, found=str(err), remedy=remedy)
            return
        yield _chamber(station, job, take_over=take_over)
        for name, device in (("digitiser", station.digitiser), ("head", station.head)):
            yield _answers(name, device)


def _refuse_all() -> None:
    raise FencedError("nothing is commanded before the test is started")


def _answers(name: str, device: Device) -> Check:
    try:
        return Check(name=name, passed=True, found=device.identify())
    except InstrumentError as err:
        remedy = f"See to power, cable and address of the {name}, and that it is the right one."
        return Check(name=name, passed=False, found=str(err), remedy=remedy)


def _chamber(station: Station, job: Job, *, take_over: bool) -> Check:
    check = _answers("chamber", station.chamber)
    if not check.passed:
        return check
    chamber = station.chamber
    remedies = {
        "alarm": "Clear the alarm at the chamber.",
        "in use": "Free the chamber at its panel, or start with take-over.",
        "temperature": "Let the chamber come back within the limits, or widen them.",
    }
    try:
        found = _against(chamber, job, take_over=take_over)
    except InstrumentError as err:
        remedy = "See to the chamber's cable and settings."
        return Check(name="chamber", passed=False, found=str(err), remedy=remedy)
    if not found:
        return check
    return Check(
        name="chamber",
        passed=False,
        found="; ".join(found.values()),
        remedy=" ".join(remedies[kind] for kind in found),
    )


def _against(chamber: Chamber, job: Job, *, take_over: bool) -> dict[str, str]:
    """Return what stands against a start, by kind."""
    found: dict[str, str] = {}
    if alarms := chamber.read_alarms():
        found["alarm"] = f"alarm: {'; '.join(alarms)}"
    if (used := chamber.read_occupation()) and not take_over:
        found["in use"] = f"in use: {'; '.join(used)}"
    (low, high), here_c = job.plan.chamber_limits_c, chamber.read_temp_c()
    if not low <= here_c <= high:
        found["temperature"] = f"at {here_c:.1f} °C, outside {low:g} to {high:g} °C"
    return found


def _guardian() -> Check:
    try:
        prove_startable()
    except InstrumentError as err:
        remedy = "See why a Python process cannot be started (memory, limits of the service)."
        return Check(name="guardian", passed=False, found=str(err), remedy=remedy)
    return Check(name="guardian", passed=True, found="its process starts")
