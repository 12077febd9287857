"""Pre-commit and the forge's workflow run what `make` and .ci/run run, and fetch nothing else."""

from __future__ import annotations

import re

import yaml

from tests.architecture.tracked import ROOT

MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
HOOKS = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text("utf-8"))["repos"]
WORKFLOW = (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")
JOBS = yaml.safe_load(WORKFLOW)["jobs"]


def test_pre_commit_runs_what_make_lint_runs_and_fetches_nothing() -> None:
    found = re.search(r"(?m)^lint:.*\n((?:\t.*\n)+)", MAKEFILE)
    assert found is not None
    lint = {line.strip().removesuffix(" .") for line in found[1].splitlines()}
    assert {repository["repo"] for repository in HOOKS} == {"local"}
    hooks = [hook for repository in HOOKS for hook in repository["hooks"]]
    assert {hook["entry"].replace(".venv/bin", "$(BIN)") for hook in hooks} == lint
    assert {hook["language"] for hook in hooks} == {"system"}


def test_the_workflow_runs_the_parts_of_ci_without_root() -> None:
    runs = [step["run"] for job in JOBS.values() for step in job["steps"] if "run" in step]
    assert {"make lint", "make docs", "make test", "make test-all"} == set(runs)
    for target in (run.removeprefix("make ") for run in runs):
        assert re.search(rf"(?m)^{target}:", MAKEFILE)
    parts = re.findall(r"(?m)^make ([\w-]+)$", (ROOT / ".ci" / "run").read_text("utf-8"))
    assert {f"make {part}" for part in parts} <= set(runs)
    assert "sudo" not in WORKFLOW


def test_the_workflow_tests_every_supported_python() -> None:
    supported = re.findall(r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text("utf-8"))
    assert JOBS["fast"]["strategy"]["matrix"]["python"] == supported
