"""`accelbench rig`: the group of all that belongs to calibrating a SINS on a rig."""

import click

from workbench.lazy import LazyGroup

# name: module, attribute, what it does
RIG_COMMANDS = {
    "simulate": ("commands_rig_plan", "simulate", "Simulate the run of a rig programme."),
    "covariance": ("commands_rig_plan", "covariance", "Say before a test how well it will do."),
    "calibrate": ("commands_rig_calibrate", "calibrate", "Calibrate a SINS from its rig run."),
    "compensate": ("commands_rig_calibrate", "compensate", "Apply a calibration to a rig run."),
    "flight": ("commands_rig_flight", "flight", "Say what a calibration is worth in flight."),
    "triad": ("commands_rig_triad", "triad", "Calibrate a triad from its rest positions."),
}


class _Rig(LazyGroup):
    """The rig's commands."""

    table = RIG_COMMANDS


@click.group(cls=_Rig)
def rig() -> None:
    """Plan, simulate and evaluate the rig calibration of a SINS.

    Every command takes --json: one JSON document on standard output and nothing else.
    """
