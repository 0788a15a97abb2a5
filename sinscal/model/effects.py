"""The library of effects that a rig run may show: what each is, and what would isolate it."""

from collections.abc import Callable
from dataclasses import dataclass

from sinscal.model.terms import GROUPS, TIME_OFFSET, Kind
from sinscal.recording.run import RigRun

# The factors that innovations may follow, and effects live in.
PHASE, RATE, CYCLE, TIME, TEMPERATURE = (
    "rotation phase",
    "rate",
    "cycle",
    "time in run",
    "temperature",
)
# Warming by less than this tells nothing of temperature.
LEAST_WARMING_C = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEffect:
    """An effect that may be missing from the rig filter's model.

    Attributes
    ----------
    name : str
    groups : tuple of str
        Groups of `sinscal.model.terms` that it adds; none for a step and for the mounting.
    sentence : str
        What it is.
    experiment : str
        What would isolate it.
    follows : str
        The factor that its error of the readings follows.
    needs : {"", "angle", "temperature"}
        What the recording must hold for it to show.
    step : str, optional
        The kind of sensor whose constant error jumps.
    drift : str, optional
        The kind of sensor whose constant error drifts slowly.
    """

    name: str
    groups: tuple[str, ...] = ()
    sentence: str
    experiment: str
    follows: str
    needs: str = ""
    step: Kind | None = None
    drift: Kind | None = None

    def recorded(self, run: RigRun, *, angle: bool) -> bool:
        """Tell whether a run holds what the effect needs to show."""
        if self.needs == "angle":
            return angle
        if self.needs == "temperature":
            temp_c = run.temp_c
            return temp_c is not None and float(temp_c.max() - temp_c.min()) > LEAST_WARMING_C
        return True

    def unknowns(self) -> Callable[[str], bool]:
        """Return whether an unknown of the filter belongs to the effect."""
        starts = [f"{self.step}_bias_step"] if self.step else [*self.groups]
        if not starts:
            starts = [self.name]
        return lambda name: any(name == s or name.startswith(f"{s}_") for s in starts)


def _of_group(
    name: str, sentence: str, experiment: str, follows: str, needs: str = ""
) -> RigEffect:
    assert name in GROUPS
    return RigEffect(
        name=name,
        groups=(name,),
        sentence=sentence,
        experiment=experiment,
        follows=follows,
        needs=needs,
    )


_WARM = "repeat the programme once cold after a rest and once warm, with a thermistor per sensor"
EFFECTS: tuple[RigEffect, ...] = (
    _of_group(
        "lever_arm",
        "The sensing masses stand off the centre of rotation and feel its acceleration.",
        "turn at several rates, among them fast ones: the force grows with the rate squared",
        RATE,
    ),
    _of_group(
        "accel_delay",
        "The accelerometers' readings are later than the gyros'.",
        "turn fast both ways: gravity is then seen turned by the rate times the delay",
        RATE,
    ),
    _of_group(
        "gyro_g_sensitivity",
        "The gyros' drift changes with the specific force.",
        "turn slowly both ways about each axis in turn, so that gravity goes round in the body",
        PHASE,
    ),
    _of_group(
        TIME_OFFSET,
        "The rig's clock is ahead: its angle belongs to a later time.",
        "turn at several rates both ways: the angle's error is proportional to the rate",
        RATE,
        "angle",
    ),
    RigEffect(
        name="rig_mount",
        sentence="The SINS is mounted askew on the platform.",
        experiment="turn about two instrument axes at least without re-mounting",
        follows=PHASE,
        needs="angle",
    ),
    _of_group(
        "rig_angle_harmonic",
        "The encoder's error has one period a turn.",
        "turn through whole turns at a low rate both ways",
        PHASE,
        "angle",
    ),
    _of_group(
        "gyro_scale_asymmetry",
        "The gyros' scale factors differ between turning one way and the other.",
        "turn about each axis at two rates or more, each both ways, with the rig's angle recorded",
        RATE,
    ),
    _of_group(
        "accel_second_order",
        "The accelerometers' outputs have a part proportional to the input squared.",
        "turn about horizontal axes in whole turns, so that each accelerometer sees from -g to +g",
        PHASE,
    ),
    _of_group(
        "accel_temperature_bias",
        "The accelerometers' constant errors change with temperature.",
        _WARM,
        TEMPERATURE,
        "temperature",
    ),
    _of_group(
        "accel_temperature_scale",
        "The accelerometers' scale factors change with temperature.",
        _WARM,
        TEMPERATURE,
        "temperature",
    ),
    _of_group(
        "gyro_temperature_drift",
        "The gyros' drifts change with temperature.",
        _WARM,
        TEMPERATURE,
        "temperature",
    ),
    RigEffect(
        name="gyro_bias_step",
        sentence="The constant errors of the gyros jumped.",
        experiment="repeat the run: a jump does not come again at the same time",
        follows=TIME,
        step="gyro",
    ),
    RigEffect(
        name="accel_bias_step",
        sentence="The constant errors of the accelerometers jumped.",
        experiment="repeat the run: a jump does not come again at the same time",
        follows=TIME,
        step="accel",
    ),
)
# What a calibration is tested for beside them: drifts by any smooth course.
DRIFTS: tuple[RigEffect, ...] = (
    RigEffect(
        name="gyro_bias_drift",
        sentence="The constant errors of the gyros drift slowly.",
        experiment="record the temperature, repeat the run, and make the cycles shorter",
        follows=TIME,
        drift="gyro",
    ),
    RigEffect(
        name="accel_bias_drift",
        sentence="The constant errors of the accelerometers drift slowly.",
        experiment="record the temperature, repeat the run, and make the cycles shorter",
        follows=TIME,
        drift="accel",
    ),
)
BY_NAME = {e.name: e for e in (*EFFECTS, *DRIFTS)}
