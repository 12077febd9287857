"""Fit as stored in its folder, and its terminal output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from benchtool.core.errors import FileFormatError
from benchtool.core.fit_result import Estimate, FitResult, Outcome
from benchtool.data.run.entry import FIT_FILE, read_result
from benchtool.fit.compare import Comparison, Score
from benchtool.fit.law_scores import LawComparison, LawScore
from benchtool.fit.result_file import result_tables
from benchtool.fit.run_recipe import FitOutput
from benchtool.fit.uncertainty.budget import Budget, parse_budget, with_budget
from benchtool.report.fit.budget import budget_sentence, budget_table
from benchtool.report.fit.page import FIT, sentence_of
from benchtool.report.fit.tables import comparison_table, laws_table, methods_table, short_table
from benchtool.report.page import Block, Paragraph, Warnings

T = TypeVar("T")
SIMULATED = "SIMULATED DATA: no physical bench produced these points"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StoredFit:
    """Contents of result.json."""

    recipe: Mapping[str, Any]
    model: str
    rig: str  # "" if missing in the file
    basis: str
    simulated: bool
    read: int
    used: int
    left_out: tuple[str, ...]
    results: tuple[FitResult, ...]  # one per method; their samples are in samples.csv
    comparison: Comparison | None = None
    budget: Budget | None = None
    laws: LawComparison | None = None

    @property
    def sentence(self) -> str:
        names = ("model", "rig", "basis", "used", "read")
        return sentence_of(self.results[0], **{name: getattr(self, name) for name in names})

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(line for result in self.results for line in result.warnings))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Terminal output of `benchtool fit`, as blocks."""
        blocks: list[Block] = [Paragraph(SIMULATED)] if self.simulated else []
        blocks.append(Paragraph(self.sentence))
        for result in self.results:
            blocks += [short_table(result), Paragraph(f"{result.method}: {result.outcome.message}")]
        if len(self.results) > 1:
            blocks.append(methods_table(self.results))
        if self.budget is not None:
            blocks += [
                budget_table(self.budget, short=True),
                Paragraph(budget_sentence(self.budget)),
            ]
        if self.comparison is not None:
            blocks += [Paragraph(self.comparison.sentence), comparison_table(self.comparison)]
        if self.laws is not None:
            blocks += [Paragraph(self.laws.sentence), laws_table(self.laws)]
        return (*blocks, Warnings(self.warnings))


def to_stored_fit(output: FitOutput) -> StoredFit:
    """Return a fit in its stored form."""
    return stored_from(result_tables(output), FIT_FILE)


def read_stored(folder: Path) -> StoredFit:
    """Read the fit of a folder."""
    return stored_from(read_result(folder), str(folder / FIT_FILE))


def figure_files(folder: Path) -> dict[str, Path]:
    """Return the figure files of a folder by name, in the order of the report."""
    files = {name: folder / f"{name}.svg" for name in FIT.figures}
    return {name: path for name, path in files.items() if path.is_file()}


def stored_from(tables: Mapping[str, Any], where: str) -> StoredFit:
    """Parse the contents of a result.json; `where` is its location for error messages."""
    try:
        points = tables["points"]
        shared: dict[str, Any] = {"model": str(tables["model"]), "basis": str(tables["basis"])}
        results = tuple(
            _result(method, table, shared) for method, table in tables["results"].items()
        )
        if not results:
            raise FileFormatError(where, "results are empty; fit again")
        budget = parse_budget(tables["budget"]) if tables.get("budget") else None
        return StoredFit(
            recipe=tables["recipe"],
            rig=str(tables.get("rig", "")),
            simulated=bool(tables["simulated"]),
            read=int(points["read"]),
            used=int(points["used"]),
            left_out=tuple(points["left_out"]),
            results=with_budget(results, budget),
            comparison=_read_scores(Comparison, Score, tables.get("comparison")),
            budget=budget,
            laws=_read_scores(LawComparison, LawScore, tables.get("laws")),
            **shared,
        )
    except KeyError as error:
        raise FileFormatError(where, f"key {error} is missing; fit again") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(where, f"invalid fit result ({error}); fit again") from error


def _result(method: Any, table: Mapping[str, Any], shared: dict[str, Any]) -> FitResult:
    order, estimates, derived = table["order"], table["estimates"], table["derived"]
    return FitResult(
        method=method,
        estimates=tuple(_build(Estimate, estimates[name], name=name) for name in order),
        derived=tuple(_build(Estimate, item, name=name) for name, item in derived.items()),
        covariance=np.array(table["covariance"], float),
        chi2=_read(table["chi2"], float),
        dof=int(table["dof"]),
        log_likelihood=_read(table["log_likelihood"], float),
        outcome=Outcome(**table["outcome"]),
        warnings=tuple(table["warnings"]),
        facts=table["facts"],
        **shared,
    )


def _read_scores(cls: type[T], kind: type[Any], table: Mapping[str, Any] | None) -> T | None:
    if not table:
        return None
    counts = dict.fromkeys(("folds", "settings", "seed"), 0)  # optional in the file
    return _build(cls, counts | dict(table), scores=tuple(_build(kind, x) for x in table["scores"]))


def _build(cls: type[T], table: Mapping[str, Any], **values: Any) -> T:
    """Build a dataclass from a table by its field types; fields with defaults are optional."""
    record: Any = cls
    kinds = get_type_hints(cls)
    for item in fields(record):
        if item.name not in values and (item.default is MISSING or item.name in table):
            values[item.name] = _read(table[item.name], kinds[item.name])
    instance: T = cls(**values)
    return instance


def _read(value: Any, kind: Any) -> Any:
    """Convert a JSON value to its type; null means nan."""
    if get_origin(kind) is tuple:
        return tuple(_read(item, get_args(kind)[0]) for item in value)
    if kind is float:
        return float("nan") if value is None else float(value)
    return kind(value) if kind in (int, str) else value
