"""`accelbench control`: the group of all that acts on tests that run in other processes."""

import click

from accelbench.shell.lazy import LazyGroup

# name: module, attribute, what it does
CONTROL_COMMANDS = {
    "list": ("control.command", "list_", "Show running tests, alarms, the queue and commands."),
    "pause": ("control.command", "pause", "Hold a running test."),
    "resume": ("control.command", "resume", "Let a paused test go on."),
    "abort": ("control.command", "abort", "End a running test safely."),
    "acknowledge": ("control.command", "acknowledge", "Acknowledge alarms."),
    "plan": ("control.queue_command", "plan", "Put a test into the queue."),
    "arm": ("control.queue_command", "arm", "Look at all that a planned test needs, and arm it."),
    "start": ("control.queue_command", "start", "Start an armed test, or go on with one."),
    "withdraw": ("control.queue_command", "withdraw", "Take a planned test out of the queue."),
    "serve": ("control.queue_command", "serve", "Start what is asked for and due; send notices."),
    "notify": ("control.queue_command", "notify", "Try the addresses that notices go to."),
}


class _Control(LazyGroup):
    """The commands on running tests."""

    table = CONTROL_COMMANDS


@click.group(cls=_Control)
def control() -> None:
    """Control tests that run in other processes, through their store.

    Every command takes --json: one JSON document on standard output and nothing else.
    """
