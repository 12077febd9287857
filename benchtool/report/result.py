"""Result of a Python API call, with text, figures, tables and page."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.fit_result import Estimate
from benchtool.data.atomic import write_if_new
from benchtool.data.columns import rows_to_frame, table_to_csv
from benchtool.report.figure import figure_bytes, render_figures
from benchtool.report.page import PAGE, Page, inline_svg, write_report

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from benchtool.explain.result import Explanation
    from benchtool.fit.run_recipe import FitOutput

Found = TypeVar("Found")
R = TypeVar("R", bound="Result[Any]")
MAX_REPR_LINES = 6


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Result(Generic[Found]):
    """Result of a call; it can be shown as text, figures, tables or a page.

    Examples
    --------
    >>> import benchtool as bt
    >>> result = bt.read({"time_s": [0.0, 0.5], "thrust_N": [0.0, 1.0]})
    >>> result.tables
    ('samples',)
    """

    found: Found
    path: Path | None = None  # run or recording that was read, if any
    _page: Page
    _summary: Callable[[Found], str]
    _tables: Mapping[str, Callable[[Found], pd.DataFrame]] = field(default_factory=dict)
    _write: Callable[[Path, Found, Sequence[str]], Iterable[Path]] | None = None

    def summary(self) -> str:
        """Return a summary in a few sentences or lines."""
        return self._summary(self.found)

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables that `to_dataframe` returns."""
        return tuple(self._tables)

    def to_dataframe(self, table: str = "") -> pd.DataFrame:
        """Return a table by name; default: the first of `tables`. Units are in `.attrs`."""
        name = table or self.tables[0]
        if name not in self._tables:
            raise UnknownChoice("table", name, self._tables)
        return self._tables[name](self.found)

    def figures(self) -> dict[str, Figure]:
        """Return all figures of the report page, by name."""
        blocks = render_figures(self._page.name, self.found, self._page.figures)
        return {name: block.figure for name, block in blocks.items()}

    def plot(self, figure: str = "") -> Figure:
        """Return a figure by name; default: the first figure of the report page."""
        for name in [figure] if figure else self._page.figures:
            for block in render_figures(self._page.name, self.found, [name]).values():
                return block.figure
        raise InputError(
            f"figure {figure!r} has no data in this result"
            if figure
            else "this result has no figures"
        )

    def report(self, path: str | Path, commands: Sequence[str] = ()) -> Path:
        """Write the report page, one self-contained HTML file, and return its path.

        Raises
        ------
        WouldOverwrite
            The file exists.
        """
        return write_report(Path(path), self._page.report(self.found, commands))

    def save(self, folder: str | Path, commands: Sequence[str] = ()) -> list[Path]:
        """Write the output of the command's ``--out`` into a new folder; return all files.

        The main files are first. Results without such an output write only their report page.

        Raises
        ------
        WouldOverwrite
            The folder is not empty or a file exists.
        """
        folder = Path(folder)
        if self._write is None:
            return [self.report(folder / PAGE, commands)]
        before = _modified_ns(folder)
        main = list(self._write(folder, self.found, commands))
        changed = sorted(path for path, _ in _modified_ns(folder) - before)
        return [*dict.fromkeys((*main, *changed))]

    def __repr__(self) -> str:
        lines = self.summary().splitlines()
        if len(lines) > MAX_REPR_LINES:
            kept = MAX_REPR_LINES - 1
            lines[kept:] = [f"... and {len(lines) - kept} lines of summary()"]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return summary, first table and first figure for a notebook."""
        from html import escape

        parts = [f"<pre style='white-space: pre-wrap'>{escape(self.summary())}</pre>"]
        if self._tables:
            parts.append(str(self.to_dataframe().head(12).to_html(float_format="{:.5g}".format)))
        with suppress(InputError):  # nothing to draw
            parts.append(inline_svg(figure_bytes(self.plot()), f"bt{id(self)}"))
        return "<div>" + "\n".join(parts) + "</div>"


def _modified_ns(folder: Path) -> set[tuple[Path, int]]:
    """Return the files of a folder with their times of modification."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {(path, path.stat().st_mtime_ns) for path in files}


def save_if_requested(result: R, out: str | Path | None) -> R:
    """Write a result if a folder is given, and return it."""
    if out is not None:
        result.save(out)
    return result


# Path of a run folder or file, result of `read`, data frame, or arrays by column name
Data: TypeAlias = "str | Path | Result[Any] | pd.DataFrame | Mapping[str, Any]"


def saved_paths(data: Data | Sequence[Data]) -> tuple[str, ...]:
    """Return the paths of one or several data sets; a table in memory is written to a CSV file."""
    is_one = isinstance(data, str | Path | Result) or _is_table(data)
    items: Any = (data,) if is_one else data
    if isinstance(items, Iterable):
        return tuple(str(_saved_path(item)) for item in items)
    raise _not_data(data)


def _saved_path(item: Any) -> Path | str:
    if _is_table(item):
        return write_if_new(temporary_folder() / "table.csv", table_to_csv(item))[0]
    path = item.path if isinstance(item, Result) else item
    if path is None and item._page.name == "flight.pitch":  # noqa: SLF001
        files = item.save(mkdtemp(dir=temporary_folder()))
        path, *others = [file for file in files if file.suffix == ".csv"]
        if others:
            raise InputError("this result has several recordings; simulate one controller")
    if path is None:
        raise InputError("this result was not read from a file; give the path of its data")
    if not isinstance(path, str | Path):
        raise _not_data(item)
    return path


def _is_table(data: object) -> bool:
    return isinstance(data, Mapping) or (hasattr(data, "to_csv") and hasattr(data, "columns"))


def _not_data(item: object) -> InputError:
    return InputError(
        f"data are {type(item).__name__}; give paths, results of bt.read, data frames, or "
        f"mappings of column names to arrays"
    )


@cache
def temporary_folder() -> Path:
    """Return the folder of tables in memory and their column maps; deleted at exit."""
    folder = Path(mkdtemp(prefix="benchtool-"))
    atexit.register(rmtree, folder, ignore_errors=True)
    return folder


def estimates_frame(output: FitOutput) -> pd.DataFrame:
    """Return estimates and derived values of all methods."""
    rows = [
        {"method": result.method} | estimate_row(item)
        for result in output.results
        for item in (*result.estimates, *result.derived)
    ]
    return rows_to_frame(rows)


def estimate_row(item: Estimate) -> dict[str, Any]:
    """Return one estimate as a row of a table."""
    low, high = item.interval_95
    return {
        "parameter": item.name, "value": item.value, "combined_sd": item.combined_sd,
        "combined_low_95": item.combined_95[0], "combined_high_95": item.combined_95[1],
        "sd": item.sd, "low_95": low, "high_95": high, "unit": item.unit,
        "remark": item.open or item.bound,
    }  # fmt: skip


def effects_frame(answer: Explanation) -> pd.DataFrame:
    """Return the parameters of the effects that a verdict names."""
    columns = ("value", "std", "low", "high", "tolerance", "unit")
    rows = [
        {"effect": effect.name, "probability": effect.probability, "parameter": item.name}
        | {name: getattr(item, name) for name in columns}
        for effect in answer.effects
        for item in effect.parameters
    ]
    return rows_to_frame(rows)


def gap_frame(answer: Explanation) -> pd.DataFrame:
    """Return the gap of each channel before and after."""
    columns = ("channel", "unit", "as_given", "before", "after", "floor")
    return rows_to_frame([{name: getattr(gap, name) for name in columns} for gap in answer.gaps])


def probabilities_frame(answer: Explanation) -> pd.DataFrame:
    """Return all explanations with probability, most probable first."""
    ranked = sorted(answer.probabilities.items(), key=lambda pair: -pair[1])
    return rows_to_frame([{"explanation": name, "probability": p} for name, p in ranked])
