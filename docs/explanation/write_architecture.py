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

# Extension, registry and section of extend.md.
REGISTRIES = (
    ("an effect", "one file in `benchtool/physics/effects/`", "effects"),
    ("a driver", "`DRIVERS` in `benchtool/bench/drivers.py`", "drivers"),
    ("an importer", "`FORMATS` in `benchtool/data/formats/formats.py`", "importers"),
    ("a control law", "`LAWS` in `benchtool/simulate/controllers/laws.py`", "control-laws"),
    ("a figure", "`@figure` in `benchtool/report/`, and its page", "figures"),
    ("a command", "`COMMANDS` in `benchtool/commands/app.py`", "options"),
    ("an option", "a field of the command's inputs", "options"),
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
    registries = "\n".join(
        f"| {what} | {where} | [extend](../how-to/extend.md#{listed}) |"
        for what, where, listed in REGISTRIES
    )
    return (
        f"{HEAD}{diagram}\n```\n\n| package | contents |\n|---|---|\n{packages}\n"
        f"| `library` | Rigs, models, gains, plans and the Arduino sketch; no Python. |\n\n"
        f"## Data types\n\nFrom byte to figure:\n\n{data}\n\n"
        f"## Registries\n\n| extension | registry | how to |\n|---|---|---|\n{registries}\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
