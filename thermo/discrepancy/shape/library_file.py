"""A library file of shapes, for `--library`."""

from collections.abc import Sequence

from errormodel.arrays import FloatArray
from thermo.discrepancy.shape.found import ShapeFound
from thermo.recording.signals import Signal


def library_text(shapes: Sequence[ShapeFound], columns: Sequence[Signal] = ()) -> str:
    """Return a library file of shapes, for `--library`.

    Parameters
    ----------
    shapes : sequence of ShapeFound
    columns : sequence of Signal
        Recorded columns that no other file declares.
    """
    lines = [
        '"""Effects without a name, found in measurements: give this file by --library."""',
        "",
        "from thermo.library.shape import shape_effect, shape_term",
    ]
    if columns:
        lines.append("from thermo.recording.signals import Signal")
    for one in shapes:
        shape = one.pattern.shape
        upper = one.name.upper()
        lines += ["", f"# {one.sentence}", f"{upper}_KNOTS = {_numbers(shape.knots)}"]
        lines += [f"{upper}_CURVES = ["]
        lines += [f"    {_numbers(curve)}," for curve in shape.curves]
        lines += [
            "]",
            "",
            "",
            f"def {one.name}():",
            "    return shape_term(",
            f"        {one.name!r}, {one.pattern.quantity!r}, {upper}_KNOTS, {upper}_CURVES,",
            f"        times={one.pattern.times!r},",
            f"        sentence={one.sentence!r},",
            "    )",
            "",
        ]
    lines += [
        "",
        f"TERMS = {{{', '.join(f'{o.name!r}: {o.name}' for o in shapes)}}}",
        "EFFECTS = [",
    ]
    lines += [
        f"    shape_effect({o.name!r}, {o.sentence!r}, {_numbers(o.pattern.shape.size)}),"
        for o in shapes
    ]
    lines += ["]"]
    if columns:
        lines += ["SIGNALS = ["]
        lines += [
            f"    Signal(name={c.name!r}, unit={c.unit!r}, sentence={c.sentence!r}, recorded=True),"
            for c in columns
        ]
        lines += ["]"]
    return "\n".join(lines) + "\n"


def _numbers(values: FloatArray) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in values.tolist()) + "]"
