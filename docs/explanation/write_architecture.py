"""Write architecture.md: python docs/explanation/write_architecture.py"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = Path(__file__).with_name("architecture.md")

HEAD = """# Architecture

This page lists the packages, the types that carry data, and the registries. It is written by
`python docs/explanation/write_architecture.py` (tested).

## Layers

A package imports only from packages on lower lines, never from its own line (`make lint`).

```text
"""

# File, class and meaning of the types that carry data, from byte to figure.
CARRIERS = (
    ("benchtool/bench/bench.py", "Readings", "samples from a driver, in bench time"),
    (
        "benchtool/core/recording.py",
        "Recording",
        "table of channels with units and provenance",
    ),
    ("benchtool/physics/conditions.py", "Conditions", "inputs of a model's prediction, by row"),
    ("benchtool/physics/effects/effect.py", "Flow", "flow state passed to the hooks of effects"),
    ("benchtool/core/fit_result.py", "FitResult", "estimates, covariance and diagnosis of a fit"),
    (
        "benchtool/explain/result.py",
        "Explanation",
        "missing effects with probabilities and alternatives",
    ),
    (
        "benchtool/report/figure.py",
        "FigureEntry",
        "drawing function with page, caption and condition",
    ),
)

# Name of a way through the code and its steps: file, function or class, and what it does.
WALKS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "A sweep": (
        ("commands/sweep.py", "sweep", "reads the options into `SweepInputs`"),
        ("acquire/session.py", "build_experiment", "resolves plan and rig"),
        ("acquire/session.py", "run_experiment", "opens the bench; closes the run in every case"),
        ("bench/drivers.py", "open_bench", "selects the driver by the address"),
        ("bench/guard.py", "GuardedBench", "checks limits, age and order of all readings"),
        ("acquire/session.py", "acquire", "checks, arms, creates the run folder, records"),
        ("acquire/check_plan.py", "check_plan", "compares the plan with rig and device limits"),
        ("acquire/sweep.py", "Sweep", "tares, moves the plate, ramps, waits, measures"),
        ("bench/stage/stage.py", "PlateStage", "moves the plate, after a confirmed standstill"),
        ("acquire/measure.py", "VisitWatch", "checks the samples of a point"),
        ("acquire/measure.py", "measure", "averages the samples into a `Point`"),
        ("acquire/record.py", "Recorder", "reads the bench and writes all files of the run"),
        ("data/run/run_writer.py", "RunWriter", "appends to samples.csv, points.csv and events"),
        (
            "bench/standstill.py",
            "StandstillMonitor",
            "confirms from readings that the rotors stand",
        ),
        (
            "acquire/experiment.py",
            "Experiment",
            "ramps down; after an error or Ctrl-C commands zero first",
        ),
        ("data/run/run.py", "Run", "closes the run: metadata, Parquet, hashes"),
    ),
    "A recipe": (
        ("commands/fit.py", "fit", "reads the options into a `Recipe`"),
        ("results.py", "fit_result", "runs the recipe; its result saves the report"),
        ("fit/run_recipe.py", "run_recipe", "runs all steps below"),
        ("fit/fit_data.py", "read_fit_data", "reads the points into `FitData`"),
        ("physics/model_file.py", "load_model", "reads the model"),
        ("fit/model_problem.py", "problem_from_model", "joins both into a `Problem`"),
        ("fit/least_squares.py", "fit_least_squares", "minimises the residuals"),
        ("fit/ensemble.py", "fit_ensemble", "samples the posterior with emcee"),
        ("fit/diagnose.py", "with_diagnosis", "tests the residuals"),
        ("fit/uncertainty/propagation.py", "propagate", "propagates all errors of the bench"),
        ("report/fit/page.py", "write_fit", "writes result, model, figures and page"),
    ),
    "A thrust sample": (
        ("bench/serial/frames.py", "Decoder", "decodes bytes into `Readings`"),
        ("bench/serial/bench.py", "SerialBench", "converts device time to bench time"),
        ("bench/guard.py", "GuardedBench", "checks the limits, passes the readings on"),
        ("acquire/record.py", "Recorder", "writes samples.csv"),
        ("acquire/record.py", "Samples", "joins the readings of a point into a `Recording`"),
        ("acquire/measure.py", "measure", "averages the `Recording` into a `Point`"),
        ("data/run/points.py", "PointWriter", "writes points.csv"),
        ("data/run/read.py", "read_points", "reads points.csv into a `Recording`"),
        ("fit/fit_data.py", "read_fit_data", "selects rows and adds errors: `FitData`"),
        (
            "fit/model_problem.py",
            "problem_from_model",
            "forms ratios or thrusts and the model: `Problem`",
        ),
        ("fit/least_squares.py", "fit_least_squares", "estimates the parameters: `FitResult`"),
        ("report/fit/figures.py", "ratio", "draws thrust ratio against distance"),
    ),
}

WALKS_HEAD = """## Three ways through the code

Paths are relative to `benchtool/`. Values that a user sets are in plan, rig and options; assumed
times and thresholds are constants at the top of the module that uses them.

"""

# What to change, file, function or class.
PLACES = (
    ("limits of a run: temperature, current, silence", "bench/limit_check.py", "LimitCheck"),
    ("solver of least squares", "fit/solve.py", "solve"),
    ("verdict of an explanation", "explain/engine/posterior.py", "judge"),
    ("next experiment", "explain/engine/design.py", "select_design"),
    ("watchdog of a device", "bench/bench.py", "DeviceInfo"),
    ("virtual device", "virtual/firmware.py", "Firmware"),
    ("STOP of the page, after `web/static/stop.js`", "web/sockets.py", "serve_control_sockets"),
    ("process that drives the bench of the page", "web/bench_process/process.py", "BenchProcess"),
)

# Extension, registry and section of extend.md.
REGISTRIES = (
    ("an effect", "one file in `benchtool/physics/effects/`", "effects"),
    ("a driver", "`DRIVERS` in `benchtool/bench/drivers.py`", "drivers"),
    ("an importer", "`FORMATS` in `benchtool/data/formats/formats.py`", "importers"),
    ("a control law", "`LAWS` in `benchtool/simulate/controllers/laws.py`", "control-laws"),
    ("a figure", "`@figure` in `benchtool/report/`, and its page", "figures"),
    ("a command", "`COMMANDS` in `benchtool/commands/app.py`", "options"),
    (
        "an option",
        "a field of the command's inputs, such as `SweepInputs` in `benchtool/acquire/inputs.py`",
        "options",
    ),
)


def layers() -> list[list[str]]:
    """Return the layers from the top down, each a list of packages."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    contract = project["tool"]["importlinter"]["contracts"][0]
    return [[name.strip(" ()") for name in line.split("|")] for line in contract["layers"]]


def first_line(package: str) -> str:
    """Return the first line of a package's docstring, or of a module of that name."""
    folder = ROOT / "benchtool" / package
    file = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    return (ast.get_docstring(ast.parse(file.read_text("utf-8"))) or "").split("\n")[0]


def walk(steps: tuple[tuple[str, str, str], ...]) -> str:
    """Return the numbered steps of a way through the code; each must exist."""
    for file, name, _ in steps:
        text = (ROOT / "benchtool" / file).read_text("utf-8")
        assert f"def {name}(" in text or f"class {name}" in text, f"{name} is not in {file}"
    return "\n".join(
        f"{number}. `{file}`: `{name}` {meaning}."
        for number, (file, name, meaning) in enumerate(steps, 1)
    )


def page() -> str:
    """Return the page."""
    layer_list = layers()
    diagram = "\n".join("  |  ".join(layer) for layer in layer_list)
    packages = "\n".join(
        f"| `{name}` | {first_line(name)} |" for layer in layer_list for name in layer
    )
    for file, name, _ in CARRIERS:
        assert f"class {name}" in (ROOT / file).read_text("utf-8"), f"{name} is not in {file}"
    data = "\n".join(
        f"{number}. [`{name}`](../reference/python.md#{file.removesuffix('.py').replace('/', '.')}"
        f".{name}) in `{file}`: {meaning}."
        for number, (file, name, meaning) in enumerate(CARRIERS, 1)
    )
    walks = "\n\n".join(f"### {title}\n\n{walk(steps)}" for title, steps in WALKS.items())
    for _, file, name in PLACES:
        walk(((file, name, ""),))
    places = "\n".join(f"| {what} | `{file}`: `{name}` |" for what, file, name in PLACES)
    registries = "\n".join(
        f"| {what} | {where} | [extend](../how-to/extend.md#{listed}) |"
        for what, where, listed in REGISTRIES
    )
    return (
        f"{HEAD}{diagram}\n```\n\n| package | contents |\n|---|---|\n{packages}\n"
        f"| `library` | Rigs, models, gains, plans and the Arduino sketch; no Python. |\n\n"
        f"## Data types\n\nFrom byte to figure:\n\n{data}\n\n"
        f"{WALKS_HEAD}{walks}\n\n"
        f"## Other places\n\n| to change | open |\n|---|---|\n{places}\n"
        f"| default gains, rigs, models and plans | `library/` |\n\n"
        f"## Registries\n\n| extension | registry | how to |\n|---|---|---|\n{registries}\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
