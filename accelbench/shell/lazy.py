"""Groups of commands that are imported when they are called: what some need takes seconds."""

import difflib
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

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is asked for; of one that is none the nearest name is told."""
        name = args[0]
        near = difflib.get_close_matches(name, self.table, n=1)
        if name not in self.table and not name.startswith("-"):
            meant = f"; did you mean {near[0]!r}?" if near else ""
            known = "" if near else f"; expected one of {', '.join(self.table)}"
            raise click.UsageError(f"no command {name!r}{meant}{known}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table into the help, without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.table[name][2]) for name in self.list_commands(ctx)])
