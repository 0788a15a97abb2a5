"""Fills the tables of the reference from the program itself, so that they stay true.

    python docs/reference/tables.py

rewrites what stands between ``<!-- table: NAME -->`` and ``<!-- end -->`` in the files of this
folder. Meanings that the program does not hold as data stand in meanings.toml; a key without one
is an error. tests/test_docs.py fails when a table is not up to date.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import click
import sqlalchemy as sa
from file_keys import keys, only
from table_form import Rows, markdown, meanings

from accelbench.cli import accelbench
from drivers.chambers.maps import load_map
from drivers.chambers.models import CHAMBER_MODELS
from drivers.emulators.faults import PANEL_KINDS, REPLY_KINDS
from drivers.station import FaultKind, StationConfig
from errormodel.terms import InputChange
from sinscal.library import rig_library
from sinscal.library.groups import ALL_CHANNELS
from sinscal.recording.files import NavSidecar, RigSidecar
from sinscal.twin.rig_file import RigFile
from thermo.compensation.model_file import ModelFile
from thermo.fitting.fit import TermsFile
from thermo.launch.notify import NotifyFile
from thermo.library import thermal_library
from thermo.planning.bounds import SEQUENCE, STATION
from thermo.planning.sequence import Sequence
from thermo.recording.files import Sidecar
from thermo.recording.foreign.map import LogMap
from thermo.recording.signals import signals as signals_in_use
from thermo.store.operation.alarm_kinds import ALARM_KINDS
from thermo.store.schema import metadata
from thermo.twin.planted import size_in_words

HERE = Path(__file__).parent
BLOCK = re.compile(r"<!-- table: (\S+) -->\n.*?<!-- end -->", re.DOTALL)


def terms() -> str:
    """Return the library of terms."""
    rows: Rows = []
    for name, make in thermal_library().terms.items():
        term = make()
        place = "replaces temperature" if isinstance(term, InputChange) else term.place
        unknowns = [f"{c.symbol}, {_unit(c.unit)}" for c in term.coefficients]
        found = [f"{p.symbol} (`{p.name}`), {p.lo:g} to {p.hi:g} {p.unit}" for p in term.parameters]
        rows.append(
            (
                f"`{name}`",
                "; ".join(unknowns) or "–",
                place,
                term.sentence,
                "; ".join(found) or "–",
                ", ".join(f"`{n}`" for n in sorted(term.needs)) or "–",
            )
        )
    head = ("term", "coefficient", "place", "what it physically is", "parameters", "needs")
    return markdown(head, rows)


def signals() -> str:
    """Return the signals that terms may use."""
    rows = [
        (f"`{one.name}`", one.unit, one.sentence, f"`{one.name}`" if one.recorded else "–")
        for one in signals_in_use()
    ]
    return markdown(("signal", "unit", "what it is", "column of its own"), rows)


def effects() -> str:
    """Return the effects that a chamber test may name."""
    rows = [
        (
            f"`{one.name}`",
            one.sentence.replace("{size}", "its size"),
            one.experiment,
            size_in_words(one.example) if one.example else "–",
        )
        for one in thermal_library().effects
    ]
    return markdown(("effect", "what it is", "what isolates it", "emulated example"), rows)


def rig_terms() -> str:
    """Return the groups of a SINS's errors on a rig."""
    rows: Rows = []
    for name, group in rig_library().groups.items():
        made = [t for t in (group.term(channel) for channel in ALL_CHANNELS) if t is not None]
        parameters = [c for t in made for c in t.coefficients]
        first, told = parameters[0], group.told
        rows.append(
            (
                f"`{name}`" + (", always" if group.basic else ""),
                f"`{first.name}`" + (f" and {len(parameters) - 1} more" if parameters[1:] else ""),
                made[0].sentence,
                f"{group.prior_sigma / told.size:.4g} {told.unit}",
                f"{first.unit}; reported in {told.unit}",
                group.formula or "–",
            )
        )
    head = ("group", "parameters", "what it physically is", "prior, 1 σ", "unit", "in the formula")
    return markdown(head, rows)


def rig_effects() -> str:
    """Return the effects that a rig run may name."""
    rows = [
        (f"`{one.name}`", one.sentence, one.follows, one.experiment)
        for one in rig_library().by_name.values()
    ]
    return markdown(("effect", "what it is", "follows", "what isolates it"), rows)


def _unit(unit: str) -> str:
    return "output unit per g" if unit == "nominal" else unit


def commands() -> str:
    """Return every command with its arguments and options."""
    parts: list[str] = []
    for name, command in leaves(accelbench):
        arguments = [p for p in command.params if isinstance(p, click.Argument)]
        usage = " ".join(p.metavar or p.human_readable_name.upper() for p in arguments)
        what = (command.help or "").split("\n\n")[0].strip()
        line = " ".join(("accelbench", name, *usage.split(), "[options]"))
        parts.append(f"### {name}\n\n    {line}\n\n{what}\n")
        rows = [_option(p) for p in command.params if isinstance(p, click.Option)]
        parts.append(markdown(("option", "default", "meaning"), rows) + "\n")
    return "\n".join(parts).rstrip()


def leaves(group: click.Group, prefix: str = "") -> Iterator[tuple[str, click.Command]]:
    """Return every command that is no group, with its groups' names before its own."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from leaves(command, f"{prefix}{name} ")
        else:
            yield f"{prefix}{name}", command


def _option(option: click.Option) -> tuple[str, str, str]:
    value = "" if option.is_flag else f" {option.metavar or option.type.name.upper()}"
    default = option.default
    shown = f"`{default}`" if isinstance(default, str | Path) else "–"
    shown = "required" if option.required else shown
    names = " / ".join(max(opts, key=len) for opts in (option.opts, option.secondary_opts) if opts)
    return f"`{names}{value}`", shown, option.help or ""


def faults() -> str:
    """Return what an emulated instrument can be told to do wrong."""
    known = meanings()["faults"]
    rows = [(f"`{kind}`", _fault_group(kind), known[kind]) for kind in get_args(FaultKind)]
    return markdown(("kind", "spoils", "what happens"), rows)


def _fault_group(kind: FaultKind) -> str:
    if kind in REPLY_KINDS:
        return "replies"
    return "nothing: done at the panel" if kind in PANEL_KINDS else "state"


def registers() -> str:
    """Return the register maps of the chamber controllers."""
    parts: list[str] = []
    for model in CHAMBER_MODELS:
        book = load_map(model)
        parts.append(f"### {book.title} (`{model}`)\n")
        rows: Rows = []
        for name, r in book.registers.items():
            kind = r.kind + (f", {r.word_order} word first" if r.count == 2 else "")
            scale = "10^decimals" if r.scale == "decimals" else f"{r.scale:g}"
            values = ", ".join(f"{k} {v}" for k, v in r.values.items()) or "–"
            rows.append((f"`{name}`", str(r.address), kind, scale, r.access, values))
        head = ("register", "address", "kind", "units of the wire per unit", "access", "values")
        parts.append(markdown(head, rows) + "\n")
    return "\n".join(parts).rstrip()


def alarms() -> str:
    """Return the kinds of alarm."""
    rows = [
        (f"`{name}`", kind.title, kind.weight, kind.meaning, kind.remedy)
        for name, kind in ALARM_KINDS.items()
    ]
    return markdown(("kind", "title", "weight", "what it means", "what to do"), rows)


def store() -> str:
    """Return the tables of the store."""
    parts: list[str] = []
    known = meanings()["store"]
    for table in metadata.sorted_tables:
        parts.append(f"## {table.name}\n\n{known[table.name]}\n")
        rows = [_column(table, column, known) for column in table.columns]
        parts.append(markdown(("column", "type", "key", "meaning"), rows) + "\n")
    return "\n".join(parts).rstrip()


def _column(table: sa.Table, column: sa.Column[Any], known: Mapping[str, str]) -> tuple[str, ...]:
    kind = type(column.type).__name__.lower() + (", may be null" if column.nullable else "")
    key = "primary" if column.primary_key else ""
    return f"`{column.name}`", kind, key, known[f"{table.name}.{column.name}"]


TABLES: dict[str, Callable[[], str]] = {
    "terms": terms,
    "signals": signals,
    "effects": effects,
    "rig-terms": rig_terms,
    "rig-effects": rig_effects,
    "commands": commands,
    "faults": faults,
    "registers": registers,
    "store": store,
    "sequence": keys(Sequence, "sequence", SEQUENCE),
    "station": keys(StationConfig, "station", STATION),
    "mapping": keys(LogMap, "mapping"),
    "rigfile": keys(RigFile, "rigfile"),
    "sidecar": keys(Sidecar, "sidecar"),
    "rig-sidecar": keys(RigSidecar, "rig-sidecar"),
    "nav-sidecar": only(keys(NavSidecar, "nav-sidecar"), "body_axes"),
    "termsfile": keys(TermsFile, "termsfile"),
    "modelfile": keys(ModelFile, "modelfile"),
    "alarms": alarms,
    "notify": keys(NotifyFile, "notify"),
}


def filled(text: str) -> str:
    """Return a document with its tables made anew."""
    return BLOCK.sub(
        lambda m: f"<!-- table: {m[1]} -->\n{TABLES[m[1]]()}\n<!-- end -->",
        text,
    )


def main() -> None:
    """Rewrite the tables of every document in this folder."""
    for path in sorted(HERE.glob("*.md")):
        text = path.read_text(encoding="utf-8")
        if (new := filled(text)) != text:
            path.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
