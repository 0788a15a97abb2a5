"""Combined calibration: rig and chamber correct each other, and what it buys in flight.

Three calibrations of the same run are compared: without temperature, with the chamber's model
applied beforehand and left as it was, and combined.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.filter.kalman import initial_state
from errormodel.filter.steps import run_filter
from sinscal.calibration.rig import Mode, RigCalibration, calibrate
from sinscal.combination.contradiction import ChamberTest, compare_with_chamber
from sinscal.combination.flight import flight_errors
from sinscal.filter.data import RigNoise, cycle_data
from sinscal.flight.trajectory import FlightPlan
from sinscal.library import BASIC
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.chamber import (
    ChamberModel,
    at_reference,
    chamber_names,
    combined_prior,
    combined_sensors,
    reference_name,
    within_range,
)
from sinscal.model.motion import Motion
from sinscal.model.priors import PriorFile, RigPrior
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import RigRun

# How far an accelerometer's coefficients may be from anything the chamber says, in the model's own
# units: spreads between units of one type (assumed, from common data sheets).
WIDE = {"k0": 5e-3, "k1": 2e-2}
WIDE_PER_C = {"k0": 50e-6, "k1": 300e-6}  # of the first order of temperature
WIDE_FACTOR = 100.0  # of the chamber's sigma, for what is not among them
ZERO_AND_SCALE = ("accel_bias", "accel_scale")
THIN_ROWS = 2000  # of each cycle, for what a thermistor's offset would do

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Combination:
    """Calibration by rig and chamber together.

    Attributes
    ----------
    calibration : RigCalibration
        Combined; its unknowns hold the chamber's coefficients by axis (`k0_x`).
    names, values, cov
        At the reference temperature, in the rig's names, SI.
    prior_pull : mapping of str to float
        By how many of the chamber's own sigmas each of its coefficients was moved, by its name at
        the reference temperature.
    prior_kept : mapping of str to float
        Sigma after over sigma before, of each.
    test : ChamberTest
    before : RigCalibration
        With the chamber's model applied beforehand.
    plain : RigCalibration
        Without temperature.
    flight_m : mapping of str to float
        ρ at the end of the flight: no_thermal, before, combined.
    """

    calibration: RigCalibration
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    prior_pull: Mapping[str, float]
    prior_kept: Mapping[str, float]
    test: ChamberTest
    before: RigCalibration
    plain: RigCalibration
    flight_m: Mapping[str, float]

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))


def combine(
    run: RigRun,
    chambers: Sequence[ChamberModel],
    mode: Mode = "coarse",
    *,
    groups: Sequence[str] = BASIC,
    priors: PriorFile | None = None,
    turn_on: Mapping[str, float] | None = None,
    noise: RigNoise | None = None,
    plan: FlightPlan | None = None,
    tell: Tell = lambda _: None,
) -> Combination:
    """Calibrate a SINS that warms itself, with its accelerometers' chamber models.

    Parameters
    ----------
    run : RigRun
        With temperatures.
    chambers : sequence of three ChamberModel
        Of the accelerometers x, y, z.
    mode : {"coarse", "precise"}
    groups : sequence of str
        What is estimated of the SINS beside the chamber's coefficients.
    priors : PriorFile, optional
    turn_on : mapping of str to float, optional
        Sigmas by which `k0` (g) and `k1` (relative) may have changed since the chamber.
    noise : RigNoise, optional
    plan : FlightPlan, optional
        The flight to judge by; it warms up as the rig run did.
    tell : callable
        Told in a few words what is being done.

    Raises
    ------
    InputError
        If the run has no temperatures, or the models do not fit together.
    """
    tell("rig and chamber")
    ended, test = combine_and_compare(
        run, chambers, mode, groups=groups, priors=priors, turn_on=turn_on, noise=noise
    )
    sensors, prior = ended.sensors, ended.prior
    run = within_range(run, [c.valid_c for c in chambers])
    groups = _of_mode(groups, mode)

    def solve(what: str, own: SensorModel, expected: RigPrior | None) -> RigCalibration:
        tell(what)
        return calibrate(run, mode, sensors=own, prior=expected, noise=noise)

    held = combined_sensors(chambers, groups, twice=ZERO_AND_SCALE)
    known = combined_prior(held, chambers, file=priors, turn_on=turn_on)
    before = solve("chamber's model beforehand", held, _held(known, held, chambers))
    own = sensor_model(groups, t_ref_c=sensors.t_ref_c, gravity_m_s2=sensors.gravity_m_s2)
    plain = solve("without temperature", own, None)
    tell("flight")
    names, values, cov = at_reference(ended.names, ended.values, ended.cov, sensors.gravity_m_s2)
    pull, kept = _pulls(ended, sensors, chambers, prior)
    return Combination(
        calibration=ended,
        names=names,
        values=values,
        cov=cov,
        prior_pull=pull,
        prior_kept=kept,
        test=test,
        before=before,
        plain=plain,
        flight_m=flight_errors(run, ended, before, plain, known, plan or FlightPlan()),
    )


def combine_and_compare(
    run: RigRun,
    chambers: Sequence[ChamberModel],
    mode: Mode = "coarse",
    *,
    groups: Sequence[str] = BASIC,
    priors: PriorFile | None = None,
    turn_on: Mapping[str, float] | None = None,
    noise: RigNoise | None = None,
) -> tuple[RigCalibration, ChamberTest]:
    """Return the combined calibration and whether rig and chamber agree; as of `combine`."""
    run = within_range(run, [c.valid_c for c in chambers])
    sensors = combined_sensors(chambers, _of_mode(groups, mode))
    prior = combined_prior(sensors, chambers, file=priors, turn_on=turn_on)
    ended = calibrate(run, mode, sensors=sensors, prior=prior, noise=noise)
    wide_cov = _wide(prior, sensors, chambers).cov
    values, cov = _rig_alone(ended, wide_cov)
    motions = _thinned(run)
    return ended, compare_with_chamber(sensors, chambers, motions, values, cov, wide_cov, prior.cov)


def _of_mode(groups: Sequence[str], mode: Mode) -> tuple[str, ...]:
    """Return what is estimated of the SINS: with the rig's angle the offset of its clock, too."""
    more = (TIME_OFFSET,) if mode == "precise" and TIME_OFFSET not in groups else ()
    return (*groups, *more)


def _wide(prior: RigPrior, sensors: SensorModel, chambers: Sequence[ChamberModel]) -> RigPrior:
    """Return a prior that is centred on the chamber's models and hardly holds them."""
    cov = prior.cov.copy()
    for name in chamber_names(sensors, chambers):
        i = sensors.names.index(name)
        one = sensors.parameters[name]
        sigma = (WIDE_PER_C if one.order else WIDE).get(one.family)
        if sigma is not None and one.order:
            # over 30 °C each higher order may do a tenth of what the first does
            sigma *= 0.1 ** (one.order - 1) / 30.0 ** (one.order - 1)
        old = float(np.sqrt(cov[i, i]))
        cov[i, :], cov[:, i] = 0.0, 0.0
        cov[i, i] = max(sigma or 0.0, WIDE_FACTOR * old) ** 2
    return replace(prior, cov=cov)


def _rig_alone(ended: RigCalibration, wide_cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what the rig says when it is not held: linear, about the combined calibration."""
    unknown = ended.layout.unknowns
    cov = ended.start.cov
    cov[unknown, unknown] = wide_cov
    state = run_filter(initial_state(ended.start.x, cov), ended.steps).state
    return ended.nominal.values + state.x[unknown], state.cov[unknown, unknown]


def _held(known: RigPrior, sensors: SensorModel, chambers: Sequence[ChamberModel]) -> RigPrior:
    """Return the prior of who applies the chamber's model beforehand and then asks the rig.

    The chamber's model is taken for exact; zero and scale errors are those that are left of it.
    """
    at = [sensors.names.index(n) for n in chamber_names(sensors, chambers)]
    cov = known.cov.copy()
    cov[at, :], cov[:, at] = 0.0, 0.0
    return replace(known, cov=cov)


def _thinned(run: RigRun) -> list[Motion]:
    out: list[Motion] = []
    for cycle in cycle_data(run, 1.0):
        m = cycle.measured
        rows = np.arange(0, len(m), max(1, len(m) // THIN_ROWS))
        out.append(m.take(rows))
    return out


def _pulls(
    ended: RigCalibration,
    sensors: SensorModel,
    chambers: Sequence[ChamberModel],
    prior: RigPrior,
) -> tuple[dict[str, float], dict[str, float]]:
    pull: dict[str, float] = {}
    kept: dict[str, float] = {}
    for name in chamber_names(sensors, chambers):
        i = sensors.names.index(name)
        sigma = float(np.sqrt(prior.cov[i, i]))
        if sigma > 0.0:
            told = reference_name(name)
            pull[told] = (ended.value(name) - float(prior.values[i])) / sigma
            kept[told] = ended.sigma(name) / sigma
    return pull, kept
