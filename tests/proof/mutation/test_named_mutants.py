"""A few of the named mutants, judged as `make mutants` judges all of them."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from types import ModuleType
from typing import cast

import psutil
import pytest

from tests.proof.mutation import patched
from tests.proof.mutation.groups import GROUPS, NAMED, Named
from tests.proof.mutation.run import ROOT, ended_with_us, main, wilson


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="mutants are judged in forks")
def test_a_broken_line_is_noticed() -> None:
    sample = [one.name for one in random.Random(24).sample(NAMED, 6)]
    named = [word for name in sample for word in ("--named", name)]
    ended = subprocess.run(
        [sys.executable, "-m", "tests.proof.mutation.run", *named],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    # By a failed test, not by one that could not be collected.
    assert {name: ended.stdout.count(f"{name}: FAILED tests/") for name in sample} == dict.fromkeys(
        sample, 1
    ), ended.stdout + ended.stderr


@pytest.mark.parametrize("named", NAMED, ids=lambda one: one.name)
def test_a_named_mutant_still_fits_its_module(named: Named) -> None:
    source = (ROOT / named.module).read_text("utf-8")
    assert compile(named.applied(source), named.module, "exec")


def test_whoever_judges_is_there() -> None:
    paths = {
        path for group in GROUPS.values() for path in (*group.sampled, *group.beside, *group.tests)
    }
    assert [path for path in sorted(paths) if not (ROOT / path).is_file()] == []


def test_an_unknown_group_is_refused_before_anything_is_installed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for known in ([], ["guard", "link"]):
        monkeypatch.setattr(sys, "argv", ["run", "--check", *known])
        main()
    monkeypatch.setattr(sys, "argv", ["run", "--check", "nosuch"])
    with pytest.raises(SystemExit):
        main()
    said = capsys.readouterr().err
    assert "nosuch" in said
    assert all(name in said for name in GROUPS)
    lines = (ROOT / "Makefile").read_text("utf-8").partition("\nmutants:")[2].splitlines()
    assert "--check" in lines[1]
    assert "PIP" not in lines[1]


@pytest.mark.skipif(os.name == "nt", reason="mutants are judged in forks")
def test_a_fork_ends_with_all_that_it_started() -> None:
    code = "import subprocess; p = subprocess.Popen(['sleep', '60'], start_new_session=True, "
    code += "stdout=subprocess.DEVNULL); print(p.pid, flush=True); p.wait()"
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    with child.stdout:
        started = psutil.Process(int(child.stdout.readline()))
        with pytest.raises(KeyboardInterrupt), ended_with_us(child.pid):
            raise KeyboardInterrupt
    child.returncode = -signal.SIGKILL  # waited for already
    started.wait(5)


def test_the_interval_of_a_share() -> None:
    # Wilson's own formula for 9 of 10, as tables have it.
    assert wilson(9, 10) == pytest.approx((0.5958, 0.9821), abs=1e-4)


@pytest.mark.skipif(os.name == "nt", reason="mutants are judged in forks")
def test_mutants_behind_one_that_takes_too_long_are_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(session: object, write: int, module: str, source: str) -> int:
        signal.sigwait([signal.SIGUSR1]) if source == "endless" else os.write(write, b"noticed")
        return len(source)

    monkeypatch.setattr(patched, "_run", run)
    judged: list[tuple[int, str]] = []
    mutants = [(7, "m", "endless"), (8, "m", "broken"), (9, "m", "")]
    judge = patched.Judge(mutants, 0.2, lambda *one: judged.append(one))
    judge.pytest_runtestloop(cast("pytest.Session", None))
    assert judged == [(7, "died or took too long"), (8, "noticed"), (9, "")]


WHOLE = """
LIMIT = 1
def plain(x): return x > LIMIT
class Owner:
    share = 2
    @property
    def twice(self): return 2 * self.share
    @staticmethod
    def both(x, more=1): return x + more
"""


def test_a_broken_source_is_put_in_place_of_a_module() -> None:
    module = ModuleType("benchtool.whole")
    module.__file__ = "whole.py"
    exec(WHOLE, module.__dict__)
    plain, owner = module.plain, module.Owner()
    broken = WHOLE.replace("LIMIT = 1", "LIMIT = 7").replace("2 * self", "3 * self")
    patched.patch(module, broken.replace("share = 2", "share = 5").replace("more=1", "more=4"))
    assert (plain(2), owner.twice, owner.both(1)) == (False, 15, 5)
