"""The sensors of a SINS as one model: seven channels, each an `ErrorModel` of named terms.

The same object simulates (`measured`), compensates (`corrected`, its inverse) and gives the filter
its columns (`columns`). A channel's model may count in another unit than SI: a chamber's model of
an accelerometer counts in g and stands here unchanged, as terms of that channel.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.constants import T_REF_C
from errormodel.model import ErrorModel
from errormodel.record import Record
from errormodel.terms import Description
from sinscal.frames.earth import STANDARD_G
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import TIME_OFFSET
from sinscal.library.groups import ANGLE, CHANNELS, TEMPERATURES, ChannelId, Group
from sinscal.model.motion import Motion, moved_to
from sinscal.recording.run import AXES

# A chamber's terms see temperature smoothed as in the chamber; a rig's temperature is smooth.
RATE_WINDOW_S = 120.0
# What a chamber's terms may use on a rig, beside the sensors' own signals.
CHAMBER_SIGNALS = TEMPERATURES | {"a_i_g", "a_p_g", "a_o_g"}
# What is not linear is 1e-3 of the motion at most: each step of the inverse leaves less of it.
INVERSE_STEPS = 6
LEFT = 1e-12  # m/s² of what is measured, where the inverse ends
LEFT_WEIGHTS = np.array([100.0, 100.0, 100.0, 1.0, 1.0, 1.0])  # rates are to be had a digit better
# Slow enough that what goes with the square of the rate is nothing beside what goes with the rate.
TRIAL_RATE_RAD_S = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorChannel:
    """One sensor: which, its model, and how many SI units the model's unit is."""

    id: ChannelId
    model: ErrorModel
    unit: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorModel:
    """Six channels, gyros x, y, z and accelerometers x, y, z, and the rig's angle as the seventh.

    Attributes
    ----------
    channels : tuple of SensorChannel
    t_ref_c : float
        Reference temperature of all terms, °C.
    gravity_m_s2 : float
        The g of models that count in it.
    """

    channels: tuple[SensorChannel, ...]
    t_ref_c: float = T_REF_C
    gravity_m_s2: float = STANDARD_G

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns, channel after channel: the order of every vector and matrix."""
        return tuple(name for c in self.channels for name in c.model.names)

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Indices of each channel's parameters among `names`."""
        edges = np.cumsum([0, *(len(c.model.names) for c in self.channels)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(edges))

    @cached_property
    def owner(self) -> tuple[int, ...]:
        """The index of the channel of each unknown."""
        return tuple(i for i, c in enumerate(self.channels) for _ in c.model.names)

    @cached_property
    def parameters(self) -> dict[str, Description]:
        """Description of each parameter, in the order of `names`."""
        return {
            u.name: u for c in self.channels for u in (*c.model.coefficients, *c.model.parameters)
        }

    @property
    def units(self) -> dict[str, str]:
        """The unit each parameter is counted in."""
        return {name: one.unit for name, one in self.parameters.items()}

    @property
    def needs_temperature(self) -> bool:
        """True when some channel's errors depend on its temperature."""
        return any(c.model.needs & TEMPERATURES for c in self.channels)

    def start_values(self) -> FloatArray:
        """Return the unknowns of ideal sensors, shape (p,)."""
        values: dict[str, float] = {}
        for c in self.channels:
            values.update(c.model.start_values())
        return np.array([values[name] for name in self.names])

    def with_channel(self, axis: int, model: ErrorModel, unit: float) -> "SensorModel":
        """Return the sensors with another model of accelerometer `axis`."""
        wanted = ChannelId(kind="accel", axis=axis)
        changed = [
            SensorChannel(id=c.id, model=model, unit=unit) if c.id == wanted else c
            for c in self.channels
        ]
        return replace(self, channels=tuple(changed))

    def errors(self, motion: Motion, values: FloatArray) -> FloatArray:
        """Compute measured minus true of the six sensors, SI, shape (n, 6)."""
        rows = np.empty((6, len(motion)))  # what concerns a sensor is in one piece of memory
        for k, (c, record) in enumerate(self._records(motion)):
            mine = dict(zip(c.model.names, values[self.places[k]].tolist(), strict=True))
            rows[k] = c.unit * (c.model.simulate(record, mine) - record[c.model.base])
        return rows.T

    def measured(self, motion: Motion, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what sensors without noise measure: rates and forces, each (n, 3)."""
        errors = self.errors(motion, values)
        return motion.w + errors[:, :3], motion.f + errors[:, 3:]

    def corrected(self, motion: Motion, values: FloatArray) -> Motion:
        """Return the true motion behind measured rates and forces: the inverse of `measured`.

        Newton's steps with the slope at rest: what is linear, most of all errors, takes one. Each
        step leaves about the same share of what it found, and the last is not looked at again.
        """
        inverse, offset = self.at_rest(motion, values)
        measured = np.array([*motion.w.T, *motion.f.T])
        now = inverse @ (measured - offset[:, None])
        true = moved_to(motion, now)
        before = 0.0
        for _ in range(INVERSE_STEPS):
            left = measured - now - self.errors(true, values).T
            size = float(np.max(np.abs(left).max(axis=1, initial=0.0) * LEFT_WEIGHTS))
            if size < LEFT:
                break
            now = now + inverse @ left
            true = moved_to(motion, now)
            if before and size * size / before < LEFT:
                break
            before = size
        return true

    def columns(self, motion: Motion, values: FloatArray) -> FloatArray:
        """Return the derivative of each unknown's own channel by it, SI, shape (n, p of six).

        Each column is in one piece of memory.
        """
        rows = np.empty((self.places[5].stop, len(motion)))
        for k, (c, record) in enumerate(self._records(motion)):
            mine = dict(zip(c.model.names, values[self.places[k]].tolist(), strict=True))
            rows[self.places[k]] = derivative(c.model, record, mine).T
            if c.unit != 1.0:
                rows[self.places[k]] *= c.unit
        return rows.T

    def angle_columns(self, angle: FloatArray, turn: FloatArray) -> FloatArray:
        """Return the derivative of the measured angle by its unknowns, shape (n, p of angle)."""
        model = self.channels[6].model
        return derivative(model, _angle_record(angle, turn), model.start_values())

    def true_angle(
        self, time_s: FloatArray, angle: FloatArray, turn: FloatArray, values: FloatArray
    ) -> FloatArray:
        """Return the angle behind measured ones, rad, shape (n,): the inverse of its channel.

        An offset of the clock is undone by shifting the record, so that it holds through
        reversals; beyond its ends the angle goes on at its last rate.
        """
        mine = dict(zip(self.channels[6].model.names, values[self.places[6]].tolist(), strict=True))
        offset = mine.get(TIME_OFFSET, 0.0)
        if offset:
            at = time_s - offset
            inside = np.clip(at, time_s[0], time_s[-1])
            between = cast(FloatArray, np.interp(inside, time_s, angle))
            angle = between + (at - inside) * ends_of(turn, at < time_s[0])
        model = self.channels[6].model
        record = _angle_record(angle, turn)
        return angle - (model.simulate(record, {**mine, TIME_OFFSET: 0.0}) - angle)

    def angle_error(self, angle: FloatArray, turn: FloatArray, values: FloatArray) -> FloatArray:
        """Compute measured minus true angle to first order, rad, shape (n,)."""
        model = self.channels[6].model
        mine = dict(zip(model.names, values[self.places[6]].tolist(), strict=True))
        return model.simulate(_angle_record(angle, turn), mine) - angle

    def at_rest(self, motion: Motion, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the inverse of measured by true, (6, 6), and the errors without any motion, (6,).

        By seven trial motions, so small that only what is linear shows.
        """
        trial_w, trial_f = np.zeros((7, 3)), np.zeros((7, 3))
        trial_w[1:4] = TRIAL_RATE_RAD_S * np.eye(3)
        trial_f[4:] = np.eye(3)
        temp_c = None if motion.temp_c is None else np.tile(motion.temp_c[:1], (7, 1))
        trial = Motion(
            time_s=np.arange(1.0, 8.0),
            step_s=np.ones(7),
            w=trial_w,
            f=trial_f,
            dw=np.zeros((7, 3)),
            temp_c=temp_c,
        )
        errors = self.errors(trial, values)
        slope = (errors[1:] - errors[0]).T
        slope[:, :3] /= TRIAL_RATE_RAD_S
        return cast(FloatArray, np.linalg.inv(np.eye(6) + slope)), errors[0]

    def _records(self, motion: Motion) -> Iterator[tuple[SensorChannel, Record]]:
        """Yield the six sensors' channels, each with what acts on it."""
        signals = {f"w_{a}": motion.w[:, j] for j, a in enumerate(AXES)}
        signals |= {f"f_{a}": motion.f[:, j] for j, a in enumerate(AXES)}
        signals |= {f"dw_{a}": motion.dw[:, j] for j, a in enumerate(AXES)}
        shared = Record(time_s=motion.time_s, signals=signals)
        for c in self.channels[:6]:
            own = self._own_signals(motion, c)
            yield c, (shared.with_signals(**own) if own else shared)

    def _own_signals(self, motion: Motion, channel: SensorChannel) -> dict[str, FloatArray]:
        own: dict[str, FloatArray] = {}
        axis = channel.id.axis
        i, p, o = (axis + np.arange(3)) % 3
        for name, j in (("a_i_g", i), ("a_p_g", p), ("a_o_g", o)):
            if name in channel.model.needs:
                own[name] = motion.f[:, j] / self.gravity_m_s2
        if "elapsed_s" in channel.model.needs:
            own["elapsed_s"] = motion.begin_s + motion.time_s
        if motion.temp_c is not None:
            x = motion.temp_c[:, axis] - self.t_ref_c
            own["x_c"] = own["x_slow_c"] = x
            if "rate_c_per_min" in channel.model.needs:
                own["rate_c_per_min"] = _slope(motion.time_s, x) * 60.0
        return own


def ends_of(values: FloatArray, at_start: NDArray[np.bool_]) -> FloatArray:
    """Return the first or the last of some values, by a mask, in its shape."""
    return values[np.asarray(~at_start, dtype=np.intp) * (values.size - 1)]


def _angle_record(angle: FloatArray, turn: FloatArray) -> Record:
    signals = {"angle_rad": angle, "turn_rad_s": turn}
    return Record(time_s=np.arange(1.0, angle.size + 1.0), signals=signals)


def _slope(time_s: FloatArray, x: FloatArray) -> FloatArray:
    """Return the slope of x over `RATE_WINDOW_S`, per second."""
    if time_s.size < 3:
        return np.zeros_like(x)
    half = 0.5 * RATE_WINDOW_S
    later = np.minimum(time_s + half, time_s[-1])
    earlier = np.maximum(time_s - half, time_s[0])
    return (np.interp(later, time_s, x) - np.interp(earlier, time_s, x)) / (later - earlier)


def sensor_model(
    groups: Sequence[str] = BASIC,
    *,
    more: Sequence[Group] = (),
    t_ref_c: float = T_REF_C,
    gravity_m_s2: float = STANDARD_G,
) -> SensorModel:
    """Make a model of the groups named (of the library in use) and of `more`.

    Raises
    ------
    KeyError
        If there is no such group.
    """
    terms_of = rig_library().terms_of
    made = [
        SensorChannel(id=c, model=ErrorModel(terms_of(c, groups, more), c.input)) for c in CHANNELS
    ]
    made.append(
        SensorChannel(id=ANGLE, model=ErrorModel(terms_of(ANGLE, groups, more), "angle_rad"))
    )
    return SensorModel(channels=tuple(made), t_ref_c=t_ref_c, gravity_m_s2=gravity_m_s2)


def as_vector(model: SensorModel, values: Mapping[str, float]) -> FloatArray:
    """Return named values in the order of a model; what is not named is that of ideal sensors.

    Raises
    ------
    KeyError
        If a name is not the model's.
    """
    unknown = [name for name in values if name not in model.names]
    if unknown:
        raise KeyError(f"{', '.join(unknown)}: not in the model")
    out = model.start_values()
    for name, value in values.items():
        out[model.names.index(name)] = value
    return out
