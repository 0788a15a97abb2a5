"""Recorded rig runs and navigation-output runs as files: a table and its sidecar NAME.toml."""

import logging
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.io.table_write import write_with_sidecar
from errormodel.io.tables import RawTable, TableForm, read_table, sidecar_path
from errormodel.io.toml import read_toml
from errormodel.io.toml_write import Plain, toml_text
from sinscal.frames.attitude import angles_from_c_nb
from sinscal.frames.earth import ARCSEC, DEG_PER_H, Site
from sinscal.recording.check import checked_rig
from sinscal.recording.nav import NAV_FORM, BodyAxes, build_nav
from sinscal.recording.rig import build_rig
from sinscal.recording.run import AXES, NavRun, Quantum, RigFacts, RigRun

log = logging.getLogger(__name__)

TRIPLES = ("gyro", "dtheta", "accel", "dv")
RIG_FORM = TableForm(
    numbers=(
        "time_s",
        "cycle",
        *(f"{name}_{axis}" for name in TRIPLES for axis in AXES),
        "temp_c",
        *(f"temp_{axis}_c" for axis in AXES),
        "rig_angle_rad",
    ),
    texts=("flag",),
    required=("time_s", "cycle"),
)

Axis = Literal["x", "y", "z"]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Density = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class QuantumTable(BaseModel):
    """The steps in which the readings are counted: of increments, or of readings rounded."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    gyro_rad: NotNegative = 0.0
    accel_m_s: NotNegative = 0.0
    gyro_rad_s: NotNegative = 0.0
    accel_m_s2: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        for counted, rounded in (("gyro_rad", "gyro_rad_s"), ("accel_m_s", "accel_m_s2")):
            if getattr(self, counted) and getattr(self, rounded):
                raise ValueError(f"{counted} and {rounded}: expected one of them")
        return self


class RigSidecar(BaseModel):
    """Sidecar of a recorded rig run: the site, and what is known of rig and sensors.

    `compensated_with` names the calibration that has been taken out of the readings.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    height_m: Annotated[float, Field(ge=-1000, le=20_000)]
    axis_of_cycle: tuple[Axis, ...] | None = None
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    azimuth_sigma_deg: Annotated[float, Field(gt=0, le=180)] = 1.0
    gyro_noise_deg_h_rthz: Density | None = None
    accel_noise_m_s2_rthz: Density | None = None
    angle_noise_arcsec_rthz: Density | None = None
    quantum: QuantumTable | None = None
    compensated_with: str | None = None

    @property
    def facts(self) -> RigFacts:
        """The same in SI units."""
        gyro, angle = self.gyro_noise_deg_h_rthz, self.angle_noise_arcsec_rthz
        azimuth = self.azimuth_deg
        return RigFacts(
            site=Site(lat_rad=float(np.deg2rad(self.latitude_deg)), height_m=self.height_m),
            axis_of_cycle=self.axis_of_cycle,
            azimuth_rad=None if azimuth is None else float(np.deg2rad(azimuth)),
            azimuth_sigma_rad=float(np.deg2rad(self.azimuth_sigma_deg)),
            gyro_noise=None if gyro is None else gyro * DEG_PER_H,
            accel_noise=self.accel_noise_m_s2_rthz,
            angle_noise=None if angle is None else angle * ARCSEC,
            quantum=Quantum() if self.quantum is None else Quantum(**self.quantum.model_dump()),
        )


class NavSidecar(RigSidecar):
    """Sidecar of a navigation-output run.

    `body_axes` says where x, y and z of the body point when roll, pitch and heading are zero:
    ahead is north then.
    """

    body_axes: BodyAxes = "right-forward-up"


SidecarKind = TypeVar("SidecarKind", bound=RigSidecar)


def read_rig_run(path: Path | str, *, physics: bool = True) -> RigRun:
    """Read a recorded rig run from CSV or Parquet (`*.parquet`, `*.pq`).

    Parameters
    ----------
    path : path
        The table; its sidecar NAME.toml lies beside it.
    physics : bool
        Whether the readings must also agree with gravity, the gyros with the forces, and the
        rig's angle with the gyros (see `sinscal.recording.check`), and what stands alone is mended
        (see `sinscal.recording.mend`).

    Returns
    -------
    RigRun
        Cycles are numbered from 0 in the order of the file; `warnings` tells what was bridged,
        split or flagged.

    Raises
    ------
    InputError
        Naming file and line of the first fault, or what contradicts physics.
    """
    path = Path(path)
    sidecar, raw = _read(path, RIG_FORM, RigSidecar)
    run = build_rig(raw, sidecar.facts, mend=physics)
    run = checked_rig(run) if physics else run
    _tell(path, run.warnings)
    return run


def read_nav_run(path: Path | str) -> NavRun:
    """Read a navigation-output run from CSV or Parquet.

    Raises
    ------
    InputError
        Naming file and line of the first fault.
    """
    path = Path(path)
    sidecar, raw = _read(path, NAV_FORM, NavSidecar)
    run = build_nav(raw, sidecar.facts, sidecar.body_axes)
    _tell(path, run.warnings)
    return run


def compensated_with(path: Path | str) -> str | None:
    """Return which calibration a recorded rig run is compensated with.

    Raises
    ------
    InputError
        If its sidecar cannot be read.
    """
    return read_toml(sidecar_path(Path(path)), RigSidecar).compensated_with


def write_rig_run(
    run: RigRun,
    path: Path | str,
    *,
    increments: bool = False,
    compensated_with: str | None = None,
) -> None:
    """Write a rig run to CSV or Parquet, by the path's suffix, and its sidecar NAME.toml.

    Numbers come back bit for bit but for units: degrees of the sidecar, and increments, are
    rounded once. Both files are complete or as they were before.

    Parameters
    ----------
    run : RigRun
    path : path
    increments : bool
        Write dtheta_* and dv_* (integrals over the step) in place of mean rates and forces.
    compensated_with : str, optional
        The calibration that has been taken out of the readings, for the sidecar.

    Raises
    ------
    InputError
        If the suffix is another or the files cannot be written.
    """
    table: dict[str, FloatArray] = {"time_s": run.time_s, "cycle": run.cycle.astype(float)}
    times = run.step_s[:, None] if increments else 1.0
    for name, values in zip(
        ("dtheta", "dv") if increments else ("gyro", "accel"), (run.gyro, run.accel), strict=True
    ):
        table |= _columns(f"{name}_{{}}", values * times)
    table |= _temperatures(run.temp_c)
    if run.rig_angle_rad is not None:
        table["rig_angle_rad"] = run.rig_angle_rad
    if np.any(run.flag):
        table["flag"] = np.asarray(run.flag)
    _write(table, run.facts, Path(path), compensated_with)


def write_nav_run(run: NavRun, path: Path | str) -> None:
    """Write a navigation-output run to CSV or Parquet, and its sidecar; body axes x right, y ahead.

    Raises
    ------
    InputError
        If the suffix is another or the files cannot be written.
    """
    angles = angles_from_c_nb(run.c_nb)
    table: dict[str, FloatArray] = {
        "time_s": run.time_s,
        "cycle": run.cycle.astype(float),
        "lat_deg": np.rad2deg(run.lat_rad),
        "lon_deg": np.rad2deg(run.lon_rad),
        "height_m": run.height_m,
        **{f"v{a}_m_s": run.velocity[:, k] for k, a in enumerate("enu")},
        **{
            f"{name}_deg": np.rad2deg(values)
            for name, values in zip(("roll", "pitch", "heading"), angles, strict=True)
        },
        **_temperatures(run.temp_c),
    }
    _write(table, run.facts, Path(path))


def _read(path: Path, form: TableForm, kind: type[SidecarKind]) -> tuple[SidecarKind, RawTable]:
    if not path.is_file():
        raise InputError(path, "", "no such file")
    side = sidecar_path(path)
    if side == path or not side.is_file():
        needed = "the keys latitude_deg and height_m"
        raise InputError(path, "", f"expected {side.name} beside it with {needed}")
    return read_toml(side, kind), read_table(path, form)


def _tell(path: Path, warnings: Sequence[str]) -> None:
    for text in warnings:
        log.warning("%s: %s", path, text)


def _columns(name: str, values: FloatArray) -> dict[str, FloatArray]:
    return {name.format(axis): values[:, k] for k, axis in enumerate(AXES)}


def _temperatures(temp_c: FloatArray | None) -> dict[str, FloatArray]:
    if temp_c is None:
        return {}
    if np.all(temp_c == temp_c[:, :1]):
        return {"temp_c": temp_c[:, 0]}
    return _columns("temp_{}_c", temp_c)


def _write(
    table: dict[str, FloatArray], facts: RigFacts, path: Path, compensated_with: str | None = None
) -> None:
    frame = pd.DataFrame(table)
    whole = [name for name in ("cycle", "flag") if name in frame.columns]
    frame[whole] = frame[whole].astype(np.int64)
    write_with_sidecar(frame, _sidecar_text(facts, compensated_with), path)


def _sidecar_text(facts: RigFacts, compensated_with: str | None) -> str:
    values: dict[str, float | None] = {
        "latitude_deg": float(np.rad2deg(facts.site.lat_rad)),
        "height_m": facts.site.height_m,
        "azimuth_deg": None if facts.azimuth_rad is None else float(np.rad2deg(facts.azimuth_rad)),
        "azimuth_sigma_deg": float(np.rad2deg(facts.azimuth_sigma_rad)),
        "gyro_noise_deg_h_rthz": _over(facts.gyro_noise, DEG_PER_H),
        "accel_noise_m_s2_rthz": facts.accel_noise,
        "angle_noise_arcsec_rthz": _over(facts.angle_noise, ARCSEC),
    }
    data: dict[str, Plain] = {n: float(value) for n, value in values.items() if value is not None}
    if facts.axis_of_cycle is not None:
        data["axis_of_cycle"] = facts.axis_of_cycle
    if compensated_with:
        data["compensated_with"] = compensated_with
    steps = {name: float(value) for name, value in asdict(facts.quantum).items() if value}
    return toml_text(data | ({"quantum": steps} if steps else {}))


def _over(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit
