"""Spell out a set of effects as a Python module, so that a compiled loop can call every hook.

A compiled loop cannot walk a list of effects: each call must stand in its source. So the calls are
written out, one line per hook, into a small module that imports the hooks from where they live.
The module is kept in a cache folder whose name holds a digest of all the sources that take part;
what numba compiles is kept beside it and is found again by every later process. The loops
themselves are ordinary source (`pitch_kernel`); the module hands them the spelled-out hooks.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from benchtool.core.errors import InputError
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import compiled_folder, expression


class Spelling:
    """Collect imports and write calls of one effect after the other."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = tuple(effects)
        self._imports: dict[tuple[str, str], str] = {}

    def name_of(self, hook: Callable[..., Any]) -> str:
        """Return the name under which the module knows a hook, importing it once."""
        key = (hook.__module__, hook.__qualname__)
        if "." in hook.__qualname__ or "<" in hook.__qualname__:
            raise InputError(
                f"the hook {hook.__qualname__} of {hook.__module__} is no function of its module; "
                f"simulations need hooks that can be imported"
            )
        return self._imports.setdefault(key, f"{hook.__qualname__}_{len(self._imports)}")

    def own(self, effect: Effect) -> str:
        """Return an effect's named numbers, made of its own out of all (p)."""
        start = 0
        for other in self.effects:
            if other is effect:
                break
            start += len(other.parameters)
        numbers = ", ".join(f"p[{start + k}]" for k in range(len(effect.parameters)))
        return f"{self.name_of(effect.numbers)}({numbers})"

    def with_hook(self, hook: str) -> list[tuple[Effect, Callable[..., Any]]]:
        """Return the effects that have a hook, in order, each with it."""
        found = [(effect, getattr(effect.hooks, hook)) for effect in self.effects]
        return [(effect, call) for effect, call in found if call is not None]

    def imports(self) -> list[str]:
        """Return the import lines of every hook named so far.

        A line about a hook of somebody else's holds a digest of its file, so that what was
        compiled before an edit is not taken for what is there now.
        """
        return [
            f"from {module} import {name} as {alias}{_stamp(module)}"
            for (module, name), alias in self._imports.items()
        ]


def _stamp(module: str) -> str:
    """Return a comment with a digest of a module's file; nothing for our own modules."""
    if module.partition(".")[0] == __name__.partition(".")[0]:
        return ""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return ""
    return f"  # {hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]}"


def summed(spelling: Spelling, hook: str, arguments: str) -> str:
    """Return the sum of a hook over effects, as text; "0.0" without any."""
    terms = [
        f"{spelling.name_of(call)}({spelling.own(effect)}, {arguments})"
        for effect, call in spelling.with_hook(hook)
    ]
    return " + ".join(terms) or "0.0"


def chained(spelling: Spelling, hook: str, quantity: str, arguments: str) -> str:
    """Return a quantity handed through a hook of every effect in turn, as text."""
    for effect, call in spelling.with_hook(hook):
        quantity = f"{spelling.name_of(call)}({spelling.own(effect)}, {arguments}, {quantity})"
    return quantity


def each(n: int, text: str, start: int = 0) -> str:
    """Return a tuple of `text` with {i} running over n, as text."""
    return "(" + "".join(text.format(i=i) + ", " for i in range(start, start + n)) + ")"


@lru_cache(maxsize=32)
def module_of(text: str, kind: str) -> ModuleType:
    """Return the module that `text` spells, loaded from the cache folder.

    The file is written once and never touched again: numba takes what it compiled before as long
    as the file is the same one.
    """
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    name = f"benchtool_{kind}_{digest}"
    path = _written(compiled_folder() / f"{name}.py", text)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path} cannot be loaded; set NUMBA_CACHE_DIR to another folder")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _written(path: Path, text: str) -> Path:
    try:
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            return path
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="benchtool-cache-"))
        path = folder / path.name
        path.write_text(text, encoding="utf-8")
    return path


spelled = expression
"""Mark a spelled-out function: it is an expression like any other."""
