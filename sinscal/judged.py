"""A calibration and everything that says how far it can be trusted, from one call."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.calibrate import GATE_SIGMAS, INTERVAL_S, Mode, RigCalibration, calibrate
from sinscal.consistency import (
    Consistency,
    Refused,
    Rows,
    judge_innovations,
    normalised_rows,
    refused_of,
    rows_of_rig,
)
from sinscal.holdout import Held, HoldOut, cycles_held, hold_out, shift_test, without_cycle
from sinscal.navigation import NavCalibration, calibrate_navigation
from sinscal.noise_estimate import NoiseFound, noise_of_run, refined
from sinscal.observability import Observability, observability
from sinscal.priors import PriorFile, RigPrior, make_prior
from sinscal.rig_model_file import BiasStep, check_needs
from sinscal.rigdata import RigNoise, unused_rows
from sinscal.run import NavRun, RigRun
from sinscal.sensors import T_REF_C, SensorModel, sensor_model
from sinscal.terms import BASIC, TIME_OFFSET

NOISE_FACTOR = 1.5  # by which the sigma of the innovations may be off before it is said by name
PRIOR_SIGMAS = 6.0

Tell = Callable[[str], None]
Calibration = RigCalibration | NavCalibration


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to calibrate from raw sensors.

    Attributes
    ----------
    mode : {"coarse", "precise"}
    groups : tuple of str
        Estimated in addition to the basic ones (`sinscal.terms.GROUPS`).
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judged:
    """A calibration with its judgement; `warnings` holds all of them, each begun by its name.

    `steps` are the jumps among the sensors' terms.
    """

    found: Calibration
    rows: Rows
    consistency: Consistency
    observability: Observability
    refused: tuple[Refused, ...]
    flagged: tuple[int, ...]
    warnings: tuple[str, ...]
    steps: tuple[BiasStep, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the calibration is consistent."""
        return self.consistency.passed


def calibrate_and_judge(run: RigRun, options: Options, tell: Tell = lambda _: None) -> Judged:
    """Calibrate a SINS from its raw sensors, and judge the result.

    Parameters
    ----------
    run : RigRun
    options : Options
    tell : callable, optional
        Is told what is being done.

    Returns
    -------
    Judged

    Raises
    ------
    InputError
        If the run lacks what is asked for.
    """
    sensors = model_for(run, options)
    prior = make_prior(sensors, options.priors)
    noise = noise_of_run(run, angle=options.mode == "precise" and run.rig_angle_rad is not None)
    noise = _as_asked(noise, options)
    tell(f"calibrating: {len(sensors.names)} unknowns, {len(run.cycles)} cycle(s)")

    def once(part: RigRun, known: NoiseFound) -> RigCalibration:
        return calibrate(
            part, options.mode, sensors=sensors, prior=prior, noise=known.noise,
            interval_s=options.interval_s, gate=options.gate,
        )  # fmt: skip

    found = once(run, noise)
    if noise.estimated:
        noise = refined(noise, found.filtered)
        tell("again with the noise that the innovations show")
        found = once(run, noise)
    held: list[HoldOut] = []
    for cycle in cycles_held(options.hold_out, len(run.cycles), run.source):
        tell(f"without cycle {cycle + 1}")
        held.append(hold_out(run, found, cycle, options.interval_s))
    judged = judge(
        found,
        [int(np.sum(unused_rows(run, rows))) for rows in run.cycles],
        held,
        noise_known=not {"accelerometer", "angle"} & {*noise.estimated},
        warnings=noise.warnings,
    )
    return replace(judged, steps=options.steps)


def judge_navigation(run: NavRun, options: Options, tell: Tell = lambda _: None) -> Judged:
    """Calibrate a SINS from its navigation outputs, and judge the result.

    Parameters
    ----------
    run : NavRun
    options : Options
        `mode` and what concerns the rig's filter alone are not used.
    tell : callable, optional

    Raises
    ------
    InputError
        If the run lacks what is asked for.
    """
    sensors = model_for(run, replace(options, mode="coarse"))
    prior = make_prior(sensors, options.priors)
    tell(f"calibrating: {len(sensors.names)} unknowns, {len(run.cycles)} cycle(s)")
    found = calibrate_navigation(run, sensors=sensors, prior=prior)
    held: list[HoldOut] = []
    for cycle in cycles_held(options.hold_out, len(run.cycles), run.source):
        tell(f"without cycle {cycle + 1}")
        shift = shift_test(found.values, found.cov, *without_cycle(found, cycle))
        held.append(HoldOut(cycle=cycle, shift=shift))
    return judge(found, [0] * len(run.cycles), held)


def model_for(run: RigRun | NavRun, options: Options) -> SensorModel:
    """Return the sensor model that options ask for.

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
            more=[step.maker for step in options.steps],
            t_ref_c=options.t_ref_c,
            gravity_m_s2=run.facts.site.gravity_m_s2,
        )
    except KeyError as err:
        raise InputError("the groups", "", str(err.args[0])) from None


def _as_asked(noise: NoiseFound, options: Options) -> NoiseFound:
    asked = replace(
        noise.noise,
        wobble=options.wobble,
        gyro_instability=options.gyro_instability,
        accel_instability=options.accel_instability,
        instability_tau_s=options.instability_tau_s,
    )
    return replace(noise, noise=asked)


def judge(
    found: Calibration,
    flagged: Sequence[int],
    held: Sequence[HoldOut],
    noise_known: bool = True,
    warnings: Sequence[str] = (),
) -> Judged:
    """Judge a calibration by its innovations, a cycle held out and what was known beforehand.

    Parameters
    ----------
    found : RigCalibration or NavCalibration
    flagged : sequence of int
        How many rows of each cycle were not used as measurements.
    held : sequence of HoldOut
    noise_known : bool
        Whether the noise is not from the same data.
    warnings : sequence of str
        Known before.
    """
    if isinstance(found, RigCalibration):
        rows = rows_of_rig(found.steps.h.shape[1])
    else:
        rows = Rows(names=found.layout.integrals, white=found.judged)
    p = len(found.sensors.names)
    nis, channels, bounded = judge_innovations(
        normalised_rows(found.filtered), found.cycle_of_step, rows
    )
    consistency = Consistency(
        nis=nis,
        channels=channels,
        bounded=bounded,
        held_out=tuple(held),
        prior=shift_test(found.values[:p], found.cov[:p, :p], found.prior.values, found.prior.cov),
        noise_known=noise_known,
        converged=found.converged,
    )
    own = [found.layout.names.index(name) for name in found.names]
    return Judged(
        found=found,
        rows=rows,
        consistency=consistency,
        observability=observability(found.names, found.cov, found.start.sigmas[own]),
        refused=refused_of(found.filtered, found.cycle_of_step, found.time_s, rows),
        flagged=tuple(flagged),
        warnings=(*found.warnings, *warnings, *_contradictions(found, consistency)),
    )


def _contradictions(found: Calibration, consistency: Consistency) -> list[str]:
    out: list[str] = []
    sigma = float(np.sqrt(consistency.nis.mean))
    if consistency.noise_known and not 1 / NOISE_FACTOR < sigma < NOISE_FACTOR:
        out.append(
            f"noise_contradiction: the innovations are {sigma:.2g} times as large as the noise "
            "stated allows; all sigmas are wrong by about that, or the model lacks something"
        )
    if not (consistency.white and consistency.steady):
        out.append(
            "coloured_innovations: the innovations are not white: the sensors drift slowly or the "
            "model lacks something, and the sigmas are too small; " + _advice(found)
        )
    if not consistency.repeats:
        worst = min(consistency.held_out, key=lambda held: held.shift.p_value)
        out.append(
            f"cycle_contradiction: cycle {worst.cycle + 1} does not agree with the "
            f"others; where nothing else is wrong the sensors drift: {_advice(found)}"
        )
    if not consistency.within_bound:
        out.append(
            "axis_moves: across itself the rig's axis moves more than assumed; see --axis-wobble"
        )
    if not consistency.expected:
        out.append(
            f"prior_contradiction: the errors are larger than expected beforehand, χ² "
            f"{consistency.prior.chi2:.0f} with {consistency.prior.dof} degrees of freedom; where "
            "that is no fault, --priors takes wider ones"
        )
    out += prior_contradictions(found.names, found.values, found.sensors, found.prior)
    if not consistency.converged:
        out.append("not_converged: the estimates still move; the values are not to be used")
    return out


def _advice(found: Calibration) -> str:
    if isinstance(found.noise, RigNoise):
        if found.noise.drifts:
            return "the drift allowed for does not explain it"
        return "--gyro-instability and --accel-instability allow for drift"
    return "the outputs do not agree with the noise stated"


def prior_contradictions(
    names: Sequence[str], values: FloatArray, sensors: SensorModel, prior: RigPrior
) -> list[str]:
    """Return a warning for each estimate beyond six of its prior's sigmas."""
    sigma = np.sqrt(np.diag(prior.cov))
    out: list[str] = []
    for name, value in zip(names, values, strict=True):
        if name not in sensors.names:
            continue
        k = sensors.names.index(name)
        if sigma[k] > 0 and abs(value - prior.values[k]) > PRIOR_SIGMAS * sigma[k]:
            out.append(
                f"prior_contradiction: {name} is {value:.3g}, "
                f"{abs(value - prior.values[k]) / sigma[k]:.0f} sigmas of the prior from its mean"
            )
    return out
