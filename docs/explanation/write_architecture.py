"""Write architecture.md: python docs/explanation/write_architecture.py"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = Path(__file__).with_name("architecture.md")

HEAD = """# Architecture

Written by `python docs/explanation/write_architecture.py` (tested) from the layers contract in
`pyproject.toml` and the first line of every package.

## Layers

A package imports only from packages on lines below its own; packages on one line do not see each
other. `make lint` checks it.

```text
"""

CARRIERS = (
    ("benchtool/bench/bench.py", "Readings", "what a driver has received, on the bench's clock"),
    (
        "benchtool/core/recording.py",
        "Recording",
        "channels with units over rows: samples, points, imports",
    ),
    ("benchtool/physics/conditions.py", "Conditions", "what a model needs to predict rows"),
    ("benchtool/physics/effects/effect.py", "Flow", "what a hook of an effect sees"),
    ("benchtool/core/fit_result.py", "FitResult", "estimates, covariance and diagnosis of a fit"),
    (
        "benchtool/explain/engine/verdict.py",
        "Verdict",
        "which effect is missing, how probable, and its rivals",
    ),
    (
        "benchtool/report/figure.py",
        "FigureEntry",
        "a drawing function with its page, caption and condition",
    ),
)
"""File, class and meaning of the types that carry data from byte to figure, in that order."""

REGISTRIES = (
    ("an effect", "one file in `benchtool/physics/effects/`", "write-an-effect"),
    ("a driver", "`DRIVERS` in `benchtool/bench/drivers.py`", "write-a-driver"),
    ("an importer", "`FORMATS` in `benchtool/data/formats/formats.py`", "write-an-importer"),
    ("a control law", "`LAWS` in `benchtool/simulate/controllers/laws.py`", "write-a-controller"),
    ("a figure", "`@figure` in `benchtool/report/`, and its page", "write-a-figure"),
    ("a command", "`COMMANDS` in `benchtool/commands/app.py`", "write-an-option"),
    ("an option", "a field of the command's inputs", "write-an-option"),
)
"""What can be added, where it registers, and the page that shows how."""


def layers() -> list[list[str]]:
    """Return the floors from the top down, each a list of packages."""
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
    floors = layers()
    picture = "\n     |\n     v\n".join("  |  ".join(floor) for floor in floors)
    rooms = "\n".join(f"| `{room}` | {first_line(room)} |" for floor in floors for room in floor)
    for file, name, _ in CARRIERS:
        assert f"class {name}" in (ROOT / file).read_text("utf-8"), f"{name} is not in {file}"
    data = "\n".join(
        f"{number}. [`{name}`](../reference/python.md#{file.removesuffix('.py').replace('/', '.')}"
        f".{name}) in `{file}`: {meaning}."
        for number, (file, name, meaning) in enumerate(CARRIERS, 1)
    )
    members = "\n".join(
        f"| {what} | {where} | [{listed}](../how-to/{listed}.md) |"
        for what, where, listed in REGISTRIES
    )
    return (
        f"{HEAD}{picture}\n```\n\n| package | holds |\n|---|---|\n{rooms}\n"
        f"| `library` | Rigs, models, gains, plans, the Arduino sketch: no Python. |\n\n"
        f"## The data's way\n\nData passes from byte to figure through few types:\n\n{data}\n\n"
        f"## What can be added\n\n| what | registers in | how |\n|---|---|---|\n{members}\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
