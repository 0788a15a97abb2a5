"""The sequence that most tests of a station run: a hold, a ramp and a hold."""

from collections.abc import Iterable


def there_and_stay(
    *,
    serials: Iterable[str],
    hold_min: float,
    to_c: float,
    rate_c_per_min: float,
    stay_min: float,
    period_s: float,
    start_c: float = 23.0,
    angles_deg: tuple[float, ...] = (0.0, 90.0),
    more: str = "",
) -> str:
    """Return its text.

    Parameters
    ----------
    serials : iterable of str
        Of the accelerometers.
    hold_min, to_c, rate_c_per_min, stay_min
        Of the hold at `start_c`, the ramp and the other hold.
    period_s : float
        Between two readings.
    start_c : float
    angles_deg : tuple of float
        Positions of the head.
    more : str
        Further lines of `[sampling]`, and further tables.
    """
    accelerometers = ", ".join(f'{{serial = "{s}", nominal_scale = 1.3}}' for s in serials)
    return f"""
name = "there and stay"
accelerometers = [{accelerometers}]
[temperature]
start_c = {start_c}
segments = [
    {{kind = "hold", duration_min = {hold_min}}},
    {{kind = "ramp", to_c = {to_c}, rate_c_per_min = {rate_c_per_min}}},
    {{kind = "hold", duration_min = {stay_min}}},
]
[positions]
angles_deg = {list(angles_deg)}
[sampling]
period_s = {period_s}
{more}"""
