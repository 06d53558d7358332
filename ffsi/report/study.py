"""A study that lies in a folder: its table, its points, its plots."""

from __future__ import annotations

import numbers
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ffsi.files import folder
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.result import study_definition
from ffsi.result.table import frame, place
from ffsi.text import cut

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


class Study:
    """A sweep's folder, finished or not.

    Args:
        directory: `out` of `ffsi.sweep`.

    Raises:
        InputError: it holds no sweep, or one that is damaged.
    """

    def __init__(self, directory: str | Path) -> None:
        """Read what the sweep is to solve and what was solved."""
        self.directory = path_of(directory, "directory")
        if not folder.is_sweep_folder(self.directory):
            why = "" if self.directory.exists() else folder.missing(self.directory)
            raise InputError(f"{self.directory} holds no sweep{why}")
        definition = study_definition.read(self.directory)
        self.keys: list[str] = list(definition["vary"])
        self.is_product: bool = definition["design"] == "product"
        self.points = study_definition.points_of(definition)
        self._known = {place(r.data["varied"], self.keys): r for r in Result.load_all(self.directory)}

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per point that is known, as `ffsi.sweep` returns it; `attrs["units"]` has the columns' units."""
        return frame(self.directory, self.keys, self.points, self._known)

    def result(self, row: int) -> Result:
        """Return the Result of a row of the table.

        Raises:
            InputError: there is no such row.
        """
        if isinstance(row, bool) or not isinstance(row, numbers.Integral) or not 0 <= row < len(self.table):
            raise InputError(f"row {cut(repr(row), 40)}: accepted: 0 to {len(self.table) - 1}")
        at = self.table.iloc[row]
        return load_result(self.directory / at["folder"], int(at["point"]))

    def plot(self, x: str, y: str, by: str | None = None) -> Figure:
        """Draw a quantity over a key, one line for each value of the key `by`.

        Raises:
            InputError: the table has no such column.
        """
        from ffsi.report.curves import plot

        for name, column in (("x", x), ("y", y), ("by", by)):
            if not isinstance(column, str) and (name != "by" or column is not None):
                raise InputError(f"{name} = {cut(repr(column), 40)}: accepted: the name of a column")
        return plot(self.table, x, y, by, self.table.attrs["units"])

    def to_xarray(self) -> xarray.Dataset:
        """Return the quantities of a product on the axes of its keys (needs the package xarray: extra `xarray`).

        Raises:
            InputError: xarray is not installed, or the study is no product.
        """
        if not self.is_product:
            raise InputError("the study is no product of values; its table is a plain one (Study.table)")
        try:
            import xarray  # noqa: F401
        except ImportError as error:
            raise InputError("to_xarray needs the package xarray: pip install xarray") from error
        data = self.table.set_index(self.keys).to_xarray()
        for name in (*data.data_vars, *data.coords):
            if name in (units := self.table.attrs["units"]):
                data[name].attrs["units"] = units[str(name)]
        return data

    def write_fields(self, rows: Iterable[int]) -> list[Path]:
        """Write pictures and VTU files of rows of the table into their folders; return the files.

        Raises:
            InputError: there is no such row, or it was not solved.
        """
        from ffsi.result import painting, views, vtu

        written: list[Path] = []
        if isinstance(rows, str) or not isinstance(rows, Iterable):
            raise InputError(f"rows = {cut(repr(rows), 40)}: accepted: several rows, such as [0, 3]")
        for row in rows:
            result = self.result(row)
            if result.state_file is None:
                raise InputError(f"row {row} has no fields: {result.reason}")
            path = result.directory / folder.numbered("fields.vtu", result.point)
            vtu.write_vtu(path, result.fields, {})
            written.append(path)
            for name in views.available(result.fields):
                path = result.directory / folder.numbered(f"{name}.png", result.point)
                path.write_bytes(painting.paint(name, result.fields, result.title))
                written.append(path)
        return written

    def __repr__(self) -> str:
        """Return folder, keys and how far it is."""
        from ffsi.result.words import tally

        return f"Study over {', '.join(self.keys)} in {self.directory}: {tally(self.table, len(self.points))[0]}"

    def _repr_html_(self) -> Any:
        return f"<p>{self!r}</p>{self.table.to_html()}"
