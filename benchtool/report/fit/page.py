"""Report page and output folder of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchtool import __version__
from benchtool.core.errors import WouldOverwrite
from benchtool.core.text import pluralize
from benchtool.data.atomic import make_folder
from benchtool.fit.diagnose import format_scatter_ratio, has_misfit
from benchtool.fit.result_file import write_result
from benchtool.fit.run_recipe import FitOutput, FitSummary
from benchtool.report.fit.budget import budget_blocks, budget_sentence, budget_table, main_sources
from benchtool.report.fit.tables import (
    comparison_table,
    estimates_table,
    laws_table,
    methods_table,
    name_with_unit,
    printed,
    short_table,
    wanted_rank,
)
from benchtool.report.page import Block, Page, Warnings
from benchtool.report.run_facts import run_sections

MAX_ROWS = 10  # of the table of a short output
SIMULATED = "SIMULATED DATA: no physical bench produced these points"


def _results(fit: FitOutput) -> list[Block]:
    methods = [methods_table(fit.results)] if len(fit.results) > 1 else []
    return [sentence(fit), Warnings(fit.warnings), *map(estimates_table, fit.results), *methods]


def _comparisons(fit: FitSummary, end: str = ".") -> list[Block]:
    blocks: list[Block] = []
    if fit.comparison is not None:
        blocks += [fit.comparison.sentence + end, comparison_table(fit.comparison)]
    if fit.laws is not None:
        blocks += [fit.laws.sentence + end, laws_table(fit.laws)]
    return blocks


def _facts(fit: FitOutput) -> dict[str, str]:
    rig = fit.loaded.model.rig
    n_sources = len(rig.sources) - len(rig.not_stated)
    facts = {
        "rig": f"{rig.name}: {rig.title}",
        "assumed numbers of the rig": f"{len(rig.assumed)} of {n_sources}",
        "missing numbers of the rig": str(len(rig.not_stated)),
        "wake rule": fit.loaded.model.wake_rule,
        "tilt rule": fit.loaded.model.tilt_rule,
        "b of eq. (4)": fit.loaded.model.body_distance.replace("_", " "),
        "basis": fit.basis,
        "noise": fit.recipe.noise,
        "loss": fit.recipe.loss,
        "seed": str(fit.recipe.seed),
        "software": f"benchtool {__version__}",
    }
    facts |= {f"sha256 of {path}": digest for path, digest in fit.data.hashes.items()}
    facts |= {f"outcome of {result.method}": result.outcome.message for result in fit.results}
    if repairs := fit.data.points.provenance.get("repairs", ""):
        facts["repairs made while reading"] = repairs
    return facts


def _highlights(fit: FitOutput) -> dict[str, str]:
    """Return up to four estimates, main quantities before nuisance parameters and noise."""
    result = fit.results[0]
    estimates = [*result.estimates, *result.derived]
    ranked = sorted(
        (item for item in estimates if "share_" not in item.name),
        key=lambda item: (wanted_rank(item.name), item.name.startswith("noise.")),
    )
    return {name_with_unit(item.name, item.unit): printed(item) for item in ranked[:4]}


FIT = Page(
    "fit",
    [
        ("{0.recipe.name}: fitted values", [_results]),
        (
            "{0.recipe.name}: figures",
            ["ratio", "thrust", "area", "residuals", "laws", "corner", "chains"],
        ),
        ("{0.recipe.name}: uncertainty budget", [lambda fit: budget_blocks(fit.budget), "budget"]),
        ("{0.recipe.name}: models compared", [_comparisons]),
        ("{0.recipe.name}: what stands behind it", [_facts]),
        lambda fit: run_sections(fit.data.hashes),
    ],
    title="Fit: {0.recipe.name}",
    summary=lambda fit: sentence(fit, short=True),
    highlights=_highlights,
)


def refuse_full(folder: Path, option: str = "") -> None:
    """Raise WouldOverwrite if the folder is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise WouldOverwrite(str(folder), option)


def write_fit(folder: Path, fit: FitOutput, commands: Sequence[str] = ()) -> Path:
    """Write all results of a fit into a new folder and return its report page."""
    refuse_full(folder)
    make_folder(folder)
    write_result(folder, fit)
    return FIT.write(folder, fit, commands)[0]


def figure_files(folder: Path) -> dict[str, Path]:
    """Return the figure files of a folder by name, in the order of the report."""
    files = {name: folder / f"{name}.svg" for name in FIT.figures}
    return {name: path for name, path in files.items() if path.is_file()}


def terminal_blocks(fit: FitSummary) -> list[Block]:
    """Return the terminal output of `benchtool fit`: sentence, tables, warnings."""
    blocks: list[Block] = [SIMULATED] if fit.simulated else []
    blocks.append(sentence(fit))
    for result in fit.results:
        blocks += [short_table(result), f"{result.method}: {result.outcome.message}"]
    if len(fit.results) > 1:
        blocks.append(methods_table(fit.results))
    if fit.budget is not None:
        blocks += [budget_table(fit.budget, short=True), budget_sentence(fit.budget)]
    return [*blocks, *_comparisons(fit, end=""), Warnings(fit.warnings)]


def summary_blocks(fit: FitSummary) -> list[Block]:
    """Return the terminal output of `benchtool fit` on one screen: verdict, values, one caution."""
    first, *others = fit.results
    blocks: list[Block] = [SIMULATED] if fit.simulated else []
    blocks.append(sentence(fit, short=True))
    table = short_table(first).select_columns(range(4))
    rows = sorted(table.rows, key=lambda row: wanted_rank(row[0]))[:MAX_ROWS]
    blocks += [replace(table, rows=rows), *main_sources(fit.budget)]
    blocks += [f"{result.method}: {result.outcome.message}" for result in others]
    blocks += _comparisons(fit, end="")  # were asked for
    # The error after the output says that a model is rejected.
    warnings = [line for line in fit.warnings if "is rejected" not in line]
    hidden = {"more parameter": len(table.rows) - len(rows), "more warning": len(warnings) - 1}
    texts = [pluralize(count, noun) for noun, count in hidden.items() if count > 0]
    texts += ["statistical errors"] + ["the uncertainty budget"] * (fit.budget is not None)
    return [*blocks, Warnings(warnings[:1]), f"--verbose prints {', '.join(texts)}"]


def sentence(fit: FitSummary, *, short: bool = False) -> str:
    """Return a summary of a fit in one or two sentences; `short`: without its values."""
    first = fit.results[0]
    if first.outcome.status != "converged":
        return f"No valid result from {fit.used} of {fit.read} points: {first.outcome.message}."
    values = ", ".join(
        f"{item.name} not determined" if item.open else f"{item.name} = {printed(item, item.unit)}"
        for item in first.estimates
        if not item.name.startswith("noise.")
    )
    scatter = (
        f"points scatter {format_scatter_ratio(first)} as much as their stated errors (chi2/dof = "
        f"{first.chi2_per_dof:.3g})"
    )
    if has_misfit(first):
        scatter += ", so the model is incomplete and the intervals are too narrow"
    verdict = {
        "rejected": f" The model is rejected: {scatter}.",
        "scatter": f" {scatter[:1].upper()}{scatter[1:]}.",
        "consistent": f" Residuals agree with the scatter: chi2/dof = {first.chi2_per_dof:.3g}.",
    }.get(str(first.facts.get("verdict")), "")
    if short and "rejected" in verdict:
        verdict = " The model is rejected."  # the error after the output has the numbers
    basis = "thrust itself (joint fit)" if fit.basis == "joint" else fit.basis
    rig = f" on rig {fit.rig}" if fit.rig else ""
    return (
        f"{fit.used} of {fit.read} points, model {fit.model}{rig}, basis {basis}"
        f"{'' if short else f': {values}'}.{verdict}"
    )
