"""A few of the named mutants, judged as `make mutants` judges all of them."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from types import ModuleType

import pytest

from tests.proof.mutation import patched
from tests.proof.mutation.groups import GROUPS, NAMED
from tests.proof.mutation.run import ROOT


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="mutants are judged in forks")
def test_a_broken_line_is_noticed():
    sample = [one.name for one in random.Random(24).sample(NAMED, 3)]
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
def test_a_named_mutant_still_fits_its_module(named):
    source = (ROOT / named.module).read_text("utf-8")
    assert compile(named.applied(source), named.module, "exec")


def test_whoever_judges_is_there():
    paths = {
        path for group in GROUPS.values() for path in (*group.sampled, *group.beside, *group.tests)
    }
    assert [path for path in sorted(paths) if not (ROOT / path).is_file()] == []


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


def test_a_broken_source_is_put_in_place_of_a_module():
    module = ModuleType("benchtool.whole")
    module.__file__ = "whole.py"
    exec(WHOLE, module.__dict__)
    plain, owner = module.plain, module.Owner()
    broken = WHOLE.replace("LIMIT = 1", "LIMIT = 7").replace("2 * self", "3 * self")
    patched.patch(module, broken.replace("share = 2", "share = 5").replace("more=1", "more=4"))
    assert (plain(2), owner.twice, owner.both(1)) == (False, 15, 5)
