"""Errors of gyros, accelerometers and the rig's angle, one file a physical family.

Each module defines its groups of terms with their priors and reported units, and the effects built
from them. The library collects the modules; a user file is a further member while a command runs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from errormodel.errors import InputError
from errormodel.in_use import InUse
from errormodel.io.python_file import LibrarySource, PythonFile, members_of
from errormodel.terms import Description, Term
from sinscal.library import accelerometer, angle, gyro, jump, lever
from sinscal.library.groups import ALL_CHANNELS, ChannelId, Group, Kind, RigEffect

MODULES = (gyro, accelerometer, lever, angle, jump)
# The groups estimated in the article; all others are added by name.
BASIC = tuple(g.name for module in MODULES for g in module.GROUPS if g.basic)


@dataclass(frozen=True, eq=False, kw_only=True)
class RigLibrary:
    """Groups of terms by name, and effects that may be missing from a model.

    Attributes
    ----------
    groups : mapping of str to Group
    effects : tuple of RigEffect
        Effects that the search can name.
    drifts : tuple of RigEffect
        Drifts that a calibration is also tested for.
    sources : tuple of LibrarySource
        The user files that are part of it.

    Raises
    ------
    LookupError
        If the group of an effect is not in the library.
    """

    groups: Mapping[str, Group]
    effects: tuple[RigEffect, ...]
    drifts: tuple[RigEffect, ...]
    sources: tuple[LibrarySource, ...] = ()

    def __post_init__(self) -> None:
        for effect in self.effects:
            for name in effect.groups:
                if name not in self.groups:
                    raise LookupError(f"effect {effect.name}: no group {name!r}")

    @cached_property
    def by_name(self) -> Mapping[str, RigEffect]:
        """The effects and drifts by name."""
        return {e.name: e for e in (*self.effects, *self.drifts)}

    @cached_property
    def parameters(self) -> Mapping[str, Description]:
        """Description of every parameter by its name: of groups, jumps, drifts and the mounting."""
        kinds: tuple[Kind, ...] = ("gyro", "accel")
        changes = [
            g
            for k in kinds
            for g in (jump.constant_error_step(k, 0.0), jump.constant_error_drift(k, 1.0, 1.0))
        ]
        terms = (g.term(c) for g in (*self.groups.values(), *changes) for c in ALL_CHANNELS)
        made = (c for term in terms if term is not None for c in term.coefficients)
        return {c.name: c for c in (*made, *angle.MOUNTING)}

    def parameter(self, name: str) -> Description:
        """Return the description of a parameter.

        Raises
        ------
        KeyError
            If no group has it.
        """
        if name not in self.parameters:
            raise KeyError(f"{name} is not in a group")
        return self.parameters[name]

    @cached_property
    def told(self) -> Mapping[str, Description]:
        """A parameter of each group, by the group's name."""
        first: dict[str, Description] = {}
        for one in self.parameters.values():
            first.setdefault(one.group, one)
        return first

    def group(self, name: str) -> Group:
        """Return a group by its name.

        Raises
        ------
        KeyError
            If there is none; the message lists the groups.
        """
        if name not in self.groups:
            raise KeyError(
                f"no group {name!r}; known: {', '.join(self.groups)}; a definition of your own "
                f"needs --library FILE"
            )
        return self.groups[name]

    def terms_of(
        self, channel: ChannelId, names: Sequence[str], more: Sequence[Group] = ()
    ) -> tuple[Term, ...]:
        """Return a channel's terms of the groups named, and of further ones.

        Raises
        ------
        KeyError
            If there is no such group; the message lists the groups.
        """
        groups = [*(self.group(name) for name in names), *more]
        made = (group.term(channel) for group in groups)
        return tuple(term for term in made if term is not None)

    def needs_angle(self, name: str) -> bool:
        """Return True if the named group or effect appears in the rig angle only."""
        if name in self.groups:
            return self.groups[name].needs_angle
        return name in self.by_name and self.by_name[name].needs == "angle"

    def equation(self, kind: Kind) -> str:
        """Return the measurement formula of a kind of sensor, summed over its groups."""
        parts = [g.formula for g in self.groups.values() if kind in g.kinds and g.formula]
        return " + ".join(parts)

    @property
    def signs(self) -> str:
        """Meaning of the parameters' indices and signs."""
        return "; ".join(g.signs for g in self.groups.values() if g.signs)

    def with_members(
        self, groups: Sequence[Group], effects: Sequence[RigEffect], source: LibrarySource
    ) -> "RigLibrary":
        """Return the library with further members from a user.

        Raises
        ------
        InputError
            If a name is already in the library, or the group of an effect is in neither.
        """
        for one, known in ((g, self.groups) for g in groups):
            if one.name in known:
                raise InputError(source.name, "GROUPS", f"{one.name} is in the library already")
        for effect in effects:
            if effect.name in self.by_name:
                raise InputError(source.name, "EFFECTS", f"{effect.name} is in the library already")
        try:
            return RigLibrary(
                groups={**self.groups, **{g.name: g for g in groups}},
                effects=(*self.effects, *effects),
                drifts=self.drifts,
                sources=(*self.sources, source),
            )
        except LookupError as err:
            raise InputError(source.name, "EFFECTS", str(err)) from None


STANDARD = RigLibrary(
    groups={g.name: g for module in MODULES for g in module.GROUPS},
    effects=tuple(e for module in MODULES for e in module.EFFECTS),
    drifts=jump.DRIFTS,
)
rig_library = InUse(STANDARD)
using_rig_library = rig_library.using


def with_rig_file(file: PythonFile) -> RigLibrary:
    """Return the library in use with the groups and effects of a user's file.

    Raises
    ------
    InputError
        If the members of the file have the wrong type.
    """
    groups = members_of(file, "GROUPS", Group)
    effects = [e for e in members_of(file, "EFFECTS", object) if isinstance(e, RigEffect)]
    source = LibrarySource(
        name=file.path.name, sha256=file.sha256, members=frozenset(g.name for g in groups)
    )
    return rig_library().with_members(groups, effects, source)
