"""What is known before a calibration: sigmas of the sensors' errors and of the rig's."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.io.toml import read_toml
from sinscal.frames.earth import ARCMIN, DEG_PER_H
from sinscal.model.sensors import SensorModel
from sinscal.model.terms import GROUPS

G = 9.80665
# The article's (DESIGN section 2) for what it estimates; for the rest, assumed values of
# navigation-grade sensors: several times what their data sheets allow.
GROUP_SIGMAS: Mapping[str, float] = {
    "gyro_bias": 0.5 * DEG_PER_H,
    "gyro_scale": 1e-3,
    "gyro_misalignment": 3.0 * ARCMIN,
    "gyro_g_sensitivity": 0.5 * DEG_PER_H / G,
    "gyro_scale_asymmetry": 1e-4,
    "gyro_temperature_drift": 0.05 * DEG_PER_H,
    "accel_bias": 0.02,
    "accel_scale": 1e-3,
    "accel_misalignment": 3.0 * ARCMIN,
    "accel_second_order": 1e-4 / G,
    "lever_arm": 0.1,
    "accel_delay": 0.005,
    "accel_temperature_bias": 100e-6 * G,
    "accel_temperature_scale": 200e-6,
    "rig_time_offset": 0.05,
    "rig_angle_harmonic": 120.0 * ARCMIN / 60.0,
    "rig_angle_harmonic_2": 120.0 * ARCMIN / 60.0,
}
MOUNT_SIGMA_RAD = float(np.deg2rad(1.0))  # the article's
# An effect of which nothing is expected would never show and never cost anything: a figure of
# "0.0 ± 0.0" instead of an error.
if without := set(GROUPS) - set(GROUP_SIGMAS):
    raise LookupError(f"groups without a prior: {', '.join(sorted(without))}")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigPrior:
    """What is known beforehand.

    Attributes
    ----------
    values : ndarray, shape (p,)
        Of the sensor model's unknowns.
    cov : ndarray, shape (p, p)
    mount_sigma_rad : float
        Of the SINS's mounting on the platform, each axis.
    remount_sigma_rad : float
        Of what each cycle adds to it; 0: the mounting is the same in all.
    base_sigma_rad : float
        Of the platform's attitude at angle zero, each axis; a wide one leaves it to the data.
    start_sigma_rad : float
        Of a cycle's start attitude about the one found by levelling.
    azimuth_sigma_rad : float, optional
        Of its azimuth, each cycle by itself; None: as the rest of the attitude.
    """

    values: FloatArray
    cov: FloatArray
    mount_sigma_rad: float = MOUNT_SIGMA_RAD
    remount_sigma_rad: float = 0.0
    base_sigma_rad: float = 0.5
    start_sigma_rad: float = 0.5
    azimuth_sigma_rad: float | None = None

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))


class PriorFile(BaseModel):
    """PRIORS.toml: sigmas in SI by group (`gyro_bias`) or by name (`gyro_bias_x`), and means."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sigma: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}
    mean: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    mount_sigma_rad: Annotated[float, Field(ge=0, le=1)] = MOUNT_SIGMA_RAD
    remount_sigma_rad: Annotated[float, Field(ge=0, le=1)] = 0.0


def group_of(name: str) -> str:
    """Return the group an unknown belongs to: the longest group name that begins its own.

    Raises
    ------
    KeyError
        If it is no unknown of `sinscal.model.terms`.
    """
    found = [g for g in GROUPS if name == g or name.startswith(f"{g}_")]
    if not found:
        raise KeyError(f"{name} belongs to no group")
    return max(found, key=len)


def told_group(name: str) -> str:
    """Return the group of a parameter, the mounting's and the chamber's coefficients' included."""
    if name.startswith("rig_mount_"):
        return "rig_mount"
    for change in ("_bias_step_", "_bias_drift_"):
        if change in name:
            return name.rpartition("_")[0]
    try:
        return group_of(name)
    except KeyError:  # a chamber's coefficient, by axis
        return name.rpartition("_")[0]


def prior_sigma(name: str, given: Mapping[str, float] = {}) -> float:
    """Return an unknown's sigma: its own or its group's, SI.

    Parameters
    ----------
    name : str
        Of the sensors' errors, or of the mounting (`rig_mount_x`).
    given : mapping of str to float
        Sigmas by group or name that go before the usual ones.

    Raises
    ------
    KeyError
        If it belongs to no group.
    """
    if name in given:
        return given[name]
    if name.startswith("rig_mount_"):
        return MOUNT_SIGMA_RAD
    group = group_of(name)
    return given.get(group, GROUP_SIGMAS[group])


def make_prior(
    sensors: SensorModel, file: PriorFile | None = None, *, others: Collection[str] = ()
) -> RigPrior:
    """Return the prior of a sensor model: the groups' sigmas, and what a file says instead.

    Parameters
    ----------
    sensors : SensorModel
    file : PriorFile, optional
    others : collection of str
        Unknowns of no group, whose prior the caller has (a chamber's coefficients); here sigma 0.

    Raises
    ------
    InputError
        If the file names something that is not in the model.
    KeyError
        If an unknown belongs to no group and is none of the others.
    """
    given = file or PriorFile()
    names = sensors.names
    known = {*names, *GROUPS}
    for part in ("sigma", "mean"):
        for name in getattr(given, part):
            if name not in known or (part == "mean" and name not in names):
                raise InputError("the priors", f"{part}.{name}", "not an unknown of this model")
    sigmas = np.array([0.0 if n in others else prior_sigma(n, given.sigma) for n in names])
    values = sensors.start_values()
    for name, value in given.mean.items():
        values[names.index(name)] = value
    return RigPrior(
        values=values,
        cov=np.diag(sigmas**2),
        mount_sigma_rad=given.mount_sigma_rad,
        remount_sigma_rad=given.remount_sigma_rad,
    )


def read_priors(path: Path | str) -> PriorFile:
    """Read PRIORS.toml.

    Raises
    ------
    InputError
        If it cannot be read or a key is not what it should be.
    """
    return read_toml(path, PriorFile)
