"""`accelbench panel`: the page, and its users."""

from pathlib import Path
from typing import Any

import click

from accelbench.commands.run.store_commands import store_option
from accelbench.shell.library import library_option
from accelbench.shell.outputs import json_option

NEEDED = "accelbench panel needs the extra libraries: pip install 'accelbench[panel]'"


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8300, show_default=True, help="0: any free."
)
@store_option
@click.option(
    "--stations",
    type=Path,
    default=Path(),
    help="Folder of station files that the browser may choose from; this folder if not given.",
)
@click.option(
    "--sequences",
    type=Path,
    default=Path(),
    help="Folder of sequences; what the page makes is kept there. This folder if not given.",
)
@click.option(
    "--users", type=Path, help="File of users; needed for any --host but this machine's own."
)
@click.option("--notify", type=Path, help="File with [notify]: who is told of alarms.")
@library_option()
@json_option
def panel(**given: Any) -> None:
    """Serve the operator's page: plan, start, watch and stop tests in a browser.

    Tests run in processes of their own: they go on when the page is closed, and when this command
    is stopped. On this machine alone nobody has to log in; --host 0.0.0.0 needs --users. In
    Python: accelbench.panel.serve.serve.
    """
    from accelbench.commands.panel.work import panel as work

    work(**given)


@click.command()
@click.argument("users", type=Path, metavar="USERS.toml")
@click.argument("name")
@click.option(
    "--role",
    type=click.Choice(["view", "operate", "administer"]),
    default="view",
    show_default=True,
    help="view: look; operate: plan, start, stop, acknowledge; administer: all.",
)
@click.password_option(help="Asked for when not given.")
@json_option
def panel_user(**given: Any) -> None:
    """Add a user to a file of users, or give one a new password and role.

    The password is kept as an Argon2 hash. In Python: accelbench.panel.access.users.add_user.
    """
    from accelbench.commands.panel.work import panel_user as work

    work(**given)
