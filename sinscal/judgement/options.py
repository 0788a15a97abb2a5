"""Options of a calibration, and the model of the sensors that they ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from errormodel.errors import InputError
from sinscal.calibration.hold_out import Held
from sinscal.calibration.noise import NoiseFound
from sinscal.calibration.rig import GATE_SIGMAS, INTERVAL_S, Mode
from sinscal.library import BASIC
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.larger_model import BiasDrift, BiasStep, check_needs
from sinscal.model.priors import PriorFile
from sinscal.model.sensors import T_REF_C, SensorModel, sensor_model
from sinscal.recording.run import NavRun, RigRun


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a calibration from raw sensors.

    Attributes
    ----------
    mode : {"coarse", "precise"}
    groups : tuple of str
        Estimated in addition to the basic ones (groups of `sinscal.library`).
    steps : tuple of BiasStep
        Jumps of constant errors, estimated as well.
    priors : PriorFile, optional
    interval_s, gate : float
    gyro_instability, accel_instability, instability_tau_s : float
        Slow drift that the filter allows for: rad/s, m/s², s.
    wobble : float, optional
        Bound of the movement of the rig's axis across itself, rad/√Hz; that of the angle's noise
        if not given.
    t_ref_c : float
    hold_out : {"last", "each", "none"} or int
        The cycle judged by the others: the last, each in turn, none, or one by its number from 1.
    protect : mapping of str to float
        The largest protection level allowed of the parameters of a group, SI.
    """

    mode: Mode = "coarse"
    groups: tuple[str, ...] = ()
    steps: tuple[BiasStep, ...] = ()
    priors: PriorFile | None = None
    interval_s: float = INTERVAL_S
    gate: float = GATE_SIGMAS
    gyro_instability: float = 0.0
    accel_instability: float = 0.0
    instability_tau_s: float = 3600.0
    wobble: float | None = None
    t_ref_c: float = T_REF_C
    hold_out: Held = "last"
    protect: Mapping[str, float] = field(default_factory=dict[str, float])


def model_for(
    run: RigRun | NavRun, options: Options, drifts: Sequence[BiasDrift] = ()
) -> SensorModel:
    """Return the sensor model that options ask for, with drifts beside.

    Raises
    ------
    InputError
        If a group is not known, or the run or the mode has not what it needs.
    """
    groups = [*BASIC, *options.groups]
    if options.mode == "precise":
        groups.append(TIME_OFFSET)
    check_needs(groups, run, options.mode)
    try:
        return sensor_model(
            tuple(dict.fromkeys(groups)),
            more=[one.group for one in (*options.steps, *drifts)],
            t_ref_c=options.t_ref_c,
            gravity_m_s2=run.facts.site.gravity_m_s2,
        )
    except KeyError as err:
        raise InputError("the groups", "", str(err.args[0])) from None


def with_options(noise: NoiseFound, options: Options) -> NoiseFound:
    """Return the noise with the drift and the wobble that options allow for."""
    asked = replace(
        noise.noise,
        wobble=options.wobble,
        gyro_instability=options.gyro_instability,
        accel_instability=options.accel_instability,
        instability_tau_s=options.instability_tau_s,
    )
    return replace(noise, noise=asked)
