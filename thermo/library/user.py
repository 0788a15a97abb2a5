"""Effects of a user's own, from one file of Python."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from errormodel.errors import InputError
from thermo.library.effects import EFFECTS, ThermalEffect
from thermo.library.terms import LIBRARY


def load_effects(path: Path | None) -> Sequence[ThermalEffect]:
    """Return the library with the effects of a file added.

    The file is Python and defines `EFFECTS`, a sequence of `ThermalEffect`, and `TERMS`, a mapping
    of the names of new terms to functions that make them; the terms join the library of terms for
    as long as the program runs.

    Parameters
    ----------
    path : path or None
        None: the library alone.

    Raises
    ------
    InputError
        If the file cannot be read, fails, or defines neither.
    """
    if path is None:
        return EFFECTS
    if not path.is_file():
        raise InputError(path, "", "no such file")
    spec = importlib.util.spec_from_file_location("accelbench_user_effects", path)
    if spec is None or spec.loader is None:
        raise InputError(path, "", "expected a file of Python, NAME.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as err:
        raise InputError(path, "", f"{type(err).__name__}: {err}") from None
    effects: tuple[ThermalEffect, ...] = tuple(getattr(module, "EFFECTS", ()))
    if not effects or not all(isinstance(e, ThermalEffect) for e in effects):
        raise InputError(
            path, "EFFECTS", "expected a sequence of thermo.library.effects.ThermalEffect"
        )
    known = {e.name for e in EFFECTS}
    twice = [e.name for e in effects if e.name in known]
    if twice:
        raise InputError(path, "EFFECTS", f"{twice[0]} is in the library already")
    LIBRARY.update(getattr(module, "TERMS", {}))
    return (*EFFECTS, *effects)
