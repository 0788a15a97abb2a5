"""The accelerometer of a set: its own equation, and the model that the search begins from.

    E = K1 (1 + sum s_k x^k) [a_i + K0 + sum b_k x^k + K2 a_i^2 + K3 a_i^3 + d_o a_p + K_ip a_i a_p]

(IEEE Std 1293-2018, the pendulous terms of a head that turns about OA.) Forces in g, x in °C from
T_ref; sizes in µg, ppm and µrad are millionths.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.second.campaign import Campaign

Floats = NDArray[np.float64]

UNITS = {"mA": 1.25, "V": 5.0, "g": 1.0, "m/s2": 9.8124, "count": 1e6}  # per g
# static terms that positions separate beside bias and scale factor
STATIC = {2: (), 4: ("k2", "delta_o"), 6: ("k2", "delta_o", "k_ip")}
STATIC[12] = ("k2", "k3", "delta_o", "k_ip")
MOST_ORDERS = 4  # that a fit may choose


@dataclass(frozen=True, slots=True, kw_only=True)
class Accelerometer:
    """Coefficients in millionths, and which model is taken as present."""

    unit: str
    scale: float  # K1 over the nominal scale factor, less 1
    bias: tuple[float, ...]  # b_0, b_1 ...
    slopes: tuple[float, ...]  # s_1, s_2 ...
    static: dict[str, float]
    present: str  # "bare", "terms" or "default"

    def k0(self, x: Floats) -> Floats:
        """Bias over temperature, µg."""
        return np.polynomial.polynomial.polyval(x, self.bias)

    def k1(self, x: Floats) -> Floats:
        """Scale factor over temperature, ppm of K1."""
        return np.polynomial.polynomial.polyval(x, (0.0, *self.slopes))

    def input_ug(self, c: Campaign, x: Floats | None = None) -> Floats:
        """The equation's part in the input beside a_i, µg."""
        a = {"k2": c.a_i**2, "k3": c.a_i**3, "delta_o": c.a_p, "k_ip": c.a_i * c.a_p}
        bias = self.k0(c.x if x is None else x)
        return bias + sum((v * a[name] for name, v in self.static.items()), np.zeros(len(c.run)))

    def lagged_ug(self, c: Campaign, inner_x: Floats) -> Floats:
        """What changes at the input when the inside is at another temperature, µg."""

        def told(x: Floats) -> Floats:
            return (1 + 1e-6 * self.k1(x)) * (1e6 * c.a_i + self.input_ug(c, x))

        return (told(inner_x) - told(c.x)) / (1 + 1e-6 * self.k1(c.x))

    def slope_ug_per_c(self, c: Campaign) -> Floats:
        """Slope of the output over temperature at each reading, µg/°C at the input."""
        b = np.polynomial.polynomial.polyder(np.array([*self.bias, 0.0]))
        s = np.polynomial.polynomial.polyder(np.array([0.0, *self.slopes, 0.0]))
        value = np.polynomial.polynomial.polyval
        return value(c.x, b) + value(c.x, s) * c.a_i

    def terms(self) -> tuple[str, ...]:
        """Names of the terms of the truth, as a TERMS.toml lists them."""
        k0 = [f"k0_t{k}" for k in range(1, len(self.bias))]
        k1 = [f"k1_t{k}" for k in range(1, len(self.slopes) + 1)]
        return ("k1", "k0", *k0, *k1, *self.static)

    def columns(self, c: Campaign) -> Floats:
        """Regressors of the present model, shape (n, p); of the default all that a fit may take."""
        if self.present == "bare":
            orders, static = (2, 2), ()
        elif self.present == "terms":
            orders, static = (len(self.bias) - 1, len(self.slopes)), tuple(self.static)
        else:
            orders, static = (MOST_ORDERS, MOST_ORDERS), STATIC[c.protocol.positions]
        # of unit size: powers of tens of °C would spoil the rank
        x = c.x / 50
        a = {"k2": c.a_i**2, "k3": c.a_i**3, "delta_o": c.a_p, "k_ip": c.a_i * c.a_p}
        parts = [x**k for k in range(orders[0] + 1)]
        parts += [c.a_i * x**k for k in range(orders[1] + 1)]
        return np.column_stack(parts + [a[name] for name in static])


def draw_accelerometer(
    rng: np.random.Generator, c: Campaign, hidden: tuple[str, ...]
) -> Accelerometer:
    """Draw an equation; a term that is hidden is not in it, nor in the present model."""
    present = str(rng.choice(["bare", "terms", "default"], p=[0.35, 0.35, 0.3]))
    ordered = {"bias_temperature_order", "scale_temperature_order"} & set(hidden)
    absorbed = {"second_order", "third_order", "cross_axis"} & set(hidden)
    if present == "default" and (ordered or absorbed):
        present = "terms"
    most = 2 if present == "bare" else 3
    if c.protocol.span == "narrow":
        most = 2
    n_bias, n_slopes = int(rng.integers(1, most + 1)), int(rng.integers(1, most + 1))
    sizes_b = (rng.uniform(3, 40), rng.uniform(0.02, 0.2), rng.uniform(2e-4, 1.5e-3))
    sizes_s = (rng.uniform(20, 200), rng.uniform(0.02, 0.3), rng.uniform(2e-4, 1.5e-3))
    signs = rng.choice([-1.0, 1.0], 6)
    left_out = {"second_order": "k2", "third_order": "k3", "cross_axis": "delta_o"}
    gone = {left_out[name] for name in absorbed}
    names = () if present == "bare" else STATIC[c.protocol.positions]
    draws = {
        "k2": rng.normal(0, 20),
        "k3": rng.normal(0, 10),
        "delta_o": rng.normal(0, 300),
        "k_ip": rng.normal(0, 10),
    }
    return Accelerometer(
        unit=str(rng.choice(list(UNITS))),
        scale=float(rng.normal(0, 3e-3)),
        bias=(float(rng.normal(0, 2000)), *(signs[:3] * sizes_b)[:n_bias].tolist()),
        slopes=tuple((signs[3:] * sizes_s)[:n_slopes].tolist()),
        static={k: float(draws[k]) for k in names if k not in gone},
        present=present,
    )
