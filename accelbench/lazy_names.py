"""Names of a package that are imported when they are first asked for."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(module: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package whose names live elsewhere.

    Parameters
    ----------
    module : str
        The package, for the message of an unknown name.
    homes : mapping of str to str
        Where a name lives: "module", or "module:name" where it has another name there.

    Returns
    -------
    callable
        Imports a name; raises `AttributeError` for one that is not in `homes`.
    """

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, there = homes[name].partition(":")
        return getattr(importlib.import_module(home), there or name)

    return get
