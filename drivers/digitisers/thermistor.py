"""Thermistor resistance to temperature and back, by the Steinhart-Hart equation.

1/T = a + b·L + c·L³ with L = ln R, T in kelvin and R in ohm. For b > 0 and c ≥ 0, which is every
real negative-coefficient thermistor, L is a strictly falling function of T, so that the inverse
has one real root in closed form.

References
----------
J. S. Steinhart and S. R. Hart, "Calibration curves for thermistors", Deep-Sea Research 15 (1968),
497-503. The inverse is Cardano's, in the hyperbolic form that does not cancel.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.station import ThermistorConfig

FloatArray = NDArray[np.float64]

ICE_POINT_K = 273.15


def temp_c_from_ohm(ohm: ArrayLike, coefficients: ThermistorConfig) -> Any:
    """Compute the temperature of a thermistor from its resistance.

    Parameters
    ----------
    ohm : array_like, any shape
        Resistance, ohm.
    coefficients : ThermistorConfig
        a, b, c of the equation.

    Returns
    -------
    ndarray or float, shape of `ohm`
        Temperature, °C; nan where the resistance is not a positive number or where the equation
        gives no positive absolute temperature.
    """
    r = np.asarray(ohm, dtype=np.float64)
    with np.errstate(all="ignore"):
        log_r = np.log(np.where(np.isfinite(r) & (r > 0), r, np.nan))
        per_k = coefficients.a + log_r * (coefficients.b + coefficients.c * log_r**2)
        temp_c = 1.0 / np.where(per_k > 0, per_k, np.nan) - ICE_POINT_K
    return _like(ohm, temp_c)


def ohm_from_temp_c(temp_c: ArrayLike, coefficients: ThermistorConfig) -> Any:
    """Compute the resistance of a thermistor at a temperature; the exact inverse.

    Parameters
    ----------
    temp_c : array_like, any shape
        Temperature, °C.
    coefficients : ThermistorConfig
        a, b, c of the equation.

    Returns
    -------
    ndarray or float, shape of `temp_c`
        Resistance, ohm; nan below absolute zero, and where c < 0 and the curve has turned back.
    """
    t = np.asarray(temp_c, dtype=np.float64) + ICE_POINT_K
    with np.errstate(all="ignore"):
        # c L³ + b L = y
        y = 1.0 / np.where(np.isfinite(t) & (t > 0), t, np.nan) - coefficients.a
        ohm = np.exp(_log_ohm(y, coefficients.b, coefficients.c))
    return _like(temp_c, ohm)


def _log_ohm(y: FloatArray, b: float, c: float) -> FloatArray:
    """Solve c L³ + b L = y for the real root that goes through zero with y."""
    if c == 0.0:
        return y / b
    s = np.sqrt(b / (3.0 * abs(c)))
    x = 1.5 * y / (b * s)
    if c > 0:
        return 2.0 * s * np.sinh(np.arcsinh(x) / 3.0)
    return 2.0 * s * np.sin(np.arcsin(x) / 3.0)


def _like(given: ArrayLike, result: FloatArray) -> Any:
    """Return a float for a number and an array for an array."""
    return float(result) if np.ndim(given) == 0 else result
