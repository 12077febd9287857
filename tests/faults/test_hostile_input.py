"""Hostile words, addresses and files end in one sentence of our own, never in a traceback."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from benchtool.cli.app import main

DIGITS = "1" * 4400
DEEP = "[" * 3000
LONG = "a" * 300
SWEEP = ["sweep", "sim:pquad_single", "--z-over-r", "1", "--pwm", "1450", "--repeats", "1"]
SHORT = [*SWEEP, "--sample-s", "0.2", "--yes"]

Said = Callable[..., tuple[int, str]]


@pytest.fixture
def said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Said:
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
        (["rigs", "fifo"], "this is a pipe"),
        (["rigs", LONG], "unknown rig"),
        (["rigs", f"{LONG}.toml"], "longer than the system allows"),
        (["models", "/dev/zero"], "this is a device"),
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
def test_words_and_paths(said: Said, tmp_path: Path, words: list[str], says: str) -> None:
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
@pytest.mark.parametrize("command", ["sweep", "doctor"])
def test_addresses(said: Said, command: str, address: str) -> None:
    words = [*SWEEP[2:], "--rig", "pquad_single", "--yes"] if command == "sweep" else []
    code, err = said(command, address, *words)
    assert code in (2, 3) or command == "doctor"
    assert err.count("\n") <= 1


@pytest.mark.parametrize("value", [DIGITS, DEEP, f"{DEEP}{']' * 3000}"], ids=["digits", "[", "[]"])
@pytest.mark.parametrize(
    "words",
    [
        ["sweep", "sim:pquad_single", "--plan", "x.toml", "--dry-run"],
        ["rigs", "x.toml"],
        ["models", "x.toml"],
        ["simulate", "pitch", "--gains", "x.toml", "--duration-s", "1"],
        ["simulate", "pitch", "--schedule", "x.toml", "--duration-s", "1"],
        ["simulate", "flight", "--map", "x.toml", "--duration-s", "1"],
        ["fit", "t.csv", "--model", "single", "--columns", "x.toml"],
        ["import", "t.csv", "--columns", "x.toml", "--dry-run"],
        ["fit", "--recipe", "."],
        [*SHORT, "--calibration", "c.json"],
    ],
    ids=lambda words: " ".join(words)[:50],
)
def test_toml_and_json(said: Said, tmp_path: Path, words: list[str], value: str) -> None:
    (tmp_path / "t.csv").write_text("thrust_N,rpm1,plate_z_m\n2.4,4500,0.06\n2.3,4500,0.24\n")
    for name in ("x.toml", "recipe.toml"):
        (tmp_path / name).write_text(f"repeats = {value}\n")
    (tmp_path / "c.json").write_text(json.dumps({"id": "a"})[:-1] + f', "x": {value}}}')
    code, err = said(*words)
    assert code == 2
    assert any(words in err for words in ("beyond", "nested deeper", "not valid"))
