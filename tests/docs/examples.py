"""Scripts of docs/examples as modules."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


def paper_script(name: str) -> ModuleType:
    """Import a script of the paper's examples, which import each other by name."""
    folder = str(EXAMPLES / "paper")
    sys.path.insert(0, folder)
    try:
        return import_module(name)
    finally:
        sys.path.remove(folder)
