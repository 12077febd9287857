"""Hostile words, addresses and files end in one sentence of our own, never in a traceback."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from benchtool.commands.app import main

DIGITS = "1" * 4400
DEEP = "[" * 3000
LONG = "a" * 300
SWEEP = ["sweep", "sim:pquad_single", "--z-over-r", "1", "--pwm", "1450", "--repeats", "1"]
SHORT = [*SWEEP, "--sample-s", "0.2", "--yes"]

Said = Callable[..., tuple[int, str]]


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Return a call that runs benchtool in an empty folder and gives exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    monkeypatch.delenv("BENCHTOOL_DEBUG", raising=False)

    def call(*words: str) -> tuple[int, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main(words)
        err = capsys.readouterr().err
        assert "please report" not in err
        assert "Traceback" not in err
        return int(left.value.code or 0), err

    return call


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([*SHORT, "--operator", "\udced\udcb3"], "is not UTF-8 text"),
        ([*SHORT, "--out", "\udcff"], "is not UTF-8 text"),
        ([*SHORT, "--out", LONG], "name too long"),
        ([*SHORT, "--calibration", "folder"], "this is a folder"),
        (["import", "t.csv", "--out", "t.csv/o.csv"], "t.csv"),
        (["import", "fifo", "--dry-run"], "this is a pipe"),
        (["import", "/dev/zero", "--dry-run"], "this is a device"),
        (["library", "rigs", "fifo"], "this is a pipe"),
        (["library", "rigs", LONG], "unknown rig"),
        (["library", "rigs", f"{LONG}.toml"], "file name too long"),
        (["library", "models", "/dev/zero"], "this is a device"),
        (["sweep", "sim:pquad_single", "--plan", "fifo", "--dry-run"], "this is a pipe"),
        (["sweep", "sim:pquad_single", "--plan", "/dev/zero", "--dry-run"], "this is a device"),
        (["fit", "fifo", "--model", "single"], "this is a pipe"),
        (["report", "fifo"], "fifo"),
        (["simulate", "flight", "--map", "fifo", "--duration-s", "1"], "this is a pipe"),
        (["simulate", "pitch", "--gains", "fifo", "--duration-s", "1"], "this is a pipe"),
    ],
    ids=lambda value: " ".join(value)[:60].encode("ascii", "replace").decode()
    if isinstance(value, list) else "",
)  # fmt: skip
def test_words_and_paths(said, tmp_path, words, says):
    (tmp_path / "t.csv").write_text("time_s,thrust_N\n0,1\n1,2\n")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "fifo")
    code, err = said(*words)
    assert code == 2
    assert says in err


@pytest.mark.parametrize(
    "address",
    [
        f"sim:pquad_single?truth={LONG}",
        f"sim:pquad_single?truth={LONG}.toml",
        "sim:pquad_single?truth=%00.toml",
        f"tcp:127.0.0.1:{DIGITS}",
        f"mavlink:tcp:127.0.0.1:{DIGITS}",
        f"mavlink:serial:/dev/ttyX:{DIGITS}",
        "mavlink:udpin:127.0.0.1:14999?key=/dev/zero",
        "mavlink:udpin:127.0.0.1:14999?key=%00",
        "mavlink:udpin:127.0.0.1:14999?map=%00",
        "mavlink:udpin:127.0.0.1:14999?map=/dev/zero",
        f"mavlink:udpin:127.0.0.1:14999?cell=/dev/ttyX:{DIGITS}",
        f"replay:{LONG}",
        "replay:/dev/zero",
        "serial:/dev/\0",
    ],
    ids=lambda address: address[:45].replace("\0", "NUL"),
)
@pytest.mark.parametrize("command", ["sweep", "ports"])
def test_addresses(said, command, address):
    words = [*SWEEP[2:], "--rig", "pquad_single", "--yes"] if command == "sweep" else []
    code, err = said(command, address, *words)
    assert code in (2, 3) or command == "ports"
    assert err.count("\n") <= 1


@pytest.mark.parametrize("value", [DIGITS, DEEP, f"{DEEP}{']' * 3000}"], ids=["digits", "[", "[]"])
@pytest.mark.parametrize(
    "words",
    [
        ["sweep", "sim:pquad_single", "--plan", "x.toml", "--dry-run"],
        ["library", "rigs", "x.toml"],
        ["library", "models", "x.toml"],
        ["simulate", "pitch", "--gains", "x.toml", "--duration-s", "1"],
        ["simulate", "pitch", "--schedule", "x.toml", "--duration-s", "1"],
        ["simulate", "flight", "--map", "x.toml", "--duration-s", "1"],
        ["fit", "t.csv", "--model", "single", "--rig", "pquad_single", "--columns", "x.toml"],
        ["import", "t.csv", "--columns", "x.toml", "--dry-run"],
        ["fit", "--recipe", "."],
        [*SHORT, "--calibration", "c.json"],
    ],
    ids=lambda words: " ".join(words)[:50],
)
def test_toml_and_json(said, tmp_path, words, value):
    (tmp_path / "t.csv").write_text("thrust_N,rpm1,plate_z_m\n2.4,4500,0.06\n2.3,4500,0.24\n")
    for name in ("x.toml", "recipe.toml"):
        (tmp_path / name).write_text(f"repeats = {value}\n")
    (tmp_path / "c.json").write_text(json.dumps({"id": "a"})[:-1] + f', "x": {value}}}')
    code, err = said(*words)
    assert code == 2
    assert any(words in err for words in ("beyond", "nested deeper", "not valid"))


@pytest.mark.parametrize(
    "text",
    [
        "sample_s = 1e308",
        "[tare]\nseconds = 1e308",
        "[tare]\nstop_timeout_s = 1e308",
        "[settle]\ntimeout_s = 1e308",
        "[rest]\nlongest_s = 1e308",
        "[plate]\ndistances_m = [1e308]",
        "[plate]\nlateral_m = [-1e308]",
        "[throttle]\npwm_us = [1e308]",
        "repeats = 9223372036854775807",
        "[order]\nanchor_every = 9223372036854775807",
        "repeats = 9999\n[plate]\ntilts_deg = [1,2,3,4,5,6,7,8,9]",
    ],
)
def test_plans_out_of_range(said, tmp_path, text):
    (tmp_path / "plan.toml").write_text(text)
    code, err = said("sweep", "sim:pquad_single", "--plan", "plan.toml", "--dry-run")
    assert code == 2
    assert any(words in err for words in ("input should be", "limit 100,000", "limit 48 h"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a small run."""
    run = tmp_path_factory.mktemp("runs") / "run"
    with pytest.raises(SystemExit):
        main([*SHORT, "--out", str(run)])
    return run


def in_json(**changes: object) -> Callable[[Path], None]:
    def change(run: Path) -> None:
        path = run / "metadata.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return change


def in_text(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(run: Path) -> None:
        path = run / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return change


def folder_at(name: str) -> Callable[[Path], None]:
    def change(run: Path) -> None:
        (run / name).unlink()
        (run / name).mkdir()

    return change


def fifo_at(name: str) -> Callable[[Path], None]:
    def change(run: Path) -> None:
        (run / name).unlink()
        os.mkfifo(run / name)

    return change


DAMAGE: dict[str, Callable[[Path], None]] = {
    "metadata: link is text": in_json(link="x"),
    "metadata: lost is text": in_json(link={"samples": 3, "lost": "x"}),
    "metadata: samples is a number": in_json(samples=3),
    "metadata: versions is text": in_json(versions="x"),
    "metadata: device is a list": in_json(device=[]),
    "metadata: plate is text": in_json(plate="x"),
    "metadata: stage is a number": in_json(plate={"stage": 3}),
    "metadata: visits is text": in_json(visits="x"),
    "metadata: rig is a number": in_json(rig=3),
    "metadata: air is text": in_json(air="x"),
    "metadata: calibration is partial": in_json(calibration={"id": "x"}),
    "metadata: seed is nan": in_json(seed=float("nan")),
    "metadata: started is inf": in_json(started=float("inf")),
    "metadata: operator is a surrogate": in_json(operator="\ud800"),
    "metadata: digits": in_text("metadata.json", "{", '{"x": ' + DIGITS + ","),
    "metadata: deep": in_text("metadata.json", "{", '{"x": ' + DEEP + ","),
    "metadata: a folder": folder_at("metadata.json"),
    "metadata: a pipe": fifo_at("metadata.json"),
    "plan: deep": in_text("plan.toml", "repeats", f"x = {DEEP}\nrepeats"),
    "plan: digits": in_text("plan.toml", "repeats", f"x = {DIGITS}\nrepeats"),
    "plan: not UTF-8": lambda run: (run / "plan.toml").write_bytes(b"\xff"),
    "plan: a folder": folder_at("plan.toml"),
    "points: a folder": folder_at("points.csv"),
    "points: a pipe": fifo_at("points.csv"),
    "points: point is 1.5": in_text("points.csv", "\n1,", "\n1.5,"),
    "points: point is inf": in_text("points.csv", "\n1,", "\ninf,"),
    "samples: time is inf": in_text("samples.csv", "\n0.", "\ninf,0."),
    "samples: a pipe": fifo_at("samples.csv"),
    "events: a folder": folder_at("events.jsonl"),
    "events: a pipe": fifo_at("events.jsonl"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize(
    "words",
    [
        ["report", "run", "--out", "o.html"],
        ["sweep", "sim:pquad_single", "--resume", "run", "--dry-run"],
        ["fit", "run", "--model", "single"],
        ["runs", "close", "run"],
    ],
    ids=lambda words: words[0],
)
def test_run_folders(said, tmp_path, recorded, words, damage):
    run = tmp_path / "run"
    shutil.copytree(recorded, run)
    for name in ("samples.parquet", "settings.csv"):
        (run / name).unlink()
    DAMAGE[damage](run)
    code, _ = said(*words)
    assert code in (0, 2, 6, 9, 10)


@pytest.mark.parametrize("name", ["time_s", "device_time_us"])
@pytest.mark.parametrize("value", ["inf", "nan", "1e308"])
def test_a_run_with_times_that_are_none_is_not_resumed(said, tmp_path, recorded, name, value):
    run = tmp_path / "run"
    shutil.copytree(recorded, run)
    for made in ("samples.parquet", "settings.csv"):
        (run / made).unlink()
    points = (run / "points.csv").read_text().split("\n")
    (run / "points.csv").write_text("\n".join(points[:3]) + "\n")
    rows = (run / "samples.csv").read_text().split("\n")
    cells = rows[5].split(",")
    cells[rows[0].split(",").index(name)] = value
    rows[5] = ",".join(cells)
    (run / "samples.csv").write_text("\n".join(rows))
    code, err = said("sweep", "sim:pquad_single", "--resume", "run", "--yes")
    assert (code, "samples.csv, line 6" in err) == (2, True)


@pytest.mark.parametrize(
    "change",
    [
        {"channels": 3},
        {"provenance": None},
        {"provenance": {"file": 3}},
        {"rows": -1},
        {"findings": [{"kind": "x"}]},
        {"windows": [{"start_s": "x"}]},
        {"tally": []},
        {"versions": "x"},
    ],
    ids=str,
)
def test_the_json_beside_a_recording(said, tmp_path, change):
    rows = "".join(f"{0.01 * k:.2f},1.5\n" for k in range(50))
    (tmp_path / "t.csv").write_text(f"time_s,thrust_N\n{rows}")
    assert said("import", "t.csv", "--out", "r.csv")[0] == 0
    path = tmp_path / "r.csv.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    code, err = said("report", "r.csv", "--out", "o.html")
    assert code == 2
    assert next(iter(change)) in err
