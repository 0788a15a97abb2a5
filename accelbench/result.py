"""Result of a function of the Python entrance."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    import pandas as pd

    from accelbench.shell.plotting import Picture

T_co = TypeVar("T_co", covariant=True)
Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Result(Generic[T_co]):
    """Result of one command.

    Attributes
    ----------
    title : str
        What it is, in a line.
    found : object
        The values as the package below has them, for everything that the table does not hold.
    document : mapping
        The document that the command writes with --json, without what is of files alone.
    """

    title: str
    found: T_co
    document: Mapping[str, Any]
    rows: Callable[[], Iterable[Row]] = field()
    pictures: Callable[[], Iterable["Picture"]] = field()

    def __repr__(self) -> str:
        return f"<{self.title}>"

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the result's main table, one row a coefficient (or reading, or cycle)."""
        import pandas as pd

        return pd.DataFrame(list(self.rows()))

    def plot(self) -> tuple["Picture", ...]:
        """Draw the pictures of the command's report; a notebook shows them, `png` is their bytes.

        Returns
        -------
        tuple of Picture
            Empty where the command's report has none.
        """
        return tuple(self.pictures())


def no_pictures() -> tuple["Picture", ...]:
    """Return none: for commands whose report has no picture of what was found alone."""
    return ()


def coefficients_of(document: Mapping[str, Any]) -> list[Row]:
    """Return the coefficients of all accelerometers of a document as rows."""
    return [
        {"serial": one["serial"], **dict(c)}
        for one in document["accelerometers"]
        for c in named_rows(one["coefficients"])
    ]


def named_rows(parts: Any) -> list[Row]:
    """Return the coefficients of a document as rows with a name."""
    if isinstance(parts, Mapping):
        return [{"name": name, **dict(content)} for name, content in parts.items()]  # pyright: ignore
    return list(parts)
