"""A wheel holds everything: the command line runs from it alone, in an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.architecture.tracked import ROOT, project_files


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel without touching the network or the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_every_file_of_the_package(wheel):
    package = ROOT / "benchtool"
    ours = {p.relative_to(ROOT).as_posix() for p in project_files() if p.is_relative_to(package)}
    with zipfile.ZipFile(wheel) as archive:
        assert ours - set(archive.namelist()) == set()


def test_the_command_line_runs_from_the_wheel_alone(wheel, tmp_path):
    site = tmp_path / "site"
    empty = tmp_path / "empty"
    empty.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    answer = subprocess.run(
        [sys.executable, "-c", WHERE],
        cwd=empty,
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(answer.stdout.splitlines()[0]).is_relative_to(site)
    assert "Usage: benchtool" in answer.stdout
    assert list(empty.iterdir()) == []


WHERE = """
import benchtool
print(benchtool.__file__)
from benchtool.commands.app import main
main(["--help"])
"""
