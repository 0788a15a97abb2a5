"""Building blocks of the library files: short definitions of terms and effects.

An effect is a named physical cause, made of terms of the library. It may have more than one form:
the first is tried together with other effects, a more flexible one if the first was selected.

Signals: `a_i_g`, `a_p_g`, `a_o_g` (specific force along IA, PA, OA in local g, OA = IA × PA),
`x_c` (temperature less the reference temperature, °C), `x_slow_c` (the same without the
thermistor's noise), `rate_c_per_min`, `elapsed_h` (hours since the first run began), `head_deg`,
`mounting`, and what `thermo.recording.signals` adds. The model's unit is g at the input.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.model import ErrorModel
from errormodel.record import Record
from errormodel.terms import Coefficient, Effect, Place, Term, memoryless

Grid = tuple[tuple[float, ...], ...]
Cause = Literal["accelerometer", "head", "chamber", "digitiser", "run"]
MICRO = 1e6  # coefficients are reported in millionths
# The angles of an unknown head are known to some 1e-4 rad at best, so a difference of less than ten
# times that between positions does not separate position-dependent coefficients.
POSITION_SHARE = 1e-3
# Columns of time and of the head may be equal over a run except for this share.
EVENT_SHARE = 1e-3
# Prior sigmas, wider than any accelerometer: 50 mg of bias, 5 % of scale factor, 50 mrad over ±50
# °C.
WIDE = 0.05
WIDE_C = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """One form of an effect: its terms and the grid of their nonlinear parameters.

    `parameters` are the names of the nonlinear parameters in the order of the grid's points.
    `smooth` is False when the output does not change smoothly with them (the instant of a step).
    """

    terms: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    grid: Grid = ((),)
    smooth: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """An effect of ordinary size for an emulated accelerometer.

    Attributes
    ----------
    term : str
        Term of the library; empty for offsets between power-ons, which are drawn.
    values : mapping of str to float
        Its coefficients and parameters, in the model's unit (g, °C, s).
    turn_on_ug : float
        Sigma of the offset that each power-on draws.
    """

    term: str = ""
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    turn_on_ug: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalEffect:
    """A named effect.

    Attributes
    ----------
    name : str
        Name in the verdict.
    sentence : str
        Physical description; `{size}` is replaced by the estimated size.
    forms : callable
        Given the model and the runs' hours, the forms that may be added, the plain one first; an
        empty sequence if the model already has the effect.
    experiment : str
        Description of the experiment that isolates it.
    event : bool
        True if it belongs to one run or one time: a new run will not repeat it.
    cause : str
        Its cause. An effect of the head, the chamber or the digitiser is equal in all
        accelerometers that shared it; an effect of a run may occur in several at one time.
    example : Example, optional
        Its size in an accelerometer that passes its data sheet all the same; None where the
        emulator cannot give it to one accelerometer alone.
    changes : str
        Term of the model that it changes over temperature; without that term there is nothing to
        change.
    """

    name: str
    sentence: str
    forms: Callable[["Context"], Sequence[Form]]
    experiment: str
    event: bool = False
    cause: Cause = "accelerometer"
    example: Example | None = None
    changes: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """Context on which the forms of an effect depend."""

    model: ErrorModel
    runs: int
    run_s: float
    hours: float
    step_times_h: tuple[float, ...] = ()
    x_range_c: tuple[float, float] = (0.0, 0.0)
    term_names: frozenset[str] = field(default=frozenset())


def context_of(
    model: ErrorModel,
    runs: int,
    run_s: float,
    hours: float,
    steps: Sequence[float],
    x_range_c: tuple[float, float] = (-50.0, 50.0),
) -> Context:
    """Return the context of a model on some runs.

    Parameters
    ----------
    model : ErrorModel
    runs : int
        Their number.
    run_s, hours : float
        Length of the longest run, s; from the first reading to the last, h.
    steps : sequence of float
        Times at which a step is tried, h.
    x_range_c : (float, float)
        Range of temperature less the reference temperature, °C.
    """
    return Context(
        model=model,
        runs=runs,
        run_s=run_s,
        hours=hours,
        step_times_h=tuple(steps),
        x_range_c=x_range_c,
        term_names=frozenset(t.name for t in model.terms),
    )


def log_grid(lo: float, hi: float, count: int) -> Grid:
    """Return points of one nonlinear parameter, evenly spaced in its logarithm."""
    return tuple((float(v),) for v in np.geomspace(lo, hi, count))


def plain_form(*terms: str) -> Callable[[Context], Sequence[Form]]:
    """Return the form of terms without nonlinear parameters, those that the model lacks."""

    def forms(at: Context) -> Sequence[Form]:
        missing = tuple(t for t in terms if t not in at.term_names)
        return [Form(terms=missing)] if missing else []

    return forms


def one_column(
    name: str,
    *,
    symbol: str,
    unit: str,
    sentence: str,
    column: Callable[[Record], FloatArray],
    place: Place = "input",
    needs: Sequence[str] = (),
    family: str = "",
    order: int = 0,
    label: str = "",
    prior_sigma: float = WIDE,
    min_share: float = 1e-6,
    predictive: bool = True,
) -> Term:
    """Return a term of one coefficient, reported in millionths, without memory.

    Parameters
    ----------
    name : str
        Name of term and coefficient.
    symbol, unit : str
        The unit in which the coefficient is reported.
    sentence : str
        Physical description.
    column : callable
        Function of a record that returns the regressor, shape (n,).
    place : {"input", "scale", "gain"}
    needs : sequence of str
        Signals.
    family, order, label : str, int, str
        As in `errormodel.terms.Description`.
    prior_sigma : float
        In the model's unit.
    min_share : float
    predictive : bool
    """
    coefficient = millionths(
        name,
        symbol,
        unit,
        family=family,
        order=order,
        label=label,
        prior_sigma=prior_sigma,
        min_share=min_share,
    )
    return Term(
        name=name,
        sentence=sentence,
        place=place,
        coefficients=(coefficient,),
        columns=memoryless(column),
        needs=frozenset(needs),
        predictive=predictive,
    )


def millionths(
    name: str,
    symbol: str,
    unit: str,
    *,
    family: str = "",
    order: int = 0,
    label: str = "",
    prior_sigma: float = WIDE,
    min_share: float = EVENT_SHARE,
) -> Coefficient:
    """Return a coefficient that is reported in millionths."""
    return Coefficient(
        name=name,
        symbol=symbol,
        unit=unit,
        per_unit=MICRO,
        family=family,
        order=order,
        label=label,
        prior_sigma=prior_sigma,
        min_share=min_share,
    )


def foreseen(effect: Effect) -> bool:
    """Return True if the value of a term in a run is known from the other runs of the same test.

    This holds for terms that do not belong to one run or time, and for a mounting, which runs
    share.
    """
    return effect.predictive or (isinstance(effect, Term) and "mounting" in effect.needs)
