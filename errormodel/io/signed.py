"""JSON files that tell what made them, and by a digest whether they were changed since.

Model files, rig calibrations and combined calibrations are of this kind.
"""

import hashlib
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from errormodel.errors import InputError
from errormodel.io.toml import read_text

DIGITS = 16  # of a digest, hexadecimal


def software_name() -> str:
    """Return the name and the version of this program, as files tell them."""
    return f"accelbench {version('accelbench')}"


def content_digest(content: Any, *, compact: bool = False) -> str:
    """Return the digest of what JSON can hold, whatever the order of its keys.

    Parameters
    ----------
    content : object
    compact : bool
        Without blanks between the parts of the text that is digested, as model files have it.

    Returns
    -------
    str
    """
    separators = (",", ":") if compact else None
    text = json.dumps(content, sort_keys=True, separators=separators)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def check_digest(found: str, stated: str, path: Path | str, key: str) -> None:
    """Compare the digest of a file's content with the one that stands in it under `key`.

    Raises
    ------
    InputError
        If they differ.
    """
    if found != stated:
        raise InputError(path, key, "does not fit the content: the file was changed by hand")


def json_file_text(model: BaseModel, *, indent: int) -> str:
    """Return a file's text."""
    return json.dumps(model.model_dump(mode="json"), ensure_ascii=False, indent=indent) + "\n"


def read_json(path: Path | str) -> Any:
    """Read a JSON file.

    Raises
    ------
    InputError
        If it cannot be read or is no JSON.
    """
    try:
        return json.loads(read_text(path))
    except (ValueError, RecursionError) as err:
        raise InputError(path, "", f"not JSON: {err}") from None
