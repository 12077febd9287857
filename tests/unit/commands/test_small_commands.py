"""Commands firmware, demo and `record --dry-run`."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.unit.commands.command_line import run


def test_firmware_is_written(tmp_path, capsys):
    out = tmp_path / "new" / "my_bench"
    assert run("firmware", "--board", "uno", "--out", str(out), "--device-id", "bench-01") == 0
    output = capsys.readouterr().out
    assert "Arduino Uno R3, device bench-01" in output
    assert (out / "my_bench.ino").exists()
    assert '"bench-01"' in (out / "settings.h").read_text("utf-8")


def test_two_devices_have_different_ids(tmp_path):
    for name in ("one", "two"):
        assert run("firmware", "--out", str(tmp_path / name)) == 0
    first, second = ((tmp_path / name / "settings.h").read_text("utf-8") for name in ("one", "two"))
    assert first != second


@pytest.mark.slow
def test_the_demo_prints_its_commands_and_its_report(tmp_path):
    arguments = [sys.executable, "-m", "benchtool", "demo", "--out", str(tmp_path / "demo")]
    process = subprocess.run(arguments, capture_output=True, text=True, check=True, timeout=300)
    page = tmp_path / "demo" / "fit" / "report.html"
    assert process.stdout.endswith(f"\nThe report: {page.resolve()}\n")
    assert process.stdout.count("\n$ benchtool ") == 2
    assert page.is_file()


@pytest.mark.parametrize("address", ["sim:pquad?mode=pitch&schedule=steps", "serial:/dev/none"])
def test_a_dry_run_opens_nothing(address, capsys):
    assert run("record", address, "--rig", "pquad", "--dry-run") == 0
    assert "nothing was opened, nothing spins" in capsys.readouterr().out
