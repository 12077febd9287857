"""Script that writes benchtool/__init__.pyi, the stub of the Python interface.

Keywords of a function with options are those of its input dataclass.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from benchtool import __all__ as names
from benchtool import api

PAGE = Path(__file__).parents[2] / "benchtool" / "__init__.pyi"

HEAD = """# Written by docs/reference/write_stub.py from benchtool.api and its inputs.
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Literal

from benchtool.acquire.operator import Operator
from benchtool.core.choices import Over
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit
from benchtool.data.catalogue.query import RunSelection
from benchtool.explain.result import Explanation
from benchtool.fit.motor.constants import MotorFit
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.report.compare.page import RunComparison
from benchtool.report.compare.pooled import PooledFits
from benchtool.report.figure import look as figure_style
from benchtool.report.fit.result import Fit
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.replay.replay_source import ReplaySource
from benchtool.report.result import Data, Result
from benchtool.report.sweep.run import SweepRun
from benchtool.simulate.controllers.controller import Controllers
from benchtool.simulate.flight.study import FlownCase
from benchtool.simulate.flight.study import fly_and_measure as fly
"""

MAX_WIDTH = 100


def page() -> str:
    """Return the text of the stub."""
    functions = [getattr(api, name) for name in sorted(names) if name != "__version__"]
    written = [item for item in functions if inspect.isfunction(item) and item.__name__ in names]
    listed = "\n".join(f'    "{name}",' for name in names)
    head = f"{HEAD}\n__all__ = [\n{listed}\n]\n__version__: str\n"
    head += "\nclass CallablePackage(ModuleType): ...\n"
    return "\n".join([head, *map(stub, written)])


def stub(function: Any) -> str:
    """Return the definition of a function, with a line and the help of each keyword."""
    signature = inspect.signature(function)
    helps = getattr(function, "keyword_help", {})
    lines, has_star = [], False
    for item in signature.parameters.values():
        if item.kind is item.VAR_POSITIONAL:
            has_star = True
        elif item.kind is item.KEYWORD_ONLY and not has_star:
            lines.append("    *,")
            has_star = True
        text = str(item.replace(annotation=item.empty, default=item.empty))
        default = "" if item.default is item.empty else f" = {value(item.default)}"
        line = f"    {text}: {item.annotation}{default},".replace("'", '"')
        comment = f"# {helps[item.name]}" if item.name in helps else ""
        if len(line) + len(comment) + 2 <= MAX_WIDTH:
            lines.append(f"{line}  {comment}".rstrip())
        else:
            lines += [f"    {comment}", line] if comment else [line]
    returns = re.sub(r"\b\w+\.", "", signature.return_annotation)
    first = inspect.getdoc(function).partition("\n")[0]
    return "\n".join([f"def {function.__name__}(", *lines, f') -> {returns}:\n    """{first}"""\n'])


def value(default: object) -> str:
    """Return the text of a default; functions are omitted."""
    return "..." if callable(default) else repr(default)


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
