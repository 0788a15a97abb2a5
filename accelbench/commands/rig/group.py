"""`accelbench rig`: the group of all that belongs to calibrating a SINS on a rig."""

import click

from accelbench.shell.lazy import LazyGroup

# name: module, attribute, what it does
RIG_COMMANDS = {
    "simulate": ("rig_plan.command", "simulate", "Simulate the run of a rig programme."),
    "covariance": (
        "rig_plan.command",
        "covariance",
        "Predict the sigmas of a calibration before the test.",
    ),
    "calibrate": ("rig_calibrate.command", "calibrate", "Calibrate a SINS from its rig run."),
    "compensate": ("rig_calibrate.command", "compensate", "Apply a calibration to a rig run."),
    "flight": (
        "rig_flight.command",
        "flight",
        "Compute the position error in flight after a calibration.",
    ),
    "triad": ("rig_triad.command", "triad", "Calibrate a triad from its rest positions."),
}


class _Rig(LazyGroup):
    """The rig's commands."""

    table = RIG_COMMANDS


@click.group(cls=_Rig)
def rig() -> None:
    """Plan, simulate and evaluate the rig calibration of a SINS.

    Every command takes --json: one JSON document on standard output and nothing else.
    """
