"""Terms of the library as columns of a filter, reading by reading.

With gain·(1 + Σ s·S)·(a + Σ b·B) the output is linear in K1, K1·s and K1·b; the products of scale
and bias terms, some 1e-3 of either, are left out. Parameters are in units of their prior sigmas.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.model import Design, ErrorModel
from errormodel.record import Record
from thermo.library import term
from thermo.recording.runs import head_force_g
from thermo.recording.signals import (
    RATE_WINDOW_S,
    Conditions,
    emulated_columns,
    signals,
    signals_of,
    smooth_temperature,
)
from thermo.store.records import ReadingRow

# The terms that the fit finds in almost every accelerometer: the output's scale and bias,
# quadratic and cubic in temperature, the misalignment, and what goes with a_i² and a_i·a_p.
LIVE_TERMS = (
    "k1", "k1_t1", "k1_t2", "k0", "k0_t1", "k0_t2", "k0_t3", "delta_o", "k2", "k_ip",
)  # fmt: skip
SMOOTH = frozenset(["x_slow_c", "rate_c_per_min"])


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveReading:
    """The conditions of one reading; `own_deg` is the accelerometer's own angle."""

    time_s: float
    temp_c: float
    position_deg: float
    own_deg: float
    recorded: Mapping[str, float] = field(default_factory=dict[str, float])

    @classmethod
    def of(cls, row: ReadingRow, mount_deg: float) -> "LiveReading | None":
        """Return a row's conditions; None where it has a flag or lacks one of them."""
        if row.flag or row.temp_c is None or row.position_deg is None:
            return None
        if not np.isfinite(row.temp_c + row.position_deg):
            return None
        given = {"chamber_c": row.chamber_c, **row.signals}
        return cls(
            time_s=row.time_s,
            temp_c=row.temp_c,
            position_deg=row.position_deg,
            own_deg=row.position_deg + mount_deg,
            recorded={n: v for n, v in given.items() if v is not None and np.isfinite(v)},
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LiveModel:
    """Terms with their memory and that of the smoothed temperature in the current run.

    Attributes
    ----------
    model : ErrorModel
    values : mapping of str to float
        Of nonlinear parameters, among others.
    sigmas : ndarray, shape (p,)
        Prior sigmas, in the order of the model's coefficients.
    t_ref_c : float
    memory : mapping, optional
        Of the terms.
    past : tuple of (float, float)
        Times and temperatures of the last readings.
    ended_h : float
        Length of the runs before this one.
    """

    model: ErrorModel
    values: Mapping[str, float]
    sigmas: FloatArray
    t_ref_c: float
    memory: Mapping[str, Any] | None = None
    past: tuple[tuple[float, float], ...] = ()
    ended_h: float = 0.0

    @classmethod
    def of(cls, terms: Sequence[str], *, start: Mapping[str, float], t_ref_c: float) -> "LiveModel":
        """Return the model of some terms before any reading; errors as of `LiveEstimate`."""
        model = ErrorModel(tuple(term(name) for name in terms))
        for name in ("k0", "k1"):
            if name not in model.names:
                raise ValueError(f"a live estimate needs the term {name}")
        sigmas: list[float] = []
        for one in model.coefficients:
            if one.prior_sigma is None:
                raise ValueError(f"{one.name} has no prior sigma: a live estimate needs one")
            sigmas.append(one.prior_sigma)
        values = {**model.start_values(), **start}
        return cls(model=model, values=values, sigmas=np.array(sigmas), t_ref_c=t_ref_c)

    @property
    def prior(self) -> FloatArray:
        """The coefficients of an ideal accelerometer, in prior sigmas."""
        ideal = self.model.start_values()
        return np.array([ideal[c.name] for c in self.model.coefficients]) / self.sigmas

    def new_run(self) -> "LiveModel":
        """Return the model at the start of another run, which follows the last at once."""
        length_h = self.past[-1][0] / 3600.0 if self.past else 0.0
        return replace(self, memory=None, past=(), ended_h=self.ended_h + length_h)

    def knows(self, at: LiveReading) -> bool:
        """Return True if a reading has all signals that the terms need."""
        return self.model.needs <= set(self._record(at, (at.temp_c, 0.0)).signals)

    def step(self, at: LiveReading) -> tuple[FloatArray, "LiveModel"]:
        """Return a reading's columns, shape (p,), and the model after it."""
        past = (*self.past, (at.time_s, at.temp_c))
        past = tuple(p for p in past if at.time_s - p[0] <= RATE_WINDOW_S) or past[-1:]
        record = self._record(at, self._smooth(past))
        design, memory = self.model.design(record, self.values, self.memory)
        return self.sigmas * _columns(design), replace(self, memory=memory, past=past)

    def k0_k1_rows(self, at: LiveReading) -> tuple[FloatArray, FloatArray]:
        """Return the columns of bias and scale at the temperature of a reading, each (p,).

        The force and the rate of temperature are zero, and loops are at their middle.
        """
        record = self._record(at, (at.temp_c, 0.0))
        still = record.with_signals(**{n: np.zeros(1) for n in ("a_i_g", "a_p_g", "a_o_g")})
        design, _ = self.model.design(still, self.values)
        bias = _columns(design)
        bias[: 1 + design.scale.shape[1]] = 0.0
        scale = np.zeros(bias.size)
        scale[0], scale[1 : 1 + design.scale.shape[1]] = 1.0, design.scale[0]
        return self.sigmas * bias, self.sigmas * scale

    def parameters(self, values: FloatArray, cov: FloatArray) -> dict[str, tuple[float, float]]:
        """Return the model's coefficients and sigmas by name: the linear ones over K1."""
        own, sigmas = values * self.sigmas, np.sqrt(np.diag(cov)) * self.sigmas
        names = [c.name for c in self.model.coefficients]
        over = np.where(np.array(names) == "k1", 1.0, own[names.index("k1")])
        pairs = zip((own / over).tolist(), (sigmas / np.abs(over)).tolist(), strict=True)
        return dict(zip(names, pairs, strict=True))

    def trial(self, time_s: float) -> LiveReading:
        """Return a reading at the reference temperature."""
        at = LiveReading(time_s=time_s, temp_c=self.t_ref_c, position_deg=0.0, own_deg=0.0)
        made = emulated_columns(self._conditions(at, (at.temp_c, 0.0)))
        recorded = {one.name: 0.0 for one in signals() if one.make is None}
        return replace(at, recorded=recorded | {name: float(v[0]) for name, v in made.items()})

    def _smooth(self, past: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Return the smooth temperature and its rate now, by the readings so far."""
        time_s, temp_c = np.array(past).T
        if not self.model.needs & SMOOTH:
            return float(temp_c[-1]), 0.0
        slow, rate = smooth_temperature(time_s, temp_c, np.zeros(len(past), dtype=np.intp))
        return float(slow[-1]), float(rate[-1])

    def _conditions(self, at: LiveReading, smooth: tuple[float, float]) -> Conditions:
        force = head_force_g(np.array([at.own_deg]))
        return Conditions(
            time_s=np.array([at.time_s]),
            run=np.zeros(1, dtype=np.intp),
            temp_c=np.array([at.temp_c]),
            position_deg=np.array([at.position_deg]),
            force_g=(force[:, 0], force[:, 1], force[:, 2]),
            elapsed_h=np.array([self.ended_h + at.time_s / 3600.0]),
            t_ref_c=self.t_ref_c,
            columns={name: np.array([value]) for name, value in at.recorded.items()},
            known_slow=(np.array([smooth[0]]), np.array([smooth[1]])),
            known_mounting=0.0,
        )

    def _record(self, at: LiveReading, smooth: tuple[float, float]) -> Record:
        conditions = self._conditions(at, smooth)
        return Record(time_s=conditions.time_s, signals=signals_of(conditions))


def _columns(design: Design) -> FloatArray:
    """Return the derivative of one reading's output by K1, K1·s and K1·b, shape (p,)."""
    return np.concatenate([design.base, design.base * design.scale[0], design.input[0]])
