"""Priors of a calibration: sigmas of the sensors' errors and of the rig's."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from errormodel.arrays import FloatArray, freeze, readonly
from errormodel.errors import InputError
from errormodel.io.toml import read_toml
from errormodel.terms import Description
from sinscal.library import rig_library
from sinscal.library.angle import MOUNT_SIGMA_RAD
from sinscal.model.sensors import SensorModel


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigPrior:
    """Priors of a rig calibration.

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


def prior_sigma(one: Description, given: Mapping[str, float] = {}) -> float:
    """Return how large a parameter is expected to be, SI.

    Parameters
    ----------
    one : Description
    given : mapping of str to float
        Sigmas by name, group or family that go before the library's.

    Raises
    ------
    ValueError
        If neither says it.
    """
    for key in (one.name, one.group, one.family):
        if key in given:
            return given[key]
    if one.prior_sigma is None:
        raise ValueError(f"{one.name} has no prior sigma")
    return one.prior_sigma


def make_prior(
    sensors: SensorModel, file: PriorFile | None = None, *, others: Collection[str] = ()
) -> RigPrior:
    """Return the prior of a sensor model: the groups' sigmas, and what a file says instead.

    Parameters
    ----------
    sensors : SensorModel
    file : PriorFile, optional
    others : collection of str
        Parameters whose prior the caller has (a chamber's coefficients); here sigma 0.

    Raises
    ------
    InputError
        If the file names something that is not in the model.
    ValueError
        If a parameter has no prior and is none of the others.
    """
    given = file or PriorFile()
    names = sensors.names
    known = {*names, *rig_library().groups}
    for part in ("sigma", "mean"):
        for name in getattr(given, part):
            if name not in known or (part == "mean" and name not in names):
                raise InputError("the priors", f"{part}.{name}", "not a parameter of this model")
    sigmas = np.array(
        [
            0.0 if name in others else prior_sigma(one, given.sigma)
            for name, one in sensors.parameters.items()
        ]
    )
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
