"""Command `benchtool simulate flight`: table, files and errors."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchtool.data.run.recording_file import read_recording
from benchtool.data.table import read_csv_text
from tests.unit.commands import command_line

run = partial(command_line.run, "simulate", "flight")


def test_a_flight_with_each_controller(tmp_path, capsys):
    out = tmp_path / "flight"
    assert run("--controllers", "pid,observer", "--out", str(out)) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("SIMULATED flight over")
    provenance = read_recording(out / "observer.csv").provenance
    assert provenance["ending"] == "flown"
    table = read_csv_text(out / "pid.csv")
    assert len(table.rows) == 6000
    x = np.array([float(row[1]) for row in table.rows])
    assert 3.1 < x.max() < 3.2
    assert run("--controllers", "pid", "--out", str(out)) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_map_from_a_file(tmp_path, capsys):
    positions = [(x, y) for x in np.arange(-1.0, 9.0, 0.1) for y in (-1.0, 0.0, 1.0)]
    rows = [f"{x:.3f},{y},{0.0 if 3.0 <= x <= 5.0 else ''}" for x, y in positions]
    (tmp_path / "heights.csv").write_text("x_m,y_m,height_m\n" + "\n".join(rows) + "\n")
    (tmp_path / "map.toml").write_text(
        'name = "shelf"\nfloor_m = -5.0\n[grid]\nfile = "heights.csv"\n'
    )
    shelf = str(tmp_path / "map.toml")
    assert run("--map", shelf, "--controllers", "pid") == 0
    assert "SIMULATED flight over: Flying over shelf" in capsys.readouterr().out
    assert run("--map", shelf, "--goal-m", "20,0") == 2
    assert "the map does not cover the path: x is 20 m" in capsys.readouterr().err
    (tmp_path / "wrong.toml").write_text("[[blocks]]\nx_m = [3.0, 5.0]\nheight = 1.0\n")
    assert run("--map", str(tmp_path / "wrong.toml")) == 2
    assert "height" in capsys.readouterr().err
    (tmp_path / "torn.csv").write_text("x_m,y_m,height_m\n0,0,0\n0,1,0\n1,0,zero\n1,1,0\n")
    assert run("--map", str(tmp_path / "torn.csv")) == 2
    assert "line 4: height_m is 'zero'" in capsys.readouterr().err


LAW = """
class Law:
    def step(self, seen, want, dt_s):
        climb = 4.0 * (want.z_m - seen.z_m) - 3.2 * seen.vz_m_s
        return want.hover_N * (1.0 + climb / 9.81), 0.0, -0.5 * seen.pitch_rad, 0.0


class Bad(Law):
    def step(self, seen, want, dt_s):
        thrust, roll, pitch, yaw = super().step(seen, want, dt_s)
        return thrust, roll, pitch * float("nan"), yaw


class Breaks(Law):
    def step(self, seen, want, dt_s):
        return [][int(seen.time_s)]
"""


def test_a_user_controller(tmp_path, monkeypatch, capsys):
    (tmp_path / "flownlaw.py").write_text(LAW)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    short = ("--duration-s", "2", "--out", "out")
    assert run(*short, "--controllers", "pid,flownlaw:Law") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[3:6]] == ["PID", "PID", "flownlaw:Law"]
    table = read_csv_text(tmp_path / "out" / "flownlaw-Law.csv")
    column = table.header.index("pitch_ref_rad")
    assert {row[column] for row in table.rows} == {""}
    for name, message in (
        ("flownlaw:Bad", "returned pitch_Nm = nan at 0 s, in "),
        ("flownlaw:Breaks", "raised IndexError"),
        ("flownlaw:None_", "has no class None_ with a method step"),
        ("no_module_of_mine:Law", "No module named"),
    ):
        assert run("--duration-s", "2", "--controller", name) == 2
        code_file, sentence = capsys.readouterr().err.splitlines()
        assert code_file.startswith("running user code: ")
        assert message in sentence
        assert ("flownlaw.py line" in sentence) is (name in ("flownlaw:Bad", "flownlaw:Breaks"))


def test_a_vehicle_that_turns_over_is_reported(capsys):
    assert run("--controllers", "pid", "--lag-s", "10") == 0
    assert "PID: it turned over (roll " in capsys.readouterr().out
