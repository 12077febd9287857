"""A few of the named mutants, judged as `make mutants` judges all of them."""

from __future__ import annotations

import os
import random
import subprocess
import sys

import pytest

from tests.mutation.groups import GROUPS, NAMED, Named
from tests.mutation.run import ROOT, wilson


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="mutants are judged in forks")
def test_a_broken_line_is_noticed() -> None:
    sample = [one.name for one in random.Random(24).sample(NAMED, 6)]
    named = [word for name in sample for word in ("--named", name)]
    told = subprocess.run(
        [sys.executable, "-m", "tests.mutation.run", *named],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    # By a failed test, not by one that could not be collected.
    assert {name: told.stdout.count(f"{name}: FAILED tests/") for name in sample} == dict.fromkeys(
        sample, 1
    ), told.stdout + told.stderr


@pytest.mark.parametrize("named", NAMED, ids=lambda one: one.name)
def test_a_named_mutant_still_fits_its_module(named: Named) -> None:
    source = (ROOT / named.module).read_text("utf-8")
    assert compile(named.applied(source), named.module, "exec")


def test_whoever_judges_is_there() -> None:
    paths = {
        path for group in GROUPS.values() for path in (*group.sampled, *group.beside, *group.tests)
    }
    assert [path for path in sorted(paths) if not (ROOT / path).is_file()] == []


def test_the_interval_of_a_share() -> None:
    # Wilson's own formula for 9 of 10, as tables have it.
    assert wilson(9, 10) == pytest.approx((0.5958, 0.9821), abs=1e-4)
