"""Heat flow through the accelerometer: bias and scale factor follow dT/dt."""

from collections.abc import Callable, Sequence

from errormodel.terms import Effect, Term
from thermo.library.effects import (
    MICRO,
    WIDE_C,
    Context,
    Example,
    Form,
    ThermalEffect,
    one_column,
    plain_form,
)

ORDINARY = 1e-3  # 1 mg or 1000 ppm at 1 °C/min: wider than any accelerometer


def temperature_rate_bias() -> Term:
    """Return a bias proportional to the rate of temperature."""
    return one_column(
        "temperature_rate_bias",
        symbol="br",
        unit="µg/(°C/min)",
        sentence="Heat flowing through the accelerometer gives a bias proportional to dT/dt.",
        column=lambda r: r["rate_c_per_min"],
        needs=("rate_c_per_min",),
        prior_sigma=ORDINARY,
    )


def temperature_rate_bias_slope() -> Term:
    """Return the change with temperature of a bias proportional to the rate of temperature."""
    return one_column(
        "temperature_rate_bias_slope",
        symbol="br1",
        unit="µg/(°C/min)/°C",
        sentence="Heat flowing through the accelerometer gives a bias that changes with "
        "temperature, as conduction and expansion do.",
        column=lambda r: r["rate_c_per_min"] * r["x_c"],
        needs=("rate_c_per_min", "x_c"),
        family="temperature_rate_bias",
        order=1,
        label="slope",
        prior_sigma=ORDINARY / WIDE_C,
    )


def temperature_rate_scale() -> Term:
    """Return a scale-factor change proportional to the rate of temperature."""
    return one_column(
        "temperature_rate_scale",
        symbol="sr",
        unit="ppm/(°C/min)",
        sentence="Heat flowing through the torquer's magnet changes the scale factor with dT/dt.",
        place="scale",
        column=lambda r: r["rate_c_per_min"],
        needs=("rate_c_per_min",),
        prior_sigma=ORDINARY,
    )


def heat_flow_bias() -> Term:
    """Return a bias proportional to how much warmer the chamber is than the accelerometer."""
    return one_column(
        "heat_flow_bias",
        symbol="hf",
        unit="µg/°C",
        sentence="Heat flowing from the chamber's air into the case gives a bias proportional to "
        "their difference.",
        column=lambda r: r["chamber_less_case_c"],
        needs=("chamber_less_case_c",),
        prior_sigma=ORDINARY,
    )


def _rate_bias(at: Context) -> Sequence[Form]:
    plain = ("temperature_rate_bias",)
    if at.term_names & {"temperature_rate_bias"}:
        return []
    return [Form(terms=plain), Form(terms=(*plain, "temperature_rate_bias_slope"))]


TERMS: dict[str, Callable[[], Effect]] = {
    "temperature_rate_bias": temperature_rate_bias,
    "temperature_rate_bias_slope": temperature_rate_bias_slope,
    "temperature_rate_scale": temperature_rate_scale,
    "heat_flow_bias": heat_flow_bias,
}
EFFECTS = (
    ThermalEffect(
        name="temperature_rate_bias",
        sentence="The bias follows the rate of temperature, {size}.",
        forms=_rate_bias,
        experiment="two ramp rates over the same temperatures: the effect is proportional to the "
        "rate and vanishes at once in a hold",
        example=Example(term="temperature_rate_bias", values={"temperature_rate_bias": 12 / MICRO}),
    ),
    ThermalEffect(
        name="temperature_rate_scale",
        sentence="The scale factor follows the rate of temperature, {size}.",
        forms=plain_form("temperature_rate_scale"),
        experiment="two ramp rates, tumbled between +1 g and −1 g",
        example=Example(
            term="temperature_rate_scale", values={"temperature_rate_scale": 10 / MICRO}
        ),
    ),
    ThermalEffect(
        name="heat_flow",
        sentence="The bias follows the difference between chamber and accelerometer, {size}.",
        forms=plain_form("heat_flow_bias"),
        experiment="a ramp, and a hold in which the chamber's air is cycled by some degrees: a "
        "bias that follows the rate does not follow that",
        example=Example(term="heat_flow_bias", values={"heat_flow_bias": 5 / MICRO}),
    ),
)
