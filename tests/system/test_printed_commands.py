"""Every command that the tool prints as a next step runs as printed, on a rig of one's own.

The printed words stay as they are but for what a person fills in: ADDRESS is a virtual bench of the
own rig, and `--yes` stands for the typed arming.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchtool.core.errors import ModelRejected
from tests.unit.commands.command_line import said

BENCH = "sim:mine.toml?truth=truth.toml&seed=7"

MODEL = """
[model]
name = "own"
rig = "mine.toml"
description = "One rotor, eq. (2)."
[parameters]
k.free = true
R_m.free = true
[effects.rotor_images]
own_strength = 1.0
"""

FASTER = {"explain": ["--draws", "20"]}  # options that a test adds so as not to wait


def printed(text: str) -> Iterator[list[str]]:
    """Return the commands in what a command printed, without the remarks between."""
    for line in text.splitlines():
        found = re.search(r"(?:^|with: ?|use |type )(benchtool .*)$", line.strip())
        if found:
            yield shlex.split(found[1])[1:]


def completed(words: list[str]) -> list[str]:
    """Return a printed command with what a person fills in."""
    words = [BENCH if word == "ADDRESS" else word for word in words]
    armed = ["--yes"] if words[0] == "sweep" and "--yes" not in words else []
    return [*words, *armed, *FASTER.get(words[0], [])]


class Session:
    """Run commands, and the commands that those print, each once."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys
        self.done: list[list[str]] = []

    def run(self, *words: str, deep: int = 0) -> str:
        """Return what a command printed; so many levels of what it prints are run, too."""
        self.done.append(list(words))
        code, out, error = said(self.capsys, *words)
        # A rejected model is an answer, and is written.
        assert code in (0, ModelRejected.exit_code), (words, error)
        for step in printed(out):
            assert "unknown rig" not in error
            if deep and step not in self.done and completed(step) not in self.done:
                self.run(*completed(step), deep=deep - 1)
        return out


@pytest.fixture
def session(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    return Session(capsys)


def names(session: Session) -> list[str]:
    return [words[0] for words in session.done]


def test_what_rigs_new_prints_runs(session):
    session.run("library", "rigs", "new", "mine", "--radius", "0.12", deep=1)
    assert names(session) == ["library", "library", "sweep"]


def test_what_explain_prints_runs_on_a_rig_of_ones_own(session):
    session.run("library", "rigs", "new", "mine", "--radius", "0.12")
    Path("model.toml").write_text(MODEL)
    Path("truth.toml").write_text(MODEL + "[effects.plate_offset]\ndz_m = 0.012\n")
    options = ["--pwm", "1500,1600", "--repeats", "2", "--yes"]
    for name, distances in (("learn", "0.6,0.8,1,2"), ("check", "0.7,1.2,3")):
        session.run("sweep", f"{BENCH}{name[0] == 'c':d}", "--z-over-r", distances, *options,
            "--out", name)  # fmt: skip
    # A fit names its rig for whatever takes its model again.
    session.run("fit", "learn", "--model", "single", "--noise", "scale", "--out", "fitted")
    for words in (
        ["report", "fitted", "--out", "page.html"],
        ["fit", "check", "--model", "fitted/model.toml", "--noise", "scale"],
        ["sweep", "sim:fitted/rig.toml?truth=fitted/model.toml", "--dry-run"],
        ["library", "models", "fitted/model.toml"],
    ):
        session.run(*words)
    words = ["explain", "learn", "--model", "fitted/model.toml", "--check", "check"]
    words += ["--draws", "20", "--out", "found", "--verbose"]
    session.run(*words, deep=1)
    steps = session.done[session.done.index(words) + 1 :]
    assert {words[0] for words in steps} >= {"sweep", "explain"}, steps
