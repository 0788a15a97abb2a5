"""Errors of the rig's angle: its clock, its encoder, and the mounting of the SINS."""

from collections.abc import Callable
from functools import partial

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Coefficient, Term, Told
from sinscal.frames.earth import ARCMIN, ARCSEC
from sinscal.library.groups import (
    PHASE,
    RATE,
    ChannelId,
    Group,
    RigEffect,
    effect_of,
    term_of,
)
from sinscal.library.groups import signal as signal_of
from sinscal.recording.run import AXES

TIME_OFFSET = "rig_time_offset"
MOUNT = "rig_mount"
MOUNT_SIGMA_RAD = float(np.deg2rad(1.0))  # the article's
# The mounting on the platform: states of the filter in addition to the sensor parameters.
MOUNTING = tuple(
    Coefficient(
        name=f"{MOUNT}_{a}",
        symbol=f"μ{a}",
        unit="rad",
        group=MOUNT,
        family=MOUNT,
        axis=a,
        prior_sigma=MOUNT_SIGMA_RAD,
        told=Told(unit="arcmin", size=ARCMIN),
    )
    for a in AXES
)
MOUNTED = tuple(c.name for c in MOUNTING)


def _time_offset(c: ChannelId) -> Term:
    del c
    sentence = "The rig's clock is ahead: its angle belongs to a later time."
    return term_of(TIME_OFFSET, sentence, [(TIME_OFFSET, "τ", "s", signal_of("turn_rad_s"))])


def _periodic(record: Record, order: int, quarter: float) -> FloatArray:
    return np.sin(order * record["angle_rad"] + quarter)


def _harmonic(order: int) -> Callable[[ChannelId], Term]:
    """Return the maker of the angle's error of `order` periods a turn."""

    def make(c: ChannelId) -> Term:
        del c
        parts = [
            (
                f"rig_angle_harmonic_{order}_{part}",
                f"κ{order}{part[0]}",
                "rad",
                partial(_periodic, order=order, quarter=quarter),
            )
            for part, quarter in (("sin", 0.0), ("cos", 0.5 * np.pi))
        ]
        sentence = f"The encoder's error has {order} period(s) per turn."
        return term_of(f"rig_angle_harmonic_{order}", sentence, parts)

    return make


CLOCK = Group(
    name=TIME_OFFSET,
    kinds=("angle",),
    make=_time_offset,
    prior_sigma=0.05,
    told=Told(unit="ms", size=1e-3),
    signs="the angle in the row of time t is the platform's at t + rig_time_offset",
)
HARMONIC, HARMONIC_2 = (
    Group(
        name=name,
        kinds=("angle",),
        make=_harmonic(order),
        prior_sigma=120.0 * ARCSEC,
        told=Told(unit="arcsec", size=ARCSEC),
    )
    for name, order in (("rig_angle_harmonic", 1), ("rig_angle_harmonic_2", 2))
)
GROUPS = (CLOCK, HARMONIC, HARMONIC_2)
EFFECTS = (
    effect_of(
        CLOCK,
        "The rig's clock is ahead: its angle belongs to a later time.",
        "turn at several rates both ways: the angle's error is proportional to the rate",
        RATE,
        needs="angle",
    ),
    RigEffect(
        name=MOUNT,
        sentence="The SINS is misaligned on the platform.",
        experiment="turn about two instrument axes at least without re-mounting",
        follows=PHASE,
        needs="angle",
    ),
    effect_of(
        HARMONIC,
        "The encoder's error has one period per turn.",
        "turn through whole turns at a low rate both ways",
        PHASE,
        needs="angle",
    ),
)
