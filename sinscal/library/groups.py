"""Groups of terms that a SINS's sensors and the rig's angle may have, and effects made of them.

Measured = true + error. Signals: `w_x … w_z` (rate of the body against inertial space, rad/s),
`dw_x … dw_z` (its derivative, rad/s²), `f_x … f_z` (specific force, m/s²), `x_c` (temperature of
the channel's own sensor less the reference temperature, °C), `elapsed_s` (since the run began);
for the angle `angle_rad` and its rate `turn_rad_s`. The axes of the accelerometers fix the body
frame: z's is free, and Γ is lower triangular, so that x's has no misalignment, y's one (from x) and
z's two.
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
# A motion that differs from the others by less than this share of its size tells nothing.
MIN_SHARE = 1e-6
TEMPERATURES = frozenset(["x_c", "x_slow_c", "rate_c_per_min"])
# The factors that innovations may follow, and effects live in.
PHASE, RATE, CYCLE, TIME, TEMPERATURE = (
    "rotation phase",
    "rate",
    "cycle",
    "time in run",
    "temperature",
)
# Warming by less than this tells nothing of temperature.
LEAST_WARMING_C = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelId:
    """Which sensor a term belongs to: its kind and its axis 0, 1, 2 (0 for the angle)."""

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
        Kinds of channel that it belongs to.
    make : callable
        Returns a channel's term, or None where the channel has none.
    prior_sigma : float
        How large its parameters are expected to be beforehand, SI.
    told : Told
        The unit people are told them in.
    family : str
        The group whose priors hold for it as well; by default itself.
    formula : str
        Its part of what a sensor measures, in the result file.
    signs : str
        What its parameters' indices and signs mean, in the result file.
    basic : bool
        Whether it is always estimated.

    Raises
    ------
    ValueError
        If nothing is expected of it: it would be estimated as 0 ± 0.
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
        """Return a channel's term, each parameter with what it belongs to and its prior."""
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
        """True when it shows in the rig's angle alone."""
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
        What it is.
    experiment : str
        What would isolate it.
    follows : str
        The factor that its error of the readings follows.
    needs : {"", "angle", "temperature"}
        What the recording must hold for it to show.
    step : str, optional
        The kind of sensor whose constant error jumps.
    drift : str, optional
        The kind of sensor whose constant error drifts slowly.
    prior_sigma : float, optional
        How large a drift is expected to be, SI; of all else the groups say it.
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
        """Tell whether a run holds what the effect needs to show."""
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
    return term_of(f"{c.kind}_misalignment_{c.letter}", "The sensitive axis is turned.", parts)


WARM = "repeat the programme once cold after a rest and once warm, with a thermistor per sensor"
