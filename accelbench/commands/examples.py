"""`accelbench examples`: the files that the documents use, written where the user wants them."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import click

from accelbench.shell.outputs import force_option, json_option
from errormodel.errors import InputError
from errormodel.io.atomic import write_files


def _under(folder: Traversable, at: Path) -> list[tuple[Path, bytes]]:
    found: list[tuple[Path, bytes]] = []
    for one in sorted(folder.iterdir(), key=lambda t: t.name):
        if one.is_dir():
            found += _under(one, at / one.name)
        else:
            found.append((at / one.name, one.read_bytes()))
    return found


@click.command()
@click.argument("folder", type=Path, default=Path("examples"), metavar="[DIR]")
@force_option
@json_option
def examples(folder: Path, force: bool, as_json: bool) -> None:
    """Write the example files into DIR, "examples" if not given.

    Sequences, station files, rig programmes, mappings, a recording of two runs, and units for
    systemd. In Python: importlib.resources.files("accelbench") / "examples".
    """
    from accelbench.shell.console import emit

    files = _under(resources.files("accelbench").joinpath("examples"), folder)
    there = next((path for path, _ in files if path.exists()), None)
    if there is not None and not force:
        raise InputError(there, "", "exists; --force overwrites it")
    write_files(files)
    emit(
        {"folder": str(folder), "files": [str(path) for path, _ in files]},
        [f"{len(files)} files in {folder}"],
        as_json=as_json,
    )
