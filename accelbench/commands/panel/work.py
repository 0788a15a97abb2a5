"""`accelbench panel`: what it does."""

from pathlib import Path
from typing import Literal

import click

from accelbench.commands.panel.command import NEEDED
from accelbench.shell.surroundings import show_warnings_at_once
from errormodel.errors import WorkbenchError
from thermo.launch.control import who_asks


def panel(
    host: str,
    port: int,
    store: str,
    stations: Path,
    sequences: Path,
    users: Path | None,
    notify: Path | None,
) -> None:
    """Carry out `accelbench panel`; the arguments are its options."""
    try:
        from accelbench.panel.serve import serve
        from accelbench.panel.settings import PanelSettings
    except ModuleNotFoundError as err:
        if err.name in ("nicegui", "argon2", "fastapi", "uvicorn"):
            raise WorkbenchError(NEEDED) from None
        raise
    settings = PanelSettings(
        store=store,
        stations=stations,
        sequences=sequences,
        host=host,
        port=port,
        users=users,
        name=who_asks(),
        notify=notify,
    )
    show_warnings_at_once()
    serve(settings, ready=lambda url: click.echo(f"{url}  (Ctrl-C stops the page; tests go on)"))


def add_user(
    users: Path, name: str, role: Literal["view", "operate", "administer"], password: str
) -> None:
    """Carry out `accelbench panel add-user`; the arguments are its options."""
    try:
        from accelbench.panel.users import add_user as add
    except ModuleNotFoundError:
        raise WorkbenchError(NEEDED) from None
    add(users, name, role, password)
    click.echo(f"{users}: {name} may {role}")
