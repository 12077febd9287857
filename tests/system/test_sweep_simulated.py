"""Sweeps from the command line on the bench in the same process."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchtool.data.columns import KINDS
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import read_settings
from tests.unit.commands.command_line import run as call

SMALL = ["--repeats", "2", "--z-over-r", "0.5,1,2", "--pwm", "1500", "--sample-s", "1"]


@pytest.fixture(autouse=True)
def _state(tmp_path, monkeypatch):
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)


def test_a_run_holds_what_it_must(capsys):
    words = ["--temperature", "21", "--pressure", "1002", "--humidity", "45", "--operator", "me"]
    assert call("sweep", "sim:pquad_single?seed=3", *SMALL, *words, "--yes", "--out", "run") == 0
    said = capsys.readouterr().out
    assert "highest pulse: 1500 us of 1950 us" in said
    assert "points (simulated)" in said
    run = Path("run")
    assert sorted(item.name for item in run.iterdir()) == [
        *("events.jsonl", "metadata.json", "plan.toml", "points.csv"),
        *("samples.csv", "samples.parquet", "settings.csv"),
    ]
    facts = json.loads((run / "metadata.json").read_text())
    assert facts["simulated"] is True
    assert facts["state"] == "ended"
    assert facts["operator"] == "me"
    assert facts["device_id"] == "virtual-pquad_single-3"
    assert facts["rig"]["name"] == "pquad_single"
    assert facts["air"]["density_kg_m3"] == pytest.approx(1.181, abs=0.002)
    assert facts["versions"]["benchtool"]
    settings = read_settings(run)
    assert settings.simulated
    nearest = settings.column("plate_z_m").argmin()
    # Eq. (2) at z/R = 0.5.
    assert settings.column("ratio_equal_rpm2")[nearest] == pytest.approx(4.0 / 3.0, rel=0.01)
    header = (run / "samples.csv").read_text().splitlines()[0].split(",")
    assert header[:6] == ["time_s", "device_time_us", "point", "phase", "pwm1_us", "rpm1"]
    thrust = read_samples(run).column("thrust_N")
    # 80 Hz in a 200 Hz stream: nothing is repeated.
    assert np.isnan(thrust).mean() == pytest.approx(0.6, abs=0.01)


def test_a_resumed_run_keeps_its_order(capsys):
    words = ["sweep", "sim:pquad_single?seed=3", *SMALL, "--yes", "--out"]
    assert call(*words, "whole") == 0
    assert call(*words, "cut") == 0
    cut = Path("cut")
    _cut_back(cut, points=4)
    capsys.readouterr()
    assert call("sweep", "--resume", "cut", "--yes") == 0
    last, _ = capsys.readouterr().out.splitlines()[-2:]
    whole, resumed = read_points(Path("whole")), read_points(cut)
    for name in ("point", "kind", "setting", "repeat", "pwm1_us"):
        assert resumed.column(name).tolist() == whole.column(name).tolist()
    np.testing.assert_allclose(resumed.column("thrust_N"), whole.column("thrust_N"), atol=0.03)
    assert len(read_points(cut, ["tare"])) == 2
    samples = read_samples(cut)
    assert last.startswith(f"{len(resumed)} points (simulated), 0 not settled, 2 tares, ")
    assert f" {len(samples):,} samples, " in last
    assert (np.diff(samples.column("time_s")) > 0).all()
    fifth = samples.select(samples.column("point") == 5.0)
    phases = fifth.column("phase").astype(int)
    # The interrupted visit stands before the repeated one, rows and all.
    assert (phases == 7).sum() > 0
    assert (np.diff((phases == 7).astype(int)) <= 0).all()
    assert resumed.provenance["state"] == "ended"
    capsys.readouterr()
    assert call("sweep", "--resume", "cut", "--yes") == 2
    assert "nothing to resume" in capsys.readouterr().err


def test_a_watcher_that_goes_away_does_not_end_a_sweep():
    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            if re.match(r"\d+/\d+ ", text):
                raise BrokenPipeError(errno.EPIPE, "Broken pipe")
            return len(text)

    with contextlib.redirect_stdout(Gone()), contextlib.suppress(BrokenPipeError):
        call("sweep", "sim:pquad_single?seed=3", *SMALL, "--yes", "--out", "piped")
    metadata = json.loads((Path("piped") / "metadata.json").read_text("utf-8"))
    assert metadata["state"] == "ended"
    assert len(read_points(Path("piped"))) > 4


def _cut_back(run: Path, points: int) -> None:
    """Leave a run as kill -9 would have, in the middle of the visit behind `points`."""
    kept = (run / "points.csv").read_bytes().splitlines(keepends=True)[: points + 2]
    (run / "points.csv").write_bytes(b"".join(kept) + b"5,meas")
    lines = (run / "samples.csv").read_text().splitlines(keepends=True)
    of_next = [i for i, line in enumerate(lines) if line.split(",")[2] == str(points + 1)]
    middle = of_next[len(of_next) // 2]
    (run / "samples.csv").write_text("".join(lines[:middle]) + lines[middle][:17])
    (run / "settings.csv").unlink()
    (run / "samples.parquet").unlink()
    facts = json.loads((run / "metadata.json").read_text())
    facts |= {"state": "running", "samples": {}, "points": {}}
    (run / "metadata.json").write_text(json.dumps(facts))


def test_a_resumed_run_says_what_was_cut():
    assert call("sweep", "sim:pquad_single", *SMALL, "--yes", "--out", "run") == 0
    _cut_back(Path("run"), points=4)
    assert call("sweep", "--resume", "run", "--yes") == 0
    cut = [e.text for e in read_events(Path("run/events.jsonl")) if e.event == "cut_line"]
    assert len(cut) == 2
    assert cut[1].endswith("points.csv was removed: 5,meas")


def test_a_limit_stops_the_sweep_at_once(capsys):
    from benchtool.core.user_file import read_library_file

    text = read_library_file("rig", "rigs", "pquad_single")[0]
    Path("tight.toml").write_text(
        text.replace("temperature_degC = 90.0", "temperature_degC = 23.0")
    )
    words = ["sweep", "sim:pquad_single", "--rig", "tight.toml", *SMALL, "--yes", "--out", "run"]
    assert call(*words) == 4
    told = capsys.readouterr()
    assert "temperature_degC read 2" in told.err
    assert "limit 23; zero was commanded" in told.err
    assert "benchtool sweep --resume run" in told.out
    stopped = read_events(Path("run/events.jsonl"))[-1]
    assert stopped.event == "stopped"
    assert "limit 23" in stopped.text
    # The sample that broke the limit is on the disk, too.
    assert np.nanmax(read_samples(Path("run")).column("temperature_degC")) > 23.0


def test_a_dry_run_makes_nothing(capsys):
    assert call("sweep", "serial:COM99", "--rig", "pquad", "--dry-run") == 0
    said = capsys.readouterr().out
    assert "18 settings, 5 repeats, randomised with seed 0: 96 visits" in said
    assert "expected duration 1" in said
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["sim:pquad", "--z-m", "0.1", "--z-over-r", "1"], "--z-m and --z-over-r are both given"),
        (["sim:pquad", "--z-over-r", "0,5"], "decimals take a point: 0.5, not 0,5"),
        (["sim:pquad", "--repeats", "100000000"], "h, limit 48 h; lower repeats (100,000"),
        (["sim:pquad", "--order", "shuffled"], "unknown --order 'shuffled'"),
        (
            ["sim:pquad", "--pressure", "101325"],
            "--pressure is 101325 hPa, allowed is 500 to 1,100",
        ),
        (["sim:pquad", "--calibration", "absent.json", "--yes"], "no such file"),
        (["sim:pquad", "--name", "../up", "--yes"], "cannot name a run"),
        (["serial:COM99"], "no rig for serial:COM99"),
        ([], "no bench address"),
        (["--resume", "absent"], "there is no such run"),
    ],
)
def test_bad_input_gets_one_sentence(words, told, capsys):
    assert call("sweep", *words) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert said.err.count("\n") == 1
    # Refused before the plan is shown, let alone anything opened.
    assert said.out == ""
    assert not Path("runs").exists()


def test_an_existing_folder_is_left_alone(capsys):
    Path("run").mkdir()
    Path("run/notes.txt").write_text("mine")
    assert call("sweep", "sim:pquad", "--yes", "--out", "run") == 2
    assert "run exists already" in capsys.readouterr().err
    assert [path.read_text() for path in Path("run").iterdir()] == ["mine"]


def test_arming_wants_the_word(capsys, monkeypatch):
    from io import StringIO

    monkeypatch.setattr("sys.stdin", StringIO("yes\n"))
    assert call("sweep", "sim:pquad_single", *SMALL) == 5
    assert "not armed: ARM was not typed" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin", StringIO("ARM\n"))
    assert call("sweep", "sim:pquad_single", *SMALL, "--out", "run") == 0
    monkeypatch.setattr("sys.stdin", StringIO(""))
    assert call("sweep", "sim:pquad_single", *SMALL) == 2
    assert "no answer: end of input" in capsys.readouterr().err


def test_a_calibration_follows_every_run(capsys):
    from benchtool.bench.drivers import open_bench

    with open_bench("sim:pquad_single") as bench:
        identity = bench.identity
    per_count = float(identity.facts["thrust_raw_N_per_count"])
    masses = [0.0, 0.1, 0.2, 0.5, 0.2, 0.1, 0.0]
    rows = [f"{mass},{mass * 9.80665 / (1.1 * per_count)}" for mass in masses]
    Path("masses.csv").write_text("mass_kg,thrust_raw\n" + "\n".join(rows) + "\n")
    words = ["--from", "masses.csv", "--device-id", identity.device_id, "--out", "c.json"]
    assert call("calibrate", *words) == 0
    assert "every run on virtual-pquad_single-0 uses it" in capsys.readouterr().out
    assert Path("c.svg").is_file()
    assert Path("c.png").is_file()
    assert call("calibrate", *words) == 2
    assert call("sweep", "sim:pquad_single", *SMALL, "--yes", "--out", "with") == 0
    assert call("report", "with", "--out", "with.html") == 0
    assert "Calibration. Above: mean raw reading" in Path("with.html").read_text()
    plain = ["--calibration", "none", "--yes", "--out", "plain"]
    assert call("sweep", "sim:pquad_single", *SMALL, *plain) == 0
    calibrated, own = read_points("with"), read_points("plain")
    ratio = calibrated.column("thrust_N") / own.column("thrust_N")
    np.testing.assert_allclose(ratio, 1.1, rtol=0.01)
    assert calibrated.provenance["calibration"].endswith("virtual-pquad_single-0")
    other = json.loads(Path("c.json").read_text()) | {"device_id": "bench-7", "id": "other"}
    Path("other.json").write_text(json.dumps(other))
    capsys.readouterr()
    assert call("calibrate", "--apply", "plain", "--calibration", "other.json") == 2
    assert "made on device 'bench-7', but run plain is 'virtual" in capsys.readouterr().err
    words = ["plain", "--calibration", "other.json", "--other-device"]
    assert call("calibrate", "--apply", *words) == 0
    facts = json.loads(Path("plain/recalibrated-other/metadata.json").read_text())
    assert facts["calibration_of_other_device"] is True
    assert call("calibrate", "--apply", "plain", "--calibration", "c.json") == 0
    again = next(Path("plain").glob("recalibrated-2*"))
    np.testing.assert_allclose(
        read_points(again, KINDS).column("thrust_N")[1:],
        read_points("with", KINDS).column("thrust_N")[1:],
        rtol=1e-9,
    )
