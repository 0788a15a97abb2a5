"""Groups of terms of the SINS sensors and of the rig angle, and effects built from them.

Measured = true + error. Signals: `w_x … w_z` (rate of the body against inertial space, rad/s),
`dw_x … dw_z` (its derivative, rad/s²), `f_x … f_z` (specific force, m/s²), `x_c` (temperature of
the channel's own sensor less the reference temperature, °C), `elapsed_s` (since the run began);
for the angle `angle_rad` and its rate `turn_rad_s`. The accelerometer axes define the body frame. Γ
is lower triangular, so the x axis has no misalignment, the y axis one (from x) and the z axis two.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Coefficient, Description, Term, Told, memoryless
from sinscal.recording.run import AXES, RigRun

Kind = Literal["gyro", "accel", "angle"]
# A motion that differs from the others by less than this share gives no information.
MIN_SHARE = 1e-6
TEMPERATURES = frozenset(["x_c", "x_slow_c", "rate_c_per_min"])
# The factors that innovations and effects may follow.
PHASE, RATE, CYCLE, TIME, TEMPERATURE = (
    "rotation phase",
    "rate",
    "cycle",
    "time in run",
    "temperature",
)
# Smaller temperature changes give no information on temperature effects.
LEAST_WARMING_C = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelId:
    """The sensor of a term: its kind and its axis 0, 1, 2 (0 for the angle)."""

    kind: Kind
    axis: int

    @property
    def letter(self) -> str:
        """The axis's name."""
        return AXES[self.axis]

    @property
    def input(self) -> str:
        """The signal along the sensor's own axis."""
        return f"{'w' if self.kind == 'gyro' else 'f'}_{self.letter}"


CHANNELS = tuple(ChannelId(kind=kind, axis=axis) for kind in ("gyro", "accel") for axis in range(3))
ANGLE = ChannelId(kind="angle", axis=0)
ALL_CHANNELS = (*CHANNELS, ANGLE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Terms of one physical quantity, one in each channel that has it.

    Attributes
    ----------
    name : str
    kinds : tuple of str
        Kinds of channel that have it.
    make : callable
        Returns the term of a channel, or None if the channel has none.
    prior_sigma : float
        Prior sigma of its parameters, SI.
    told : Told
        Reported unit of its parameters.
    family : str
        The group whose priors hold for it as well; by default itself.
    formula : str
        Its part of the measurement formula in the result file.
    signs : str
        Meaning of the indices and signs of its parameters, in the result file.
    basic : bool
        True if it is always estimated.

    Raises
    ------
    ValueError
        If it has no prior sigma: it would be estimated as 0 ± 0.
    """

    name: str
    kinds: tuple[Kind, ...]
    make: Callable[[ChannelId], Term | None]
    prior_sigma: float
    told: Told
    family: str = ""
    formula: str = ""
    signs: str = ""
    basic: bool = False

    def __post_init__(self) -> None:
        if not self.prior_sigma > 0.0:
            raise ValueError(f"group without a prior: {self.name}; expected prior_sigma > 0")

    def term(self, channel: ChannelId) -> Term | None:
        """Return the term of a channel; each parameter has its group, axis and prior."""
        made = self.make(channel) if channel.kind in self.kinds else None
        if made is None:
            return None
        described = tuple(
            replace(
                c,
                family=self.family or self.name,
                group=self.name,
                axis="" if channel.kind == "angle" else channel.letter,
                prior_sigma=self.prior_sigma if c.prior_sigma is None else c.prior_sigma,
                told=c.told or self.told,
            )
            for c in made.coefficients
        )
        return replace(made, coefficients=described)

    @property
    def needs_angle(self) -> bool:
        """True if it appears in the rig angle only."""
        return self.kinds == ("angle",)

    @property
    def needs_temperature(self) -> bool:
        """True when it needs the sensors' temperatures."""
        made = (self.term(channel) for channel in ALL_CHANNELS)
        return any(term.needs & TEMPERATURES for term in made if term is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigEffect:
    """An effect that may be missing from the rig filter's model.

    Attributes
    ----------
    name : str
    groups : tuple of str
        Groups that it adds; none for a step, a drift and the mounting.
    sentence : str
        Physical description.
    experiment : str
        Experiment that would isolate it.
    follows : str
        The factor that its error of the readings follows.
    needs : {"", "angle", "temperature"}
        Data that the recording must contain.
    step : str, optional
        The kind of sensor with a step of the constant error.
    drift : str, optional
        The kind of sensor with a slow drift of the constant error.
    prior_sigma : float, optional
        Prior sigma of a drift, SI; for all other effects the groups define it.
    """

    name: str
    groups: tuple[str, ...] = ()
    sentence: str
    experiment: str
    follows: str
    needs: str = ""
    step: Kind | None = None
    drift: Kind | None = None
    prior_sigma: float | None = None

    def recorded(self, run: RigRun, *, angle: bool) -> bool:
        """Return True if a run has the data that the effect needs."""
        if self.needs == "angle":
            return angle
        if self.needs == "temperature":
            temp_c = run.temp_c
            return temp_c is not None and float(temp_c.max() - temp_c.min()) > LEAST_WARMING_C
        return True

    def owns(self, one: Description) -> bool:
        """Return whether a parameter belongs to the effect."""
        return one.group in (self.groups or (self.name,))

    @property
    def constant_error(self) -> str:
        """The group of the constant errors that a step or a drift changes."""
        return f"{self.step or self.drift}_bias"


def effect_of(
    group: Group, sentence: str, experiment: str, follows: str, *, needs: str = ""
) -> RigEffect:
    """Return the effect that is one group, by the group's name."""
    return RigEffect(
        name=group.name,
        groups=(group.name,),
        sentence=sentence,
        experiment=experiment,
        follows=follows,
        needs=needs,
    )


def term_of(
    name: str, sentence: str, parts: Sequence[tuple[str, str, str, Callable[[Record], FloatArray]]]
) -> Term:
    """Return a term of input columns; each part is (name, symbol, unit, column)."""
    coefficients = tuple(
        Coefficient(name=n, symbol=s, unit=u, min_share=MIN_SHARE) for n, s, u, _ in parts
    )

    def columns(record: Record) -> FloatArray:
        # each column in one piece of memory: a run has hundreds of thousands of rows
        return np.array([column(record) for *_, column in parts]).T

    return Term(
        name=name,
        sentence=sentence,
        place="input",
        coefficients=coefficients,
        columns=memoryless(columns),
    )


def needing(term: Term, *signals: str) -> Term:
    """Return a term that needs signals beyond those that every channel has."""
    return replace(term, needs=frozenset(signals))


def signal(name: str) -> Callable[[Record], FloatArray]:
    """Return the column of a signal."""
    return lambda r: r[name]


def ones(record: Record) -> FloatArray:
    """Return the column of a constant error."""
    return np.ones(len(record))


def constant_error(c: ChannelId) -> Term:
    """Return a sensor's constant error."""
    symbol, unit = (f"ν{c.letter}", "rad/s") if c.kind == "gyro" else (f"Δf{c.letter}", "m/s²")
    name = f"{c.kind}_bias_{c.letter}"
    return term_of(name, "A constant error.", [(name, symbol, unit, ones)])


def scale(c: ChannelId) -> Term:
    """Return a sensor's error proportional to its input."""
    symbol = ("Θ" if c.kind == "gyro" else "Γ") + 2 * c.letter
    name = f"{c.kind}_scale_{c.letter}"
    return term_of(
        name, "An error proportional to the input.", [(name, symbol, "1", signal(c.input))]
    )


def bias_by_temperature(name: str, symbol: str, unit: str) -> Callable[[ChannelId], Term]:
    """Return the maker of a constant error's change with temperature."""

    def make(c: ChannelId) -> Term:
        own = f"{name}_{c.letter}"
        part = (own, f"{symbol}{c.letter}", unit, signal("x_c"))
        return needing(term_of(own, "The constant error changes with temperature.", [part]), "x_c")

    return make


def misalignment(c: ChannelId) -> Term | None:
    """Return the turns of a sensor's sensitive axis."""
    others = range(3) if c.kind == "gyro" else range(c.axis)
    parts = [
        (
            f"{c.kind}_misalignment_{c.letter}{AXES[j]}",
            f"{'Θ' if c.kind == 'gyro' else 'Γ'}{c.letter}{AXES[j]}",
            "rad",
            signal(ChannelId(kind=c.kind, axis=j).input),
        )
        for j in others
        if j != c.axis
    ]
    if not parts:
        return None
    return term_of(f"{c.kind}_misalignment_{c.letter}", "The sensitive axis is misaligned.", parts)


WARM = "repeat the programme once cold after a rest and once warm, with a thermistor per sensor"
