"""From a recorded run to a calibration that is judged, in one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.calibration.consistency import MeasurementRows, nis_of, normalised_rows, rows_of_rig
from sinscal.calibration.hold_out import HoldOut, cycles_held, hold_out, shift_test, without_cycle
from sinscal.calibration.navigation import calibrate_navigation
from sinscal.calibration.noise import believed, noise_of_run, refined
from sinscal.calibration.rig import RigCalibration, calibrate
from sinscal.filter.data import RigNoise, cycle_data, unused_rows
from sinscal.judgement.judge import Judged, judge_calibration
from sinscal.judgement.options import Options, model_for, with_options
from sinscal.judgement.protection import over_limits, protection_levels
from sinscal.library.angle import MOUNT
from sinscal.model.priors import make_prior
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import NavRun, RigRun
from sinscal.sensitivity.drift import Drift, further_drifts
from sinscal.sensitivity.problem import FilterProblem
from sinscal.sensitivity.views import EffectView, effect_views, tested_effects

Tell = Callable[[str], None]


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
    noise = with_options(believed(noise, run), options)
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
    judged = judge_calibration(
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


def _white(normalised: FloatArray, rows: MeasurementRows) -> FloatArray:
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
    return judge_calibration(found, [0] * len(run.cycles), held)
