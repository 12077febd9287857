"""Judge many mutants without importing anything twice: tests are collected once, then forked.

In each fork the code of one module's functions is replaced in place. What cannot be replaced so
(a table, a decorator's closure) leaves the mutant without effect: whatever survives here is judged
once more in an import of its own, by `run.failure`.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable
from inspect import getsource, unwrap
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import pytest

PLAIN = (int, float, str, bytes, bool, tuple, frozenset, type(None))


class Judge:
    """Run the collected tests once for each mutant, each in a fork, up to the first failure.

    Args:
        mutants: a key, a module's name and its source, for each.
        judged: called with a key and the test that failed, "" where all passed.
    """

    def __init__(
        self,
        mutants: Iterable[tuple[int, str, str]],
        limit_s: float,
        judged: Callable[[int, str], None],
    ) -> None:
        self._mutants, self._limit_s, self._judged = mutants, limit_s, judged

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        for key, module, source in self._mutants:
            read, write = os.pipe()
            child = os.fork()
            if child == 0:
                os.setsid()
                os.close(read)
                os._exit(_run(session, write, module, source))
            os.close(write)
            until_s = time.monotonic() + self._limit_s
            while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
                if time.monotonic() > until_s:
                    os.killpg(child, signal.SIGKILL)
                time.sleep(0.005)
            with open(read, "rb") as said:
                words = said.read().decode()
            self._judged(key, (words or "died or took too long") if ended[1] else "")
        return True


def _run(session: pytest.Session, write: int, module: str, source: str) -> int:
    class First:
        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed:
                os.write(write, report.nodeid.encode())
                os._exit(1)

    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    try:
        patch(sys.modules[module], source)
        session.config.pluginmanager.register(First())
        for index, item in enumerate(session.items):
            following = session.items[index + 1] if index + 1 < len(session.items) else None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
    except BaseException as error:  # noqa: BLE001 -- a module that cannot be run is broken
        os.write(write, f"{type(error).__name__}: {error}"[:200].encode())
        return 1
    return 0


def patch(module: ModuleType, source: str) -> None:
    """Replace code and plain constants of a module, where others have imported them too."""
    new = ModuleType(module.__name__)
    new.__file__ = module.__file__
    exec(compile(source, str(Path(module.__file__ or "")), "exec"), new.__dict__)
    for name, value in vars(new).items():
        old = vars(module).get(name)
        if isinstance(value, PLAIN) and not name.startswith("__"):
            if old != value:
                for other in (module, *_importers(name)):
                    if vars(other)[name] is old:
                        setattr(other, name, value)
        elif isinstance(value, type) and value.__module__ == module.__name__:
            for key, part in vars(value).items():
                _replace(vars(old).get(key), part)
                if isinstance(part, PLAIN) and vars(old).get(key) != part and key[:2] != "__":
                    setattr(old, key, part)
        else:
            _replace(old, value)


def _importers(name: str) -> list[ModuleType]:
    """Return the project's modules that have a name and do not define it themselves."""
    return [
        one
        for key, one in sys.modules.items()
        if key.startswith("benchtool.")
        and name in vars(one)
        and not re.search(rf"^{name}\b.*=", getsource(one), re.MULTILINE)
    ]


def _replace(old: Any, new: Any) -> None:
    for attribute in ("fget", "__func__", "__wrapped__"):
        if hasattr(new, attribute):
            old, new = getattr(old, attribute), getattr(new, attribute)
    old, new = unwrap(old) if callable(old) else old, unwrap(new) if callable(new) else new
    if isinstance(old, FunctionType) and isinstance(new, FunctionType):
        old.__code__ = new.__code__
        old.__defaults__, old.__kwdefaults__ = new.__defaults__, new.__kwdefaults__
