"""Recording of a SINS on a rig: raw sensors (with or without the rig's angle), or its outputs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray, IntArray, freeze, readonly, readonly_int
from sinscal.frames.earth import Site

AXES = ("x", "y", "z")
BoolArray = NDArray[np.bool_]


def _slices(cycle: IntArray) -> tuple[slice, ...]:
    edges = np.flatnonzero(np.diff(cycle)) + 1
    bounds = pairwise([0, *edges.tolist(), cycle.size])
    return tuple(slice(a, b) for a, b in bounds if b > a)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantum:
    """The steps in which readings are counted; 0: none.

    A counter of increments carries what is less than a step into the next reading: its error is
    that of the whole angle or velocity, up to half a step at any time. Readings that are rounded
    one by one err by themselves.

    Attributes
    ----------
    gyro_rad, accel_m_s : float
        Of counters of increments.
    gyro_rad_s, accel_m_s2 : float
        Of readings that are rounded.
    """

    gyro_rad: float = 0.0
    accel_m_s: float = 0.0
    gyro_rad_s: float = 0.0
    accel_m_s2: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """Facts about the rig and the sensors beside the readings.

    Attributes
    ----------
    site : Site
    axis_of_cycle : tuple of str, optional
        The instrument axis along the rotation axis in each cycle, positive rate by its right hand.
    azimuth_rad, azimuth_sigma_rad : float
        Of the rotation axis from north clockwise; None when it is not known.
    gyro_noise, accel_noise, angle_noise : float, optional
        Densities of white noise: rad/s/√Hz, m/s²/√Hz, rad/√Hz. None when not known.
    quantum : Quantum
    """

    site: Site
    axis_of_cycle: tuple[str, ...] | None = None
    azimuth_rad: float | None = None
    azimuth_sigma_rad: float = np.pi / 180.0
    gyro_noise: float | None = None
    accel_noise: float | None = None
    angle_noise: float | None = None
    quantum: Quantum = Quantum()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigRun:
    """Raw readings of six sensors, n rows; rows of a cycle stand together.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        End of the row's step; increases within a cycle.
    step_s : ndarray, shape (n,)
        Length of the step that ends at `time_s`.
    cycle : ndarray of int, shape (n,)
        0, 1, …; between cycles the SINS may be re-mounted.
    gyro : ndarray, shape (n, 3)
        Mean measured rate over the step, rad/s.
    accel : ndarray, shape (n, 3)
        Mean measured specific force over the step, m/s².
    temp_c : ndarray, shape (n, 3), optional
        Temperature of accelerometers x, y, z.
    rig_angle_rad : ndarray, shape (n,), optional
        The platform's angle; in the row of time t it is that of t + τ.
    flag : ndarray of bool, shape (n,)
        Rows that must not be used as measurements (dropouts, saturation, known shocks).
    begins_s : tuple of float, optional
        When each cycle began, from the start of the whole run; by default as the times tell.
    facts : RigFacts
    source : str
    warnings : tuple of str
        What reading the files noticed.
    """

    time_s: FloatArray
    step_s: FloatArray
    cycle: IntArray
    gyro: FloatArray
    accel: FloatArray
    facts: RigFacts
    temp_c: FloatArray | None = None
    rig_angle_rad: FloatArray | None = None
    flag: BoolArray | None = None
    begins_s: tuple[float, ...] | None = None
    source: str = "the run"
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = np.size(self.time_s)
        flag = np.zeros(n, dtype=np.bool_) if self.flag is None else np.array(self.flag, bool)
        flag.flags.writeable = False
        freeze(
            self,
            time_s=readonly(self.time_s),
            step_s=readonly(self.step_s),
            cycle=readonly_int(self.cycle),
            gyro=readonly(self.gyro),
            accel=readonly(self.accel),
            temp_c=None if self.temp_c is None else readonly(self.temp_c),
            rig_angle_rad=None if self.rig_angle_rad is None else readonly(self.rig_angle_rad),
            flag=flag,
        )
        for name, width in (("gyro", 3), ("accel", 3), ("temp_c", 3)):
            array = getattr(self, name)
            if array is not None and array.shape != (n, width):
                raise ValueError(f"{name} has shape {array.shape}, expected ({n}, {width})")

    def __len__(self) -> int:
        return self.time_s.size

    @property
    def cycles(self) -> tuple[slice, ...]:
        """The rows of each cycle."""
        return _slices(self.cycle)

    @property
    def begin_of_cycle_s(self) -> tuple[float, ...]:
        """Begin of each cycle: times may go on from cycle to cycle or begin anew in each."""
        if self.begins_s is not None:
            return self.begins_s
        begins: list[float] = []
        now_s = 0.0
        for rows in self.cycles:
            begins.append(max(now_s, float(self.time_s[rows][0] - self.time_s[0])))
            length = self.time_s[rows][-1] - self.time_s[rows][0] + self.step_s[rows][0]
            now_s = begins[-1] + float(length)
        return tuple(begins)

    @property
    def length_s(self) -> float:
        """Length of the run from its start to the end of its last cycle."""
        last = self.cycles[-1]
        length_s = self.time_s[last][-1] - self.time_s[last][0] + self.step_s[last][0]
        return self.begin_of_cycle_s[-1] + float(length_s)

    def take_cycles(self, wanted: Sequence[int]) -> "RigRun":
        """Return some of the cycles as a run of their own, numbered anew."""
        slices = self.cycles
        begins = self.begin_of_cycle_s
        rows = np.concatenate([np.arange(len(self))[slices[k]] for k in wanted])
        axes = self.facts.axis_of_cycle
        kept = None if axes is None else tuple(axes[k] for k in wanted)
        facts = replace(self.facts, axis_of_cycle=kept)
        number = {old: new for new, old in enumerate(wanted)}
        flag = np.asarray(self.flag)
        return RigRun(
            time_s=self.time_s[rows],
            step_s=self.step_s[rows],
            cycle=np.array([number[int(c)] for c in self.cycle[rows]]),
            gyro=self.gyro[rows],
            accel=self.accel[rows],
            temp_c=None if self.temp_c is None else self.temp_c[rows],
            rig_angle_rad=None if self.rig_angle_rad is None else self.rig_angle_rad[rows],
            flag=flag[rows],
            begins_s=tuple(begins[k] for k in wanted),
            facts=facts,
            source=self.source,
            warnings=self.warnings,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavRun:
    """Output of a SINS in its navigation mode on the rig, n rows.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    cycle : ndarray of int, shape (n,)
    lat_rad, lon_rad, height_m : ndarray, shape (n,)
    velocity : ndarray, shape (n, 3)
        East, north, up, m/s.
    c_nb : ndarray, shape (n, 3, 3)
        The SINS's own attitude: takes body to east-north-up.
    temp_c : ndarray, shape (n, 3), optional
    facts : RigFacts
        `site` is the true position; its longitude is that of the first row.
    """

    time_s: FloatArray
    cycle: IntArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    velocity: FloatArray
    c_nb: FloatArray
    facts: RigFacts
    temp_c: FloatArray | None = None
    source: str = "the run"
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = ("time_s", "lat_rad", "lon_rad", "height_m", "velocity", "c_nb")
        freeze(
            self,
            cycle=readonly_int(self.cycle),
            temp_c=None if self.temp_c is None else readonly(self.temp_c),
            **{name: readonly(getattr(self, name)) for name in names},
        )

    def __len__(self) -> int:
        return self.time_s.size

    @property
    def cycles(self) -> tuple[slice, ...]:
        """The rows of each cycle."""
        return _slices(self.cycle)

    def take_cycles(self, wanted: Sequence[int]) -> "NavRun":
        """Return some of the cycles as a run of their own, numbered anew."""
        slices = self.cycles
        rows = np.concatenate([np.arange(len(self))[slices[k]] for k in wanted])
        number = {old: new for new, old in enumerate(wanted)}
        axes = self.facts.axis_of_cycle
        kept = None if axes is None else tuple(axes[k] for k in wanted)
        return replace(
            self,
            time_s=self.time_s[rows],
            cycle=np.array([number[int(c)] for c in self.cycle[rows]]),
            lat_rad=self.lat_rad[rows],
            lon_rad=self.lon_rad[rows],
            height_m=self.height_m[rows],
            velocity=self.velocity[rows],
            c_nb=self.c_nb[rows],
            temp_c=None if self.temp_c is None else self.temp_c[rows],
            facts=replace(self.facts, axis_of_cycle=kept),
        )


def rate_derivative(w: FloatArray, step_s: FloatArray) -> FloatArray:
    """Return the derivative of step-mean rates by central differences, shape (n, 3)."""
    if w.shape[0] < 3:
        return np.zeros_like(w)
    middle = np.cumsum(step_s) - 0.5 * step_s
    return np.gradient(w, middle, axis=0)
