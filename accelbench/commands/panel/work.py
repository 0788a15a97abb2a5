"""`accelbench panel` and `panel-user`: what they do."""

import sys
from pathlib import Path
from typing import Literal

from accelbench.commands.panel.command import NEEDED
from accelbench.shell.console import emit
from accelbench.shell.surroundings import show_warnings_at_once
from errormodel.errors import WorkbenchError
from thermo.launch.control import who_asks
from thermo.store.database import display_url, parse_store_url


def panel(
    host: str,
    port: int,
    store: str,
    stations: Path,
    sequences: Path,
    users: Path | None,
    notify: Path | None,
    as_json: bool,
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

    def ready(url: str) -> None:
        line = f"{url}  (Ctrl-C stops the page; tests go on)"
        emit({"url": url, "store": display_url(parse_store_url(store))}, [line], as_json=as_json)
        sys.stdout.flush()

    serve(settings, ready=ready)


def panel_user(
    users: Path,
    name: str,
    role: Literal["view", "operate", "administer"],
    password: str,
    as_json: bool,
) -> None:
    """Carry out `accelbench panel-user`; the arguments are its options."""
    try:
        from accelbench.panel.access.users import add_user as add
    except ModuleNotFoundError:
        raise WorkbenchError(NEEDED) from None
    add(users, name, role, password)
    document = {"users": str(users), "name": name, "role": role}
    emit(document, [f"{users}: {name} may {role}"], as_json=as_json)
