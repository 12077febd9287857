"""Break the product one line at a time and count which breaks the tests notice: `make mutants`.

Works in a copy of the tree. Results are written as they come, a JSON object a line. A mutant that
was judged before is not drawn again while its module is the same, so that another call judges
others; `--again` judges those that survived once more, after a test was written.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict
from itertools import islice
from math import sqrt
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.long_count import LongCount
from tests.proof.mutation.groups import GROUPS, NAMED, Group, Named
from tests.proof.mutation.patched import Judge

ROOT = Path(__file__).parents[3]
PARTS = ("benchtool", "tests", "fits", "datasets", "docs", "pyproject.toml")
RESULTS = ROOT / "build" / "mutants"
LARGE = (  # in memory before the tests are forked off: what they import and nobody breaks
    *("hypothesis", "numpy", "pyarrow.csv", "pyarrow.parquet", "pydantic", "rich.console"),
    *("scipy.optimize", "scipy.stats", "pymavlink.dialects.v20.ardupilotmega", "typer"),
)


@contextmanager
def copied_tree() -> Iterator[Path]:
    """Give a copy of the project that may be broken."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        for part in PARTS:
            if (ROOT / part).is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "node_modules")
                shutil.copytree(ROOT / part, Path(name) / part, ignore=ignored)
            else:
                shutil.copy(ROOT / part, name)
        yield Path(name)


@contextmanager
def ended_with_us(child: int) -> Iterator[None]:
    """End a fork and all that it has started where the block is left by an error or a signal."""
    try:
        yield
    except BaseException:
        with suppress(psutil.Error, OSError):
            os.kill(child, signal.SIGSTOP)  # so that it starts nothing meanwhile
            family = psutil.Process(child)
            for one in (*family.children(recursive=True), family):
                one.kill()
            os.waitpid(child, 0)
        raise


def failure(tree: Path, tests: Sequence[str], limit_s: float, *, keep: bool = False) -> str:
    """Run tests in a copy and return which one failed first, "" when all passed.

    They run in a fork of this process, which has what is large and is never broken in memory.

    Args:
        limit_s: tests that take longer have failed.
        keep: write bytecode, as no source is broken now.
    """
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as output:
        child = os.fork()
        if child == 0:
            os.setsid()
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
            os._exit(_run(tree, tests, keep))
        until_s = time.monotonic() + limit_s
        with ended_with_us(child):
            while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
                if time.monotonic() > until_s:
                    os.killpg(child, signal.SIGKILL)
                    os.waitpid(child, 0)
                    return "time limit"
                time.sleep(0.02)
        if ended[1] == 0:
            return ""
        output.seek(0)
        lines = output.read().splitlines()
    failed = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    return failed[0][:200] if failed else f"no report: {' '.join(lines[-3:])[:200]}"


def _run(tree: Path, tests: Sequence[str], keep: bool, judge: Judge | None = None) -> int:
    """Run tests in this process, which has not imported any of the project's own modules yet."""
    for name in ("SIGTERM", "SIGHUP"):  # those of a long count are this program's
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    try:
        os.chdir(tree)
        os.environ |= {"PYTHONPATH": str(tree), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        sys.path.insert(0, str(tree))
        for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
            del sys.modules[name]
        sys.dont_write_bytecode = not keep
        if not keep:
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        options = ["-q", "-x", "-m", "", "-p", "no:cacheprovider", "-p", "pytest_timeout"]
        return int(pytest.main([*options, *tests], plugins=[judge] if judge else None))
    except BaseException:  # noqa: BLE001 -- nothing may go on as a second driver
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()


@contextmanager
def broken(tree: Path, module: str, source: str) -> Iterator[None]:
    """Put a broken source in a module's place, without the bytecode of the whole one."""
    path = tree / module
    whole = path.read_text("utf-8")
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
        compiled.unlink()
    path.write_text(source, "utf-8")
    try:
        yield
    finally:
        path.write_text(whole, "utf-8")


def judge_named(tree: Path, one: Named, limit_s: float = 120.0) -> str:
    """Return which test notices a named mutant, "" where none does."""
    source = (tree / one.module).read_text("utf-8")
    with broken(tree, one.module, one.applied(source)):
        return failure(tree, one.judges, limit_s)


def judge_all_named(tree: Path, names: Sequence[str]) -> None:
    """Judge named mutants, all of them where none is named, and print what becomes of each."""
    killed = 0
    chosen = [one for one in NAMED if not names or one.name in names]
    with LongCount(
        RESULTS / "named.jsonl", len(chosen), "named mutants", resumes=False, in_process=False
    ) as count:
        for one in chosen:
            noticed = judge_named(tree, one)
            killed += bool(noticed)
            print(f"{one.name}: {noticed or 'SURVIVED'}", flush=True)
            count.add(json.dumps([one.name, noticed]))
    print(f"named: {killed} of {len(chosen)} killed", flush=True)


def baseline_s(tree: Path, tests: Sequence[str]) -> float:
    """Return how long the tests of a group take on the whole product; they must pass."""
    failure(tree, tests, 3600.0, keep=True)  # writes the bytecode
    began_s = time.monotonic()
    if failed := failure(tree, tests, 3600.0):
        raise SystemExit(f"the tests fail without a mutant: {failed}")
    return time.monotonic() - began_s


def judge_group(
    tree: Path, name: str, most: int | None, seed: int, again: bool, count: LongCount
) -> None:
    """Judge a seeded sample of a group's mutants, or all, and write what becomes of each."""
    from tests.proof.mutation.mutants import mutants_of

    group = GROUPS[name]
    sources = {module: (tree / module).read_text("utf-8") for module in group.sampled}
    stamps = {
        module: hashlib.sha256(text.encode()).hexdigest()[:12] for module, text in sources.items()
    }
    known = {_key(row): row for row in map(json.loads, count.lines)}
    every = [one for module, text in sources.items() for one in mutants_of(module, text)]
    random.Random(seed).shuffle(every)

    def wanted() -> Iterator[dict[str, Any]]:
        for one in every:
            row = {**asdict(one), "source": stamps[one.module], "of": len(every)}
            before = known.get(_key(row))
            if before is None if not again else before is not None and not before["killed_by"]:
                row["changed"] = one.applied(sources[one.module])
                if _compiles(row["changed"]):
                    yield row

    rows = list(islice(wanted(), most))
    count.earlier, count.total = len(count.lines), len(rows)
    limit_s = 3.0 * baseline_s(tree, group.tests) + 10.0
    print(f"{name}: {len(rows)} of {len(every)} mutants, at most {limit_s:.0f} s each", flush=True)

    fresh: list[bool] = []

    def note(number: int, killed_by: str) -> None:
        fresh.append(bool(killed_by))
        row = dict(rows[number])
        text, changed = sources[row["module"]], row.pop("changed")
        row |= {"killed_by": killed_by, "change": _change(text, changed)}
        if not killed_by:
            print(f"survived: {row['module']}:{row['line']}\n{row['change']}", flush=True)
        count.add(json.dumps(row))

    with closing(_judged_together(tree, group, rows, limit_s)) as judged_together:
        for number, killed_by in judged_together:
            if not killed_by:  # perhaps it could not be put in place
                with broken(tree, rows[number]["module"], rows[number]["changed"]):
                    killed_by = failure(tree, group.tests, limit_s)
            note(number, killed_by)
    judged_rows = map(json.loads, count.lines)
    last = {_key(row): row for row in judged_rows if stamps.get(row["module"]) == row["source"]}
    judged = [bool(row["killed_by"]) for row in last.values()]
    print(f"{name}: {share(fresh)}; of all so far {share(judged)}", flush=True)


def _judged_together(
    tree: Path, group: Group, rows: list[dict[str, Any]], limit_s: float
) -> Generator[tuple[int, str]]:
    """Yield what notices each mutant, "" for nothing, as `Judge` finds it in its own process.

    That process waits meanwhile, so whoever is told may break the copy for a moment.
    """
    here, there = Pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        here.close()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        mutants = [
            (number, row["module"].removesuffix(".py").replace("/", "."), row["changed"])
            for number, row in enumerate(rows)
        ]

        def judged(number: int, killed_by: str) -> None:
            there.send((number, killed_by))
            there.recv()

        os._exit(_run(tree, group.tests, False, Judge(mutants, limit_s, judged)))
    there.close()
    with here, ended_with_us(child):
        for _ in rows:
            yield here.recv()
            here.send(None)
        os.waitpid(child, 0)


def share(killed: Sequence[bool]) -> str:
    """Return how many were killed, with the 95 % interval."""
    low, high = wilson(sum(killed), len(killed))
    return f"{sum(killed)} of {len(killed)} killed ({100 * low:.0f} to {100 * high:.0f} %)"


def wilson(hits: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    if not n:
        return 0.0, 1.0
    z, part = 1.959964, hits / n
    middle = part + z * z / (2 * n)
    half = z * sqrt(part * (1 - part) / n + z * z / (4 * n * n))
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def _compiles(source: str) -> bool:
    try:
        compile(source, "mutant", "exec")
    except SyntaxError:
        return False
    return True


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["module"], row["operator"], row["occurrence"], row["source"]


def _change(before: str, after: str) -> str:
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=0)
    return "\n".join(line for line in lines if line[:2] not in ("--", "++", "@@"))


def main() -> None:
    """Judge the named mutants, then a sample of each group."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", help=f"of {', '.join(GROUPS)}; all when left out")
    parser.add_argument("--check", action="store_true", help="of these words alone")
    parser.add_argument("--count", type=int, help="of mutants of a group; all when left out")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="judge survivors once more")
    parser.add_argument("--named", action="append", default=[], help="judge this one alone")
    parser.add_argument("--no-named", action="store_true", help="leave the named mutants out")
    chosen = parser.parse_args()
    if unknown := [name for name in chosen.groups if name not in GROUPS]:
        parser.error(f"no group {', '.join(unknown)}; there are {', '.join(GROUPS)}")
    if chosen.check:
        return
    for name in LARGE:
        importlib.import_module(name)
    with copied_tree() as tree:
        if not chosen.no_named:
            judge_all_named(tree, chosen.named)
        if chosen.named:
            return
        for name in chosen.groups or GROUPS:
            with LongCount(
                RESULTS / f"{name}.jsonl", 0, f"mutants of {name}", in_process=False
            ) as count:
                judge_group(tree, name, chosen.count, chosen.seed, chosen.again, count)


if __name__ == "__main__":
    main()
