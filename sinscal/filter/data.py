"""Input of the rig filter: noise, measured cycles and linearisation point."""

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from sinscal.filter.integrate import interval_rows
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import rotation
from sinscal.model.motion import Motion
from sinscal.model.noise import DriftingNoise
from sinscal.recording.abrupt import abrupt_rows
from sinscal.recording.run import AXES, BoolArray, RigRun, rate_derivative
from sinscal.recording.shocks import violent_rows

# Where north is only sought, steps are put together up to so long and so much of a turn.
THIN_STEP_S = 0.1
THIN_TURN_RAD = 0.02
# A step's square over the variance of what is rounded to it, or of what a counter has left over.
COUNT = 12.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigNoise(DriftingNoise):
    """Noise as the filter takes it.

    Attributes
    ----------
    wobble : float, optional
        How much the rotation axis moves across itself, rad/√Hz; that of the angle if not given.
    """

    wobble: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CycleData:
    """One cycle as measured, ready to be integrated again and again."""

    measured: Motion
    good: BoolArray
    first: IntArray
    axis: int | None
    angle: FloatArray | None

    def thinned(self, interval_s: float) -> "CycleData":
        """Return the cycle with steps put together as far as little turns within one."""
        m = self.measured
        fastest = float(np.max(np.linalg.norm(m.w, axis=1), initial=1e-9))
        wanted_s = min(THIN_STEP_S, THIN_TURN_RAD / fastest)
        every = int(wanted_s / float(np.median(m.step_s)) + 1e-6)
        if every < 2:
            return self
        edges = np.arange(0, len(m), every)
        last = np.append(edges[1:], len(m)) - 1
        step_s = np.add.reduceat(m.step_s, edges)

        def mean(values: FloatArray) -> FloatArray:
            return np.add.reduceat(values * m.step_s[:, None], edges) / step_s[:, None]

        w = mean(m.w)
        motion = Motion(
            time_s=m.time_s[last], step_s=step_s, w=w, f=mean(m.f), dw=rate_derivative(w, step_s),
            temp_c=None if m.temp_c is None else mean(m.temp_c),
        )  # fmt: skip
        return replace(
            self,
            measured=motion,
            good=np.logical_and.reduceat(self.good, edges),
            first=interval_rows(motion.time_s, motion.step_s, interval_s),
            angle=None if self.angle is None else self.angle[last],
        )

    def beginning(self, intervals: int) -> "CycleData":
        """Return the cycle's first intervals, as many as there are up to `intervals`."""
        first = self.first[: intervals + 1]
        rows = slice(int(first[-1]))
        return replace(
            self,
            measured=self.measured.take(rows),
            good=self.good[rows],
            first=first,
            angle=None if self.angle is None else self.angle[rows],
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Nominal:
    """About what the filter linearises.

    Attributes
    ----------
    values : ndarray, shape (p,)
        Of the sensor model.
    c_start : tuple of ndarray, each (3, 3)
        Attitude at the start of each cycle.
    earth : tuple of ndarray, each (3,)
        The earth's rotation in the local axes of each cycle, rad/s.
    base : tuple of ndarray, each (3, 3)
        The platform's attitude at angle zero; empty without angle.
    mount : ndarray, shape (3,)
    remount : tuple of ndarray, each (3,)
    """

    values: FloatArray
    c_start: tuple[FloatArray, ...]
    earth: tuple[FloatArray, ...]
    base: tuple[FloatArray, ...] = ()
    mount: FloatArray
    remount: tuple[FloatArray, ...] = ()

    def improved(self, x: FloatArray, layout: RigLayout) -> "Nominal":
        """Return the nominal with a filter's estimate of its errors put right."""
        cycles = range(layout.cycles)
        starts = [rotation(x[layout.start(k)]) @ self.c_start[k] for k in cycles]
        changed = replace(self, values=self.values + x[layout.unknowns], c_start=tuple(starts))
        if layout.wander:
            more = [np.append(x[layout.earth_rate(k)], 0.0) for k in cycles]
            changed = replace(
                changed, earth=tuple(e + d for e, d in zip(self.earth, more, strict=True))
            )
        if layout.angle:
            bases = [rotation(x[layout.base(k)]) @ self.base[k] for k in cycles]
            changed = replace(changed, base=tuple(bases), mount=self.mount + x[layout.mount])
        if layout.angle and layout.remount:
            more = [self.remount[k] + x[layout.remounted(k)] for k in cycles]
            changed = replace(changed, remount=tuple(more))
        return changed


def unused_rows(run: RigRun, rows: slice) -> BoolArray:
    """Return which rows of a cycle measure nothing.

    They are flagged, the rate changes abruptly there, or the force is none that a rig makes.
    """
    flag = np.asarray(run.flag, dtype=np.bool_)[rows]
    violent = violent_rows(run.accel[rows], run.step_s[rows])
    return flag | abrupt_rows(run.gyro[rows]) | violent


def cycle_data(run: RigRun, interval_s: float) -> tuple[CycleData, ...]:
    """Cut a run into its cycles and these into intervals."""
    out: list[CycleData] = []
    begins_s = run.begin_of_cycle_s
    for k, rows in enumerate(run.cycles):
        step_s = run.step_s[rows]
        time_s = run.time_s[rows] - run.time_s[rows][0] + step_s[0]
        axes = run.facts.axis_of_cycle
        angle = None if run.rig_angle_rad is None else np.unwrap(run.rig_angle_rad[rows])
        out.append(
            CycleData(
                measured=Motion(
                    time_s=time_s,
                    step_s=step_s,
                    w=run.gyro[rows],
                    f=run.accel[rows],
                    dw=rate_derivative(run.gyro[rows], step_s),
                    temp_c=None if run.temp_c is None else run.temp_c[rows],
                    begin_s=begins_s[k],
                ),
                good=~unused_rows(run, rows),
                first=interval_rows(time_s, step_s, interval_s),
                axis=AXES.index(axes[k]) if axes else None,
                angle=angle,
            )
        )
    return tuple(out)
