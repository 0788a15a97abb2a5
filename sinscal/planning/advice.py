"""Gain of a small change of a rig programme, told before the test.

Each change is tried on the same filter: its sigmas say what the programme as it is gives away.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from errormodel.progress import stage, track
from sinscal.calibration.rig import Mode
from sinscal.filter.data import RigNoise
from sinscal.frames.earth import ARCMIN
from sinscal.library import rig_library
from sinscal.library.lever import LEVER_ARM
from sinscal.model.priors import PriorFile, RigPrior, make_prior
from sinscal.model.sensors import SensorModel
from sinscal.planning.covariance import RigCovariance, rig_covariance
from sinscal.twin.programme import Cycle, Programme, Segment
from sinscal.twin.rehearse import sensors_with
from sinscal.twin.rig_file import RigFile
from sinscal.twin.simulate import Warming

WORTH_TELLING = 3.0  # times better
SLOWER = 0.5  # the second speed that is tried, of the first


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """A change of the programme and what it would bring.

    Attributes
    ----------
    change : str
    name : str
        The parameter that gains most.
    before, after : float
        Its sigma, SI.
    others : tuple of str
        Further groups that become `WORTH_TELLING` times better.
    """

    change: str
    name: str
    before: float
    after: float
    others: tuple[str, ...]

    @property
    def factor(self) -> float:
        """Factor by which the parameter's sigma falls."""
        return self.before / self.after


def analyse_programme(
    file: RigFile, mode: Mode, groups: Sequence[str], priors: PriorFile | None = None
) -> tuple[RigCovariance, tuple[Advice, ...]]:
    """Compute the covariance of a rig programme's calibration, with what changes would bring.

    Parameters
    ----------
    file : RigFile
    mode : {"coarse", "precise"}
    groups : sequence of str
        Groups of errors beside the basic ones; those of the rig's angle count in precise mode only.
    priors : PriorFile, optional

    Raises
    ------
    ValueError
        If the programme's cycles show nothing of an error.
    """
    angle = mode == "precise"
    wanted = [g for g in groups if angle or not rig_library().needs_angle(g)]
    sensors = sensors_with(wanted, file, angle=angle)
    prior, noise = make_prior(sensors, priors), file.noise.filtered
    azimuth, warming = file.azimuth_sigma_rad, file.warming
    with stage(0.0, 0.5):
        found = rig_covariance(
            file, sensors, prior, noise, angle=angle, azimuth_sigma_rad=azimuth, warming=warming
        )
    with stage(0.5, 1.0):
        advice = plan_advice(
            found,
            file,
            sensors,
            prior,
            noise,
            angle=angle,
            azimuth_sigma_rad=azimuth,
            warming=warming,
        )
    return found, advice


def plan_advice(
    found: RigCovariance,
    programme: Programme,
    sensors: SensorModel,
    prior: RigPrior,
    noise: RigNoise,
    *,
    angle: bool,
    azimuth_sigma_rad: float | None,
    warming: Warming | None = None,
) -> tuple[Advice, ...]:
    """Return the changes that are worth it; parameters as of `rig_covariance`, `found` by it."""
    out: list[Advice] = []
    for change, changed, azimuth in track(tuple(_changes(programme, sensors, azimuth_sigma_rad))):
        better = rig_covariance(
            changed, sensors, prior, noise, angle=angle, azimuth_sigma_rad=azimuth, warming=warming
        )
        told = _compared(change, found, better)
        if told is not None:
            out.append(told)
    return tuple(out)


def _changes(
    programme: Programme, sensors: SensorModel, azimuth_sigma_rad: float | None
) -> Iterator[tuple[str, Programme, float | None]]:
    if azimuth_sigma_rad is None or azimuth_sigma_rad > ARCMIN:
        yield "the azimuth of the rotation axis known to 1 arcmin", programme, ARCMIN
    speeds = {abs(s.rate_deg_s) for c in programme.cycles for s in c.segments} - {0.0}
    if len(speeds) == 1 and any(one.group == LEVER_ARM.name for one in sensors.parameters.values()):
        cycles = tuple(_at_two_speeds(c) for c in programme.cycles)
        changed = programme.model_copy(update={"cycles": cycles})
        yield "half of every segment at half the speed", changed, azimuth_sigma_rad


def _at_two_speeds(cycle: Cycle) -> Cycle:
    parts = [
        Segment(rate_deg_s=share * s.rate_deg_s, duration_s=0.5 * s.duration_s)
        for s in cycle.segments
        for share in (1.0, SLOWER)
    ]
    return cycle.model_copy(update={"segments": tuple(parts)})


def _compared(change: str, found: RigCovariance, better: RigCovariance) -> Advice | None:
    pairs = zip(found.names, found.sigmas.tolist(), better.sigmas.tolist(), strict=True)
    gains = {n: (a, b) for n, a, b in pairs if b > 0.0 and a > WORTH_TELLING * b}
    if not gains:
        return None
    best = max(gains, key=lambda n: gains[n][0] / gains[n][1])
    group_of = {n: rig_library().parameter(n).group for n in gains}
    return Advice(
        change=change,
        name=best,
        before=gains[best][0],
        after=gains[best][1],
        others=tuple(g for g in dict.fromkeys(group_of.values()) if g != group_of[best]),
    )
