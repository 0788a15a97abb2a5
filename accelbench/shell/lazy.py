"""Groups of commands that are imported when they are called: what some need takes seconds."""

import importlib
from collections.abc import Mapping

import click


class LazyGroup(click.Group):
    """A group whose `table` tells of each command its module, its attribute and what it does."""

    table: Mapping[str, tuple[str, str, str]]

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        del ctx
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, imported; None when there is none of that name."""
        if cmd_name not in self.list_commands(ctx):
            return None
        module, attribute, _ = self.table[cmd_name]
        found = getattr(importlib.import_module(f"accelbench.commands.{module}"), attribute)
        assert isinstance(found, click.Command)
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table into the help, without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.table[name][2]) for name in self.list_commands(ctx)])
