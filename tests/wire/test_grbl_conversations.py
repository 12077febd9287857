"""Exact conversations with a GRBL 1.1 stage, after what unmodified Grbl 1.1h answered."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path

import pytest

from benchtool.bench.identify import PROBE
from benchtool.bench.stage.grbl import GrblStage
from benchtool.core import errors
from tests.doubles.grbl import grbl_stage
from tests.doubles.scripted_link import ScriptedLink, Turn
from tests.wire.grbl_recordings import settings_text

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCKED = BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"
KNOWN = Turn(b"$$\n", settings_text(""))
WOKEN = (Turn(b"\x18", LOCKED), KNOWN)
OPENING = (*WOKEN, Turn(b"$H\n", b"ok\r\n"))
MOVE = b"G21 G90 G53 G1 Z-200.000 F3000.0\n"


def at(z_mm: float, state: bytes = b"Idle", rest: bytes = b"|FS:0,0") -> bytes:
    return b"<%s|MPos:-1.000,-1.000,%.3f%s>\r\n" % (state, z_mm, rest)


MOVED = (
    Turn(b"?", at(-1.0)),
    Turn(MOVE, b"ok\r\n"),
    Turn(b"?", at(-200.0)),
)


class AlwaysLink(ScriptedLink):
    """Answer every question for the state that the script does not expect with one report."""

    always: bytes | None = None

    def write(self, data: bytes) -> None:
        expected = self._turns[0].sent if self._turns else b""
        if self.always is not None and data == b"?" != expected:
            self._answer += self.always
        else:
            super().write(data)


def stage_on(link: ScriptedLink, lateral: str = "") -> GrblStage:
    return grbl_stage(link, f"zero_mm=0&direction=-1{lateral}", speed_m_s=0.05)


def quiet(duration_s: float) -> None:
    pass


TALKS = Path(__file__).with_name("grbl_talks.txt").read_text("utf-8").strip().split("\n\n")
"""What is called, with the error or the distance that it brings, then lines of the host, and behind
the arrow those of the stage; `[Run -1]` stands for a report with Z there. A stage that nothing
opens was opened before."""

SENT = {"RESET": b"\x18", "MOVE": MOVE, "PROBE": PROBE} | {word: word.encode() for word in "?!~"}
SAID = {"": b"", "LOCKED": LOCKED, "BANNER": BANNER, "CRLF": b"\r\n"}
TURNS = {"OPENING": OPENING, "WOKEN": WOKEN, "MOVED": MOVED, "MOVING": MOVED[:2]}


def turns_of(line: str, settings: bytes) -> Iterable[Turn]:
    """Return what a line of a conversation stands for."""
    sent, arrow, answer = line.partition(" ->")
    if not arrow:
        return [
            turn if turn.sent != KNOWN.sent else Turn(turn.sent, settings) for turn in TURNS[line]
        ]
    known = SAID | {
        "SETTINGS": settings,
        "SPOILT": settings.replace(b"$22=1", b"$2\xb2=1"),
        "SHORT": settings.replace(b"$132=1500\r\n", b""),
    }
    said = b""
    for text in answer.strip().split(" + "):
        if found := re.fullmatch(r"\[(\w+(?::\d)?) (-?[\d.]+)\]", text):
            said += at(float(found[2]), found[1].encode())
        elif text.endswith("~"):
            said += text[:-1].encode()
        else:
            said += known[text] if text in known else text.encode() + b"\r\n"
    return [Turn(SENT[sent] if sent in SENT else sent.encode() + b"\n", said)]


@pytest.mark.parametrize("talk", TALKS, ids=lambda talk: talk.split("\n")[0])
def test_an_exact_conversation(talk):
    _, *lines = talk.split("\n")
    turns = [line for line in lines if "->" in line or line in TURNS]
    calls = [line for line in lines if line not in turns]
    if not any(line.startswith("open") for line in calls):
        turns, calls = ["OPENING", *turns], ["open", *calls]
    changed = {}
    if calls[0].startswith("settings"):
        changed = {
            int(n): float(v) for n, v in (word.split("=") for word in calls.pop(0).split()[1:])
        }
    script = [turn for line in turns for turn in turns_of(line, settings_text("", changed))]
    link = AlwaysLink(*script)
    stage = stage_on(link)
    for line in calls:
        words, _, failure = line.partition(" ! ")
        words, _, reached = words.partition(" = ")
        kind, _, said = failure.partition(" ")
        name, *given = words.split()
        with pytest.raises(getattr(errors, kind), match=said) if kind else nullcontext():
            if name == "always":
                (link.always,) = (turn.answer for turn in turns_of(f"? ->{words[6:]}", b""))
            elif name == "move":
                place = [*map(float, given or ["0.2"]), 0.0, 0.0][:3]
                assert stage.move(*place, quiet) == pytest.approx(float(reached))
            else:
                getattr(stage, name)()
    link.check_finished()
    assert link.closed == (calls[-1] == "close" or "open ! " in talk)


@pytest.mark.parametrize("piece", [1, 2, 7])
def test_answers_may_come_in_pieces(piece):
    link = ScriptedLink(*[Turn(turn.sent, turn.answer, piece) for turn in (*OPENING, *MOVED)])
    stage = stage_on(link)
    stage.open()
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


class LateLink(ScriptedLink):
    """Answer some lines only after a while."""

    def __init__(self, *turns: Turn, late: dict[bytes, float]) -> None:
        super().__init__(*turns)
        self._late = late
        self._ready_s = 0.0
        self._whole = b""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._ready_s = self.now_s + self._late.get(data, 0.0)
        self._whole, self._answer = self._answer, b""

    def read(self, timeout_s: float) -> bytes:
        if self.now_s >= self._ready_s and self._whole:
            self._answer, self._whole = self._answer + self._whole, b""
        return super().read(timeout_s)


def test_silence_while_homing_is_not_a_dead_stage():
    link = LateLink(*OPENING, late={b"$H\n": 40.0})
    stage_on(link).open()
    link.check_finished()
    assert link.now_s > 140.0


class InterruptedLink(ScriptedLink):
    """Ctrl-C comes while the stage homes."""

    homing = False

    def write(self, data):
        self.homing = data == b"$H\n"
        super().write(data)

    def read(self, timeout_s):
        if self.homing:
            raise KeyboardInterrupt
        return super().read(timeout_s)


def test_a_homing_that_is_interrupted_is_ended_by_a_reset():
    link = InterruptedLink(*WOKEN, Turn(b"$H\n"), Turn(b"\x18"))
    with pytest.raises(KeyboardInterrupt):
        stage_on(link).open()
    link.check_finished()
    assert link.closed == 1


def on_the_way(*places_mm: float) -> list[Turn]:
    return [Turn(b"?", at(place, b"Run")) for place in places_mm]


def test_ok_means_queued_so_the_state_is_requested_until_it_has_moved():
    places = [-1.0 - 10.0 * number for number in range(20)]
    link = ScriptedLink(*OPENING, *MOVED[:2], *on_the_way(*places), Turn(b"?", at(-200.0)))
    stage, paused = stage_on(link), []
    stage.open()
    assert stage.move(0.2, 0.0, 0.0, paused.append) == pytest.approx(0.2)
    link.check_finished()
    assert len(paused) > 50


def test_a_slow_axis_gets_its_time_and_is_named():
    places = [-1.0 - 1.0 * number for number in range(199)]
    slow = Turn(b"$$\n", settings_text("", {112: 300, 102: 10}))
    opening = (Turn(b"\x18", LOCKED), slow, Turn(b"$H\n", b"ok\r\n"))
    link = ScriptedLink(*opening, *MOVED[:2], *on_the_way(*places), Turn(b"?", at(-200.05)))
    stage = stage_on(link)
    stage.open()
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.20005)
    link.check_finished()
    assert stage.facts["remark"] == (
        "$112 allows 300 mm/min, below the rig's plate.speed_m_s of 3000, so moves take "
        "longer; Z has steps of 0.1 mm ($102=10)"
    )


def test_a_homing_whose_alarm_was_lost_is_not_good():
    link = LateLink(*WOKEN, Turn(b"$H\n", b"ok\r\n" + b"\r\n" * 100 + LOCKED, 2), late={})
    with pytest.raises(errors.StageError, match="restarted during homing"):
        stage_on(link).open()


def test_a_slow_stage_gets_the_time_to_stop_after_a_hold():
    slow = Turn(b"$$\n", settings_text("", {122: 8}))
    link = ScriptedLink(
        *(Turn(b"\x18", LOCKED), slow, Turn(b"$H\n", b"ok\r\n")),
        Turn(b"!"),
        *[Turn(b"?", at(-90.0, b"Hold:1"))] * 40,
        Turn(b"?", at(-91.0, b"Hold:0")),
        Turn(b"\x18", BANNER),
        *MOVED,
    )
    stage = stage_on(link)
    stage.open()
    stage.hold()
    stage.move(0.2, 0.0, 0.0, link.pause)
    link.check_finished()


def test_a_lateral_axis_moves_along():
    link = ScriptedLink(
        *OPENING,
        Turn(b"?", at(-1.0)),
        Turn(b"G21 G90 G53 G1 Z-200.000 X-249.000 F3000.0\n", b"ok\r\n"),
        Turn(b"?", b"<Idle|MPos:-249.000,-1.000,-200.000|FS:0,0>\r\n"),
    )
    stage = stage_on(link, "&lateral=X&lateral_zero_mm=300")
    stage.open()
    assert stage.move(0.2, 0.051, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_a_link_that_breaks_is_a_lost_link():
    link = ScriptedLink(*OPENING)
    stage = stage_on(link)
    stage.open()
    link.write_after_end = errors.LinkLost("gone")
    with pytest.raises(errors.LinkLost):
        stage.move(0.2, 0.0, 0.0, quiet)
