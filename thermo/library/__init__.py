"""Errors of accelerometers over temperature, one file a physical family.

Each module holds its terms with their priors and units, and the effects made of them with their
sentences, the experiments that isolate them and an example for the emulator. The library collects
the modules; a user file is a further member while a command runs.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

from errormodel.errors import InputError
from errormodel.in_use import InUse
from errormodel.io.python_file import LibrarySource, PythonFile, members_of
from errormodel.terms import Description, Effect
from thermo.library import (
    head,
    kink,
    lag,
    loop,
    moves,
    passing,
    polynomial,
    rate,
    readout,
    static,
)
from thermo.library.effects import ThermalEffect
from thermo.library.polynomial import MAX_ORDER
from thermo.library.static import STATIC_NAMES

__all__ = [
    "MAX_ORDER",
    "STATIC_NAMES",
    "ThermalLibrary",
    "term",
    "thermal_library",
    "using_thermal_library",
    "with_thermal_file",
]

MODULES = (polynomial, static, kink, rate, loop, lag, passing, head, moves, readout)
Maker = Callable[[], Effect]


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalLibrary:
    """Terms by name, and effects that may be missing from a model.

    Attributes
    ----------
    terms : mapping of str to callable
        Each returns its term.
    effects : tuple of ThermalEffect
    sources : tuple of LibrarySource
        The user files that are part of it.
    """

    terms: Mapping[str, Maker]
    effects: tuple[ThermalEffect, ...]
    sources: tuple[LibrarySource, ...] = ()

    @cached_property
    def by_name(self) -> Mapping[str, ThermalEffect]:
        """The effects by name."""
        return {e.name: e for e in self.effects}

    @cached_property
    def parameters(self) -> Mapping[str, Description]:
        """Description of every coefficient and nonlinear parameter, by its name."""
        made = (make() for make in self.terms.values())
        return {u.name: u for t in made for u in (*t.coefficients, *t.parameters)}

    def _nearest(self, name: str) -> list[str]:
        """Return the names most like one, or the first."""
        return difflib.get_close_matches(name, self.terms, n=8, cutoff=0.4) or list(self.terms)[:8]

    def term(self, name: str) -> Effect:
        """Return a term by its name.

        Raises
        ------
        KeyError
            If there is none; the message has the nearest names.
        """
        if name not in self.terms:
            raise KeyError(
                f"no term {name!r}; expected one like {', '.join(self._nearest(name))}; a "
                "definition of your own needs --library FILE"
            )
        return self.terms[name]()

    def with_members(
        self, terms: Mapping[str, Maker], effects: Sequence[ThermalEffect], source: LibrarySource
    ) -> "ThermalLibrary":
        """Return the library with further members from a user.

        Raises
        ------
        InputError
            If a name is already in the library, or a function does not return the named term.
        """
        for name, make in terms.items():
            if name in self.terms:
                raise InputError(source.name, "TERMS", f"{name} is in the library already")
            try:
                made = cast(object, make())
            except Exception as err:
                problem = f"{name}: {type(err).__name__}: {err}"
                raise InputError(source.name, "TERMS", problem) from None
            if not isinstance(made, Effect) or made.name != name:
                raise InputError(source.name, "TERMS", f"{name}: expected a term of that name")
        for effect in effects:
            if effect.name in self.by_name:
                raise InputError(source.name, "EFFECTS", f"{effect.name} is in the library already")
        return ThermalLibrary(
            terms={**self.terms, **terms},
            effects=(*self.effects, *effects),
            sources=(*self.sources, source),
        )


STANDARD = ThermalLibrary(
    terms={name: make for module in MODULES for name, make in module.TERMS.items()},
    effects=tuple(e for module in MODULES for e in module.EFFECTS),
)
thermal_library = InUse(STANDARD)
using_thermal_library = thermal_library.using


def with_thermal_file(file: PythonFile) -> ThermalLibrary:
    """Return the library in use with the terms and effects of a user's file.

    The file defines `TERMS`, a mapping of names to functions that make terms, and `EFFECTS`, a
    sequence of `thermo.library.effects.ThermalEffect`.

    Raises
    ------
    InputError
        If the members of the file have the wrong type.
    """
    given: object = getattr(file.module, "TERMS", {})
    if not isinstance(given, Mapping) or not all(
        isinstance(name, str) and callable(make)
        for name, make in cast(Mapping[object, object], given).items()
    ):
        problem = "expected a mapping of names to functions that make terms"
        raise InputError(file.path, "TERMS", problem)
    terms = cast(Mapping[str, Maker], given)
    effects = [e for e in members_of(file, "EFFECTS", object) if isinstance(e, ThermalEffect)]
    source = LibrarySource(name=file.path.name, sha256=file.sha256, members=frozenset(terms))
    return thermal_library().with_members(terms, effects, source)


def term(name: str) -> Effect:
    """Return a term of the library in use by its name.

    Raises
    ------
    KeyError
        If there is none; the message has the nearest names.
    """
    return thermal_library().term(name)
