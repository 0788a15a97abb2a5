"""From a parsed table to a navigation-output run, checked."""

from typing import Literal, TypeAlias

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from errormodel.io.tables import RawTable, TableForm
from sinscal.frames.attitude import c_nb_from_angles
from sinscal.recording.rows import (
    check_times,
    cycles_of,
    fail,
    refuse_impossible,
    require_filled,
    temperatures,
)
from sinscal.recording.run import AXES, NavRun, RigFacts

BodyAxes: TypeAlias = Literal["right-forward-up", "forward-right-down", "forward-left-up"]

ANGLES = ("roll_deg", "pitch_deg", "heading_deg")
REQUIRED = (
    "time_s",
    "cycle",
    "lat_deg",
    "lon_deg",
    "height_m",
    "ve_m_s",
    "vn_m_s",
    "vu_m_s",
    *ANGLES,
)
NAV_FORM = TableForm(
    numbers=(*REQUIRED, "temp_c", *(f"temp_{axis}_c" for axis in AXES)), required=REQUIRED
)
# columns: where the body's x, y, z point along right, ahead, up
_BODY: dict[str, FloatArray] = {
    "right-forward-up": np.eye(3),
    "forward-right-down": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "forward-left-up": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
LIMITS = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-360.0, 360.0),
    "height_m": (-50_000.0, 100_000.0),  # an undamped vertical channel goes far
    "ve_m_s": (-1000.0, 1000.0),
    "vn_m_s": (-1000.0, 1000.0),
    "vu_m_s": (-1000.0, 1000.0),
    "roll_deg": (-360.0, 360.0),
    "pitch_deg": (-90.0, 90.0),
    "heading_deg": (-360.0, 360.0),
}
FAR_DEG = 5.0  # from the site: no SINS on a rig errs so far


def build_nav(raw: RawTable, facts: RigFacts, body_axes: BodyAxes) -> NavRun:
    """Make a navigation-output run of a table.

    Raises
    ------
    InputError
        Naming the first row at fault.
    """
    refuse_impossible(raw)
    require_filled(raw, *REQUIRED)
    cycle = cycles_of(raw)
    check_times(raw, cycle)
    for name, (lo, hi) in LIMITS.items():
        values = raw.number[name]
        bad = (values < lo) | (values > hi)
        if bad.any():
            row = int(np.argmax(bad))
            raise fail(raw, row, f"{name} {values[row]:g}, expected {lo:g} to {hi:g}")
    _check_site(raw, facts)
    _check_degrees(raw)
    number = raw.number
    roll, pitch, heading = (np.deg2rad(number[name]) for name in ANGLES)
    return NavRun(
        time_s=number["time_s"],
        cycle=cycle,
        lat_rad=np.deg2rad(number["lat_deg"]),
        lon_rad=np.deg2rad(number["lon_deg"]),
        height_m=number["height_m"],
        velocity=np.column_stack([number[f"v{a}_m_s"] for a in "enu"]),
        c_nb=c_nb_from_angles(roll, pitch, heading) @ _BODY[body_axes],
        temp_c=temperatures(raw, cycle),
        facts=facts,
        source=raw.source,
    )


def _check_site(raw: RawTable, facts: RigFacts) -> None:
    lat_deg, site_deg = raw.number["lat_deg"], float(np.rad2deg(facts.site.lat_rad))
    far = np.abs(lat_deg - site_deg) > FAR_DEG
    if not far.any():
        return
    row = int(np.argmax(far))
    in_rad = abs(np.rad2deg(lat_deg[row]) - site_deg) < FAR_DEG
    hint = "; is it in radians?" if in_rad else ""
    raise fail(
        raw, row, f"lat_deg {lat_deg[row]:g}, expected the site's {site_deg:.6g} or near{hint}"
    )


def _check_degrees(raw: RawTable) -> None:
    """Refuse radians: they turn over at 2π; degrees would hardly jump by six from row to row."""
    for name in ("roll_deg", "heading_deg"):
        values = raw.number[name]
        jumps = np.abs(np.abs(np.diff(values)) - 2.0 * np.pi) < 0.3
        if np.ptp(values) <= 2.0 * np.pi and jumps.any():
            row = int(np.argmax(jumps)) + 1
            raise InputError(
                raw.source, raw.place(row), f"{name} turns over at 2π: it is in radians"
            )
