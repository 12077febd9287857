"""The report page of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchtool import __version__
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.data.run.read import is_run
from benchtool.data.run.run import Run
from benchtool.fit.compare import Comparison
from benchtool.fit.diagnose import lacks_something, times_as_much
from benchtool.fit.run_recipe import FitOutput
from benchtool.report.fit.tables import estimates_table, methods_table, printed
from benchtool.report.numbers import unit_for_people, value_with_sd
from benchtool.report.page import (
    Block,
    Commands,
    Facts,
    Figure,
    FigureBlock,
    Paragraph,
    Report,
    Section,
    Table,
    Warnings,
)
from benchtool.report.sweep.run_facts import simple_facts

CAPTIONS: dict[str, str] = {
    "ratio": (
        "Thrust near the plate over thrust far from it. Points: mean and standard deviation over "
        "repeats; solid line: the fitted model with its 68 % and 95 % bands; dashed: the closed "
        "image formulae (PFI)."
    ),
    "thrust": (
        "Thrust against rotor speed at each plate distance (lines: the fitted model), and what the "
        "model leaves over."
    ),
    "area": "How much of the full increment a partly covered disc makes.",
    "residuals": (
        "Measured minus model over the standard error: against distance, in the order of "
        "measurement, as a histogram, and as runs of equal sign."
    ),
    "corner": "Posterior draws, pair by pair; the least-squares answer is marked.",
    "chains": "Traces of the independently started ensembles; they must lie on each other.",
}
"""Caption of each figure that `fit_figures` may make, in the order of the page."""


def fit_sections(
    output: FitOutput, figures: Mapping[str, Figure], heading: str = ""
) -> tuple[Section, ...]:
    """Return the sections of one fit: answer, figures, comparison, what stands behind it."""
    name = heading or output.recipe.name
    warned = list(dict.fromkeys(line for result in output.results for line in result.warnings))
    answer: list[Block] = [
        Paragraph(sentence(output)),
        Warnings(warned),
        *(estimates_table(result) for result in output.results),
    ]
    if len(output.results) > 1:
        answer.append(methods_table(output.results))
    shown: list[Block] = [
        FigureBlock(figures[key], caption) for key, caption in CAPTIONS.items() if key in figures
    ]
    sections = [Section(f"{name}: fitted values", answer), Section(f"{name}: figures", shown)]
    if output.comparison is not None:
        sections.append(
            Section(
                f"{name}: models compared",
                [Paragraph(output.comparison.sentence + "."), comparison_table(output.comparison)],
            )
        )
    sections.append(Section(f"{name}: what stands behind it", [Facts(_facts(output))]))
    return (*sections, *_runs(output))


def _runs(output: FitOutput) -> list[Section]:
    """Say of every run that was fitted on what, in which air and with which calibration."""
    return [
        Section(
            f"The run {Path(path).resolve().name}",
            [Facts(simple_facts(Run.open(Path(path)).metadata))],
        )
        for path in output.data.hashes
        if is_run(path)
    ]


def fit_page(output: FitOutput, figures: Mapping[str, Figure], commands: Sequence[str]) -> Report:
    """Return the report page of one fit."""
    first = output.results[0]
    return Report(
        title=f"Fit: {output.recipe.name}",
        summary=sentence(output),
        sections=(*fit_sections(output, figures), Section("Made with", [Commands(commands)])),
        simulated=output.data.points.simulated,
        made=f"benchtool {__version__}",
        highlights={item.name: printed(item) for item in _telling(first)},
    )


MOST_TELLING = ("body_lift.K_b", "R_m", "k", "partial_coverage.factor_")
"""Parameters that a reader looks for first, by the beginning of their names."""


def _telling(result: FitResult) -> list[Estimate]:
    """Return up to four estimates, those that a fit is made for before nuisances and noise."""

    def rank(item: Estimate) -> int:
        for place, beginning in enumerate(MOST_TELLING):
            if item.name == beginning or (
                beginning.endswith("_") and item.name.startswith(beginning)
            ):
                return place
        return len(MOST_TELLING) + item.name.startswith("noise.")

    ranked = sorted((*result.estimates, *result.derived), key=rank)
    return [item for item in ranked if "share_" not in item.name][:4]


def sentence(output: FitOutput) -> str:
    """Say in one or two sentences what the fit found."""
    return sentence_of(
        output.results[0],
        model=output.loaded.model.name,
        rig=output.loaded.model.rig.name,
        basis=output.recipe.basis,
        used=len(output.data.rows),
        read=len(output.data.points),
    )


def sentence_of(first: FitResult, *, model: str, rig: str, basis: str, used: int, read: int) -> str:
    """Say in one or two sentences what a result found from so many points of so many read."""
    if first.outcome.status != "converged":
        return f"No answer to use from {used} of {read} points: {first.outcome.message}."
    said = ", ".join(
        f"{item.name} = {value_with_sd(item.value, item.sd)}"
        + ("" if item.unit == "1" else f" {unit_for_people(item.unit)}")
        + (f" ({item.bound})" if item.bound else "")
        for item in first.estimates
        if not item.name.startswith("noise.")
    )
    scatter = (
        f"points scatter {times_as_much(first)} as much as their stated errors (chi2/dof = "
        f"{first.chi2_per_dof:.3g})"
    )
    if lacks_something(first):
        scatter += ", so the model lacks something and the intervals are too narrow"
    judged = {
        "rejected": f" The model is rejected: {scatter}.",
        "scatter": f" {scatter[:1].upper()}{scatter[1:]}.",
        "consistent": f" The scatter explains what is left over: chi2/dof = "
        f"{first.chi2_per_dof:.3g}.",
    }.get(str(first.facts.get("verdict")), "")
    shown = "thrust itself (joint fit)" if basis == "joint" else basis
    on = f" on rig {rig}" if rig else ""
    return f"{used} of {read} points, model {model}{on}, basis {shown}: {said}.{judged}"


def comparison_table(comparison: Comparison) -> Table:
    """Return the models side by side, the best first."""
    rows = []
    for place, score in enumerate(comparison.scores):
        behind = "best" if place == 0 else "clearly behind" if score.clearly_behind else "close"
        rows.append(
            (
                score.model,
                behind,
                str(score.parameters),
                f"{score.chi2_per_dof:.3g}",
                f"{score.behind_best:.1f} ± {score.behind_best_se:.1f}",
                f"{score.held_out_rms:.4g}",
                f"{score.aic:.1f}",
                f"{score.bic:.1f}",
            )
        )
    held_out = f" in {comparison.folds} folds over {comparison.settings} settings"
    return Table(
        f"Held-out points{held_out if comparison.folds else ''}.",
        (
            "model",
            "verdict",
            "free",
            "χ²/dof",
            "log score behind best",
            "held-out RMS",
            "AIC",
            "BIC",
        ),
        rows,
        text_columns=2,
    )


def _facts(output: FitOutput) -> dict[str, str]:
    points, rig = output.data.points, output.loaded.model.rig
    facts = {
        "rig": f"{rig.name}: {rig.title}",
        "assumed numbers of the rig": f"{len(rig.assumed)} of {len(rig.sources)}",
        "wake rule": output.loaded.model.wake_rule,
        "b of eq. (4)": output.loaded.model.body_distance.replace("_", " "),
        "basis": output.recipe.basis,
        "noise": output.recipe.noise,
        "loss": output.recipe.loss,
        "seed": str(output.recipe.seed),
        "software": f"benchtool {__version__}",
    }
    facts |= {f"sha256 of {path}": digest for path, digest in output.data.hashes.items()}
    for result in output.results:
        facts[f"outcome of {result.method}"] = result.outcome.message
    repairs = points.provenance.get("repairs", "")
    if repairs:
        facts["repairs made while reading"] = repairs
    return facts
