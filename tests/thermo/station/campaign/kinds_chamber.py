"""Faults of instruments, and somebody at the panel of the chamber."""

import signal
import time
from pathlib import Path

from tests.thermo.station.campaign.case import Case
from tests.thermo.station.campaign.kinds import Result, begin, end, kind

# ---- somebody at the panel


def _panel(case: Case, *words: object, code: tuple[int, ...] = (1,), **how) -> Result:
    begin(case, **how)
    case.panel("chamber", *words)
    if case.rule == "pause":
        time.sleep(1.5)
        if case.process.poll() is None and case.is_safe():
            return Result(code, problems=["made safe while it was to pause"])
        case.process.kill(signal.SIGTERM)
        code = (1,)
    return Result(code, says="foreign")


@kind(6)
def panel_setpoint(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60))


@kind(3, rule="tell")
def panel_setpoint_tell(case: Case) -> Result:
    # the next command of the programme puts it right; if none comes the deviation ends it
    return _panel(case, "setpoint", case.rng.uniform(22, 23))


@kind(3, rule="pause")
def panel_setpoint_pause(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60))


@kind(6)
def panel_off(case: Case) -> Result:
    result = _panel(case, "off")
    end(case)
    if case.panel("state")["mode"] != 62:
        result.problems.append("a loop that somebody switched off was switched on")
    return result


@kind(6)
def panel_profile(case: Case) -> Result:
    return _panel(case, "profile", case.rng.uniform(30, 60))


@kind(3, model="watlow_f4")
def panel_profile_f4(case: Case) -> Result:
    # while its own ramp is a profile somebody else's cannot be told from it by the state alone
    return _panel(case, "profile", case.rng.uniform(30, 60), low=12, high=13)


@kind(3, model="watlow_f4")
def panel_setpoint_f4(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60), low=12, high=13)


def _refused(case: Case, *words: object) -> Result:
    case.panel("chamber", *words)
    case.strike()
    case.start()
    end(case)
    stored = ["a store was left"] if Path(case.store).exists() else []
    return Result((2,), within_s=None, problems=stored)


@kind(3)
def start_profile(case: Case) -> Result:
    return _refused(case, "profile", 50)


@kind(3)
def start_off(case: Case) -> Result:
    return _refused(case, "off")


@kind(3)
def start_fahrenheit(case: Case) -> Result:
    return _refused(case, "fahrenheit")


@kind(3)
def start_words(case: Case) -> Result:
    return _refused(case, "words")


@kind(3, model="watlow_f4")
def start_decimals(case: Case) -> Result:
    return _refused(case, "decimals", case.rng.choice((0, 2)))


@kind(2, model="watlow_f4")
def start_fahrenheit_f4(case: Case) -> Result:
    return _refused(case, "fahrenheit")


@kind(3)
def start_taken_over(case: Case) -> Result:
    case.panel("chamber", *case.rng.choice((("profile", 50), ("off",))))
    case.start("--take-over")
    if not case.wait_for_slots(3):
        raise AssertionError(case.process.text()[-600:])
    case.strike()
    return Result((0,), says="take-over")


# ---- the chamber


@kind(6)
def chamber_frozen(case: Case) -> Result:
    begin(case, low=1, high=3)
    case.panel("chamber", "freeze")
    return Result((1,), says="chamber")


def _passing(case: Case, what: str, low: int, high: int, seconds: float = 0.0, **how) -> Result:
    begin(case, **how)
    case.panel("chamber", what, case.rng.randint(low, high), seconds)
    return Result((0, 1))


@kind(6)
def chamber_late(case: Case) -> Result:
    return _passing(case, "late", 1, 4, case.rng.uniform(0.2, 0.9))


@kind(5)
def chamber_silent(case: Case) -> Result:
    return _passing(case, "silent", 1, 6)


@kind(5)
def chamber_reset(case: Case) -> Result:
    return _passing(case, "reset", 1, 20)


@kind(5)
def chamber_dropped(case: Case) -> Result:
    return _passing(case, "drop", 1, 20)


@kind(5)
def chamber_exception(case: Case) -> Result:
    return _passing(case, "exception", 1, 12)


@kind(5)
def chamber_garbage(case: Case) -> Result:
    return _passing(case, "garbage", 1, 6)


@kind(4)
def chamber_torn(case: Case) -> Result:
    return _passing(case, "torn", 1, 6)


@kind(5)
def chamber_nan(case: Case) -> Result:
    return _passing(case, "nan", 1, 4)


@kind(4)
def chamber_nan_for_good(case: Case) -> Result:
    begin(case, high=6)
    case.panel("chamber", "nan", 100000)
    return Result((1,))


def _unrecognised(case: Case, *words: object, **how) -> Result:
    """Nothing may be written by a wrong scale; only the limits of the chamber are safe then."""
    begin(case, high=8, **how)
    case.panel("chamber", *words)
    end(case, 200)
    # the guardian keeps trying; somebody puts the controller's settings right
    writes = [w for w in case.log("write") if w["t"] > case.fault_s + 0.05]
    odd = [w for w in writes if not -60 <= w["setpoint"] <= 90]
    result = Result((1,))
    if odd:
        result.problems.append(f"wrote by a wrong scale: {odd[:2]}")
    return result


@kind(4)
def chamber_words(case: Case) -> Result:
    result = _unrecognised(case, "words")
    case.panel("chamber", "words")
    case.strike()
    return result


@kind(4)
def chamber_fahrenheit(case: Case) -> Result:
    result = _unrecognised(case, "fahrenheit")
    case.panel("chamber", "celsius")
    case.strike()
    return result


@kind(4, model="watlow_f4")
def chamber_decimals(case: Case) -> Result:
    result = _unrecognised(case, "decimals", case.rng.choice((0, 2)))
    case.panel("chamber", "decimals", 1)
    case.strike()
    return result


@kind(4)
def chamber_dead_a_while(case: Case) -> Result:
    begin(case)
    case.panel("chamber", "dead")
    time.sleep(case.rng.uniform(0.1, 1.5))
    case.panel("chamber", "alive")
    return Result((0, 1))


@kind(4)
def chamber_dead_controller_killed(case: Case) -> Result:
    begin(case)
    case.panel("chamber", "dead")
    case.process.kill(signal.SIGKILL)
    time.sleep(case.rng.uniform(0.5, 4))
    case.panel("chamber", "alive")
    case.strike()
    return Result((-9,), within_s=40)


# ---- multimeter and head


@kind(5)
def thermistor_lost(case: Case) -> Result:
    begin(case, high=8)
    case.panel("digitiser", "lose", case.rng.choice((111, 112)))
    return Result((1,), says="thermistor")


@kind(4)
def output_stuck(case: Case) -> Result:
    begin(case, high=5)
    case.panel("digitiser", "stick")
    return Result((1,), says="repeat")


@kind(4)
def digitiser_silent(case: Case) -> Result:
    begin(case)
    case.panel("digitiser", "silent", case.rng.choice((1, 2, 100000)))
    return Result((0, 1))


@kind(4)
def head_stuck(case: Case) -> Result:
    begin(case, high=5)
    case.panel("head", "stick")
    return Result((1,), says="head")


@kind(4)
def head_silent(case: Case) -> Result:
    begin(case)
    case.panel("head", "silent", case.rng.choice((1, 3, 100000)))
    return Result((0, 1))


@kind(3)
def head_unplugged(case: Case) -> Result:
    begin(case)
    case.panel("head", "unplug")
    return Result((1, 0))


@kind(3)
def digitiser_unplugged(case: Case) -> Result:
    begin(case)
    case.panel("digitiser", "unplug")
    return Result((1,))
