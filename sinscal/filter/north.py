"""North as found against north as given: which of the two a calibration may rely on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.filter.alignment import azimuth_of, mean_axis
from sinscal.filter.data import CycleData, Nominal
from sinscal.frames.attitude import rotation
from sinscal.recording.run import RigFacts

# North that is found no better than this is no north: the gyros do not feel the earth.
NORTH_SIGMA_RAD = 0.3
CONTRADICTION_SIGMAS = 5.0
# The rotation axis in the body is taken from sensors not yet calibrated, 3′ in each axis.
AXIS_SIGMA_RAD = 1e-3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KnownNorth:
    """Knowledge of north that a calibration uses.

    Attributes
    ----------
    nominal : Nominal
        Turned to the azimuth given where the gyros did not find north.
    facts : RigFacts
        Without the azimuth when it must not be used.
    azimuth_rad, sigma_rad : ndarray, shape (cycles,)
        Of the rotation axis by gyrocompassing alone.
    warnings : tuple of str
    """

    nominal: Nominal
    facts: RigFacts
    azimuth_rad: FloatArray
    sigma_rad: FloatArray
    warnings: tuple[str, ...] = ()


def judge_north(
    facts: RigFacts,
    cycles: Sequence[CycleData],
    nominal: Nominal,
    sigma_rad: FloatArray,
    source: str,
) -> KnownNorth:
    """Compare the azimuth that gyrocompassing found with the one given.

    Raises
    ------
    InputError
        If the gyros found no north and none is given.
    """
    pairs = list(zip(nominal.c_start, cycles, strict=True))
    found = np.array([azimuth_of(c @ mean_axis(cycle)) for c, cycle in pairs])
    known = KnownNorth(nominal=nominal, facts=facts, azimuth_rad=found, sigma_rad=sigma_rad)
    given = facts.azimuth_rad
    if given is not None and facts.axis_of_cycle is None:
        text = (
            "azimuth_not_used: azimuth_deg is that of the rotation axis, and without "
            "axis_of_cycle its positive direction is not known"
        )
        known = replace(known, facts=replace(facts, azimuth_rad=None), warnings=(text,))
        given = None
    lost = sigma_rad > NORTH_SIGMA_RAD
    if given is None:
        if lost.any():
            raise InputError(
                source,
                f"cycle {int(np.argmax(sigma_rad)) + 1}",
                f"the gyros find north only to ± {np.rad2deg(sigma_rad.max()):.0f}°; expected "
                "azimuth_deg in the sidecar, longer cycles, or gyros that can measure the "
                "earth's rotation",
            )
        return known
    apart = (found - given + np.pi) % (2.0 * np.pi) - np.pi
    spread = np.sqrt(sigma_rad**2 + facts.azimuth_sigma_rad**2 + AXIS_SIGMA_RAD**2)
    if np.any(np.abs(apart[~lost]) > CONTRADICTION_SIGMAS * spread[~lost]):
        return _refused(known, apart, spread)
    up = np.array([0.0, 0.0, 1.0])
    starts = [rotation(apart[k] * up) @ c if lost[k] else c for k, c in enumerate(nominal.c_start)]
    return replace(known, nominal=replace(nominal, c_start=tuple(starts)))


def _refused(known: KnownNorth, apart: FloatArray, spread: FloatArray) -> KnownNorth:
    worst = int(np.argmax(np.abs(apart) / spread))
    text = (
        f"azimuth_contradiction: the gyros find the rotation axis of cycle {worst + 1} "
        f"{np.rad2deg(apart[worst]):+.2f}° from the azimuth given, "
        f"{abs(apart[worst]) / spread[worst]:.0f} sigmas; the azimuth given is not used"
    )
    return replace(
        known,
        facts=replace(known.facts, azimuth_rad=None),
        warnings=(*known.warnings, text),
    )
