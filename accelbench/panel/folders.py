"""Files that the browser may see: those of one suffix in one folder, by their plain name."""

import re
from dataclasses import dataclass
from pathlib import Path

from errormodel.errors import InputError
from errormodel.io.atomic import write_files

# letters, digits, dot, dash, underscore; no dot or dash first, so that no name is hidden or an
# option, and no separator, so that no name leaves the folder
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}\.toml")
MOST_BYTES = 1_000_000  # a sequence of a month of ramps has 20 kB


@dataclass(frozen=True, slots=True)
class TomlFolder:
    """The TOML files of a folder."""

    path: Path

    def names(self) -> list[str]:
        """Return the names of the files, in order."""
        return sorted(p.name for p in self.path.glob("*.toml") if NAME.fullmatch(p.name))

    def file(self, name: str) -> Path:
        """Return the path of a file of this folder.

        Raises
        ------
        InputError
            If the name is none of a plain file in this folder; a link that leads elsewhere is
            none.
        """
        path = self.path / name
        if not NAME.fullmatch(name) or not path.is_file():
            raise InputError(name, "", "no such file in the folder that the page was given")
        if path.resolve().parent != self.path.resolve():
            raise InputError(name, "", "leads out of the folder that the page was given")
        return path

    def save(self, name: str, text: str) -> Path:
        """Write a new file.

        Raises
        ------
        InputError
            If the name is no plain file name that ends in .toml, is taken, or the text is too
            long.
        """
        if not NAME.fullmatch(name):
            raise InputError(name, "", "expected letters, digits, - and _, then .toml")
        if len(text.encode()) > MOST_BYTES:
            raise InputError(name, "", f"larger than {MOST_BYTES / 1e6:g} MB")
        path = self.path / name
        if path.exists() or path.is_symlink():
            raise InputError(name, "", "there is a file of this name; choose another")
        write_files([(path, text.encode())])
        return path
