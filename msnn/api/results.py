"""Shows a result: short text, tables in a notebook, a data frame, a plot."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, overload

from msnn.packages import PANDAS
from msnn.tables import Table


@dataclass(frozen=True, slots=True, repr=False)
class Picture:
    """A plot as PNG bytes, which a notebook displays as the last value of a cell."""

    png: bytes

    def __repr__(self) -> str:
        return f"<Picture, {len(self.png):,} bytes of PNG>"

    def _repr_png_(self) -> bytes:
        return self.png


class Shown:
    """A result that a notebook shows as tables; subclasses define the private methods below."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<{self._said()}>"

    def __str__(self) -> str:
        return "\n\n".join(filter(None, (table.text for table in self._tables())))

    def _repr_html_(self) -> str:
        """The tables for a notebook."""
        tables = "".join(_html(table) for table in self._tables() if table.rows)
        return f"<p>{escape(self._said())}</p>{tables}"

    def to_frame(self) -> Any:
        """A pandas DataFrame with numeric columns. MissingExtraError without pandas."""
        PANDAS.require("makes frames of results")
        return import_module("pandas").DataFrame(self._columns())

    @overload
    def plot(self, path: None = None) -> Picture: ...
    @overload
    def plot(self, path: str | Path) -> Path: ...
    def plot(self, path: str | Path | None = None) -> Picture | Path:
        """Plots into a file (`.png`, `.svg`, `.pdf`), or as picture for a notebook.

        MissingExtraError without matplotlib.
        """
        if path is not None:
            return self._draw(Path(path))
        with TemporaryDirectory() as folder:
            return Picture(self._draw(Path(folder) / "picture.png").read_bytes())

    @abstractmethod
    def _said(self) -> str:
        """The result in one line of text."""

    @abstractmethod
    def _tables(self) -> Sequence[Table]:
        """The tables of the result, as the command line prints them."""

    @abstractmethod
    def _columns(self) -> Mapping[str, Sequence[object]]:
        """The columns of the result as a data frame, by name."""

    @abstractmethod
    def _draw(self, path: Path) -> Path:
        """Draws the result into a file, in the format of its suffix; returns the path."""


def _html(table: Table) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "".join(
            f'<{tag} style="text-align: {"right" if i in table.numbers else "left"}">'
            f"{escape(cells[i])}</{tag}>"
            for i in table.filled
        )

    body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in table.rows)
    return f"<table><thead><tr>{row(table.header, 'th')}</tr></thead><tbody>{body}</tbody></table>"
