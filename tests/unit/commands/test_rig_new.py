"""Command `benchtool library rigs new`: prompts and rig files."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest

from benchtool.core.rig_file import load_rig_by_name
from tests.unit.commands.command_line import said


class Terminal(io.StringIO):
    """Typed lines at a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_fit_needs_a_radius_only(capsys):
    code, out, _ = said(capsys, *["library", "rigs", "new", "mine", "--radius", "0.127"])
    rig = load_rig_by_name("mine.toml")
    assert (code, rig.propulsion.radius_m, len(rig.sources) - len(rig.not_stated)) == (0, 0.127, 1)
    assert "benchtool library rigs mine.toml" in out


def test_missing_values_are_prompted_on_a_terminal(monkeypatch, capsys):
    typed = "0.12\n50\n\nhnad\nhand\n0.05,0.6\n"
    monkeypatch.setattr("sys.stdin", Terminal(typed))
    code, out, _ = said(capsys, *["library", "rigs", "new", "mine.toml", "--for", "sweep"])
    assert code == 0
    rig = load_rig_by_name("mine.toml")
    assert (rig.limits.load_cell_rating_N, rig.limits.thrust_N) == (50.0, 40.0)
    assert (rig.plate.moved_by, rig.plate.z_min_m, rig.plate.z_max_m) == ("hand", 0.05, 0.6)
    assert rig.plate.z_park_m == 0.6
    assert (rig.propulsion.pwm_start_us, rig.propulsion.pwm_max_us) == (1050.0, 1950.0)
    assert "did you mean 'hand'" in out


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("", "--radius is missing (rotor radius, m); give --radius"),
        ("--radius 0.1 --rotors 4", "--arm is missing"),
        ("--radius -1", "--radius is -1 m, allowed is above 0"),
        ("--radius 2kg", "--radius is '2kg'; type a number, with a unit of m, cm, mm, in or none"),
        ("--propeller 10", "unknown propeller"),
        ("--radius 0.1 --travel 0.5,0.1", "--travel 0.5,0.1 m is invalid; give --travel MIN,MAX"),
        ("--radius 0.1 --pulses 1200,1100,1900", "pwm_stop_us <= pwm_start_us"),
    ],
)
def test_missing_or_invalid_values_are_rejected(options, reason, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    code, _, error = said(capsys, *f"library rigs new mine.toml {options}".split())
    assert (code, reason in error) == (2, True), error
    assert not Path("mine.toml").exists()


def test_an_existing_file_is_not_changed(capsys):
    Path("mine.toml").write_text("mine")
    code, _, error = said(capsys, *["library", "rigs", "new", "mine.toml", "--radius", "0.1"])
    assert (code, "exists already" in error) == (2, True), error
    assert Path("mine.toml").read_text() == "mine"


def test_like_copies_a_rig_for_another_propeller(capsys):
    command = "library rigs new a.toml --for motor --propeller 10x4.5 --cell 5kgf"
    command += " --pulses 1000,1050,1950 --current 30"
    assert said(capsys, *command.split())[0] == 0
    command = "library rigs new b.toml --for motor --like a.toml --propeller 9x6"
    code, out, error = said(capsys, *command.split())
    assert code == 0, error
    first, second = load_rig_by_name("a.toml"), load_rig_by_name("b.toml")
    assert first.propulsion.radius_m == pytest.approx(0.127)
    assert second.propulsion.radius_m == pytest.approx(0.1143)
    assert first.limits.load_cell_rating_N == pytest.approx(5.0 * 9.80665)
    assert second.limits == replace(first.limits, rpm=second.limits.rpm)
    assert (first.limits.current_A, second.name) == (30.0, "b")
    assert second.propeller is not None
    assert (second.propeller.name, second.propeller.pitch_m) == ("9x6", pytest.approx(0.1524))
    code, out, _ = said(capsys, *out.splitlines()[-1].split()[1:], "--out", "run")
    assert code == 0, out
