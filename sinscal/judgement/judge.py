"""A calibration and everything that says how far it can be trusted, from one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.calibration.consistency import (
    Consistency,
    Refused,
    Rows,
    judge_innovations,
    nis_of,
    normalised_rows,
    refused_of,
    rows_of_rig,
)
from sinscal.calibration.hold_out import (
    Held,
    HoldOut,
    cycles_held,
    hold_out,
    shift_test,
    without_cycle,
)
from sinscal.calibration.navigation import calibrate_navigation
from sinscal.calibration.noise import NoiseFound, believed, noise_of_run, refined
from sinscal.calibration.observability import Observability, observability
from sinscal.calibration.rig import GATE_SIGMAS, INTERVAL_S, Mode, RigCalibration, calibrate
from sinscal.filter.data import RigNoise, cycle_data, unused_rows
from sinscal.judgement.protection import Level, over_limits, protection_levels
from sinscal.judgement.warnings import Calibration, warnings_of
from sinscal.library import BASIC
from sinscal.library.angle import MOUNT, TIME_OFFSET
from sinscal.model.larger_model import BiasDrift, BiasStep, check_needs
from sinscal.model.priors import PriorFile, make_prior
from sinscal.model.sensors import T_REF_C, SensorModel, sensor_model
from sinscal.recording.run import NavRun, RigRun
from sinscal.sensitivity.drift import Drift, further_drifts
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.views import EffectView, effect_views, tested_effects

# Warnings by which a run contradicts physics or what is stated beside it: none of them passes.
CONTRADICTIONS = ("_contradiction", "reversed_force")

Tell = Callable[[str], None]


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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judged:
    """A calibration with its judgement; `warnings` holds all of them, each begun by its name.

    `steps` are the jumps among the sensors' terms, `drifts` what was found to drift; `protection`
    the level of every parameter, None where raw sensors were not recorded; `limits` those asked
    for, by group, and `unprotected` the groups whose level is above, each with its worst parameter.
    """

    found: Calibration
    rows: Rows
    consistency: Consistency
    observability: Observability
    refused: tuple[Refused, ...]
    flagged: tuple[int, ...]
    warnings: tuple[str, ...]
    steps: tuple[BiasStep, ...] = ()
    drifts: tuple[Drift, ...] = ()
    protection: Mapping[str, Level] | None = None
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    unprotected: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def terms(self) -> tuple[BiasDrift, ...]:
        """The drifts among the sensors' terms."""
        return tuple(d.term for d in self.drifts if d.term)

    @property
    def passed(self) -> bool:
        """True when the calibration is consistent, and protected as far as was asked."""
        return self.consistency.passed and not self.unprotected


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
    _check_limits(run, sensors, options)
    noise = noise_of_run(run, angle=options.mode == "precise" and run.rig_angle_rad is not None)
    noise = _as_asked(believed(noise, run), options)
    tell(f"calibrating: {len(sensors.names)} unknowns, {len(run.cycles)} cycle(s)")
    found = _calibrated(run, options, sensors, noise.noise)
    if noise.estimated:
        noise = refined(noise, found.filtered)
        tell("again with the noise measured from the innovations")
        found = _calibrated(run, options, sensors, noise.noise)
    found, views, drifts = _with_drifts(run, options, found, tell)
    held: list[HoldOut] = []
    for cycle in cycles_held(options.hold_out, len(run.cycles), run.source):
        tell(f"without cycle {cycle + 1}")
        held.append(hold_out(run, found, cycle, options.interval_s))
    judged = judge(
        found,
        [int(np.sum(unused_rows(run, rows))) for rows in run.cycles],
        held,
        noise_known=not {"accelerometer", "angle"} & {*noise.estimated},
        warnings=(*noise.warnings, *(d.warning for d in drifts)),
        views=views,
    )
    judged = _protected(judged, views, options.protect)
    return replace(judged, steps=options.steps, drifts=drifts)


def _calibrated(
    run: RigRun, options: Options, sensors: SensorModel, noise: RigNoise
) -> RigCalibration:
    return calibrate(
        run, options.mode, sensors=sensors, prior=make_prior(sensors, options.priors), noise=noise,
        interval_s=options.interval_s, gate=options.gate,
    )  # fmt: skip


def _with_drifts(
    run: RigRun, options: Options, found: RigCalibration, tell: Tell
) -> tuple[RigCalibration, tuple[EffectView, ...], tuple[Drift, ...]]:
    """Return the calibration with the drifts that the run shows, and what it still lacks."""
    cycles = cycle_data(run, options.interval_s)
    given = options.priors.sigma if options.priors else {}
    tell("testing for missing effects")
    views = effect_views(run, found, cycles, given)
    drifts: tuple[Drift, ...] = ()
    while True:
        variance = variance_of(found)
        tests, problem = tested_effects(views, variance), FilterProblem(run, found, cycles, ())
        more = _not_asked(further_drifts(tests, problem, drifts, variance), options)
        if not more:
            return found, views, drifts
        drifts = (*drifts, *more)
        tell(f"again with {more[0].family} of the {more[0].kind}s")
        sensors = model_for(run, options, tuple(d.term for d in drifts if d.term))
        noise = found.noise
        for drift in more:
            noise = drift.allowed_for(noise)
        found = _calibrated(run, options, sensors, noise)
        views = effect_views(run, found, cycles, given)


def _not_asked(drifts: tuple[Drift, ...], options: Options) -> tuple[Drift, ...]:
    """Return drifts without those that are allowed for as large as was asked; none if it is found.

    The first is what the run shows.
    """
    asked = {"gyro": options.gyro_instability, "accel": options.accel_instability}
    left = tuple(d for d in drifts if not asked.get(d.kind))
    return left if left[:1] == drifts[:1] else ()


def variance_of(found: RigCalibration) -> float:
    """Return the mean square of the normalised innovations that are white when all is right."""
    rows = rows_of_rig(found.steps.h.shape[1])
    return nis_of(_white(normalised_rows(found.filtered), rows)).mean


def _white(normalised: FloatArray, rows: Rows) -> FloatArray:
    seen = normalised[:, list(rows.white)]
    return seen[np.isfinite(seen)]


def _check_limits(run: RigRun | NavRun, sensors: SensorModel, options: Options) -> None:
    """Check that the groups whose protection is asked for are estimated."""
    estimated = {one.group for one in sensors.parameters.values()}
    if options.mode == "precise":
        estimated.add(MOUNT)
    for group in options.protect:
        if isinstance(run, NavRun):
            raise InputError(run.source, f"protect {group}", "expected a run of raw sensors")
        if group not in estimated:
            raise InputError(run.source, f"protect {group}", "not estimated; add it by --groups")


def _protected(judged: Judged, views: Sequence[EffectView], limits: Mapping[str, float]) -> Judged:
    """Return a judgement with its protection levels, held to the limits asked for."""
    found, variance = judged.found, judged.consistency.nis.mean
    levels = protection_levels(found.names, found.sigmas, views, variance)
    over = over_limits(levels, limits, {n: found.described(n).group for n in levels})
    return replace(judged, protection=levels, limits=limits, unprotected=over)


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
    _check_limits(run, sensors, options)
    prior = make_prior(sensors, options.priors)
    tell(f"calibrating: {len(sensors.names)} unknowns, {len(run.cycles)} cycle(s)")
    found = calibrate_navigation(run, sensors=sensors, prior=prior)
    held: list[HoldOut] = []
    for cycle in cycles_held(options.hold_out, len(run.cycles), run.source):
        tell(f"without cycle {cycle + 1}")
        shift = shift_test(found.values, found.cov, *without_cycle(found, cycle))
        held.append(HoldOut(cycle=cycle, shift=shift))
    return judge(found, [0] * len(run.cycles), held)


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
    views: Sequence[EffectView] | None = None,
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
    views : sequence of EffectView, optional
        What the effects that are missing would do; without them they are not tested.
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
        effects=None if views is None else tested_effects(views, nis.mean),
    )
    told = (*found.warnings, *warnings, *warnings_of(found, consistency))
    against = [w.partition(":")[0] for w in told]
    consistency = replace(
        consistency, contradictions=tuple(n for n in against if n.endswith(CONTRADICTIONS))
    )
    own = [found.layout.names.index(name) for name in found.names]
    return Judged(
        found=found,
        rows=rows,
        consistency=consistency,
        observability=observability(found.names, found.cov, found.start.sigmas[own]),
        refused=refused_of(found.filtered, found.cycle_of_step, found.time_s, rows),
        flagged=tuple(flagged),
        warnings=told,
    )
