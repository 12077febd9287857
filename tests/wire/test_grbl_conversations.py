"""Exact conversations with a GRBL 1.1 stage, after what unmodified Grbl 1.1h answered."""

from __future__ import annotations

import pytest

from benchtool.bench.identify import PROBE
from benchtool.bench.stage.grbl import GrblAxis, GrblStage
from benchtool.core.errors import LinkLost, NoDevice, StageError
from benchtool.testing.scripted_link import ScriptedLink, Turn
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


def stage_on(link: ScriptedLink, lateral: GrblAxis | None = None) -> GrblStage:
    return GrblStage(link, GrblAxis("Z", 0.0, -1), 0.05, lateral, clock=link.clock)


def quiet(duration_s: float) -> None:
    pass


class AlwaysLink(ScriptedLink):
    """Answer every question for the state that the script does not expect with one report."""

    def __init__(self, *turns: Turn, always: bytes) -> None:
        super().__init__(*turns)
        self.always = always

    def write(self, data: bytes) -> None:
        if data == b"?" and self._turns and self._turns[0].sent != b"?":
            self._answer += self.always
        else:
            super().write(data)


def opened(*turns: Turn, always: bytes | None = None) -> tuple[ScriptedLink, GrblStage]:
    script = (*OPENING, *turns)
    link = ScriptedLink(*script) if always is None else AlwaysLink(*script, always=always)
    stage = stage_on(link)
    stage.open()
    return link, stage


def test_it_is_woken_homed_moved_and_waited_for():
    link, stage = opened(*MOVED)
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    stage.close()
    link.check_finished()
    assert (link.opened, link.closed) == (1, 1)


@pytest.mark.parametrize("piece", [1, 2, 7])
def test_answers_may_come_in_pieces(piece):
    turns = [Turn(turn.sent, turn.answer, piece) for turn in (*OPENING, *MOVED)]
    link = ScriptedLink(*turns)
    stage = stage_on(link)
    stage.open()
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_a_board_that_boots_misses_the_first_reset():
    link = ScriptedLink(Turn(b"\x18"), *WOKEN, Turn(b"$H\n", b"ok\r\n"))
    stage_on(link).open()
    link.check_finished()
    assert link.now_s > 101.0


def test_nothing_that_answers_is_said_and_the_port_given_back():
    link = ScriptedLink(*[Turn(b"\x18")] * 5, Turn(PROBE))
    with pytest.raises(NoDevice, match="did not answer a reset within 5 s"):
        stage_on(link).open()
    link.check_finished()
    assert link.closed == 1


def test_silence_while_homing_is_not_a_dead_stage():
    link = LateLink(*OPENING, late={b"$H\n": 40.0})
    stage_on(link).open()
    link.check_finished()
    assert link.now_s > 140.0


def test_a_stage_that_never_ends_homing_is_given_up_and_reset():
    # 1540 mm of travel, sought over 1.5 times at 3000 mm/min.
    link = ScriptedLink(*WOKEN, Turn(b"$H\n"), Turn(b"\x18"))
    with pytest.raises(StageError, match="answered nothing to homing for 61 s and is given up"):
        stage_on(link).open()
    link.check_finished()


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


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"error:5\r\n", "refused homing: error:5, homing is switched off"),
        (b"error:77\r\n", "error:77, which its manual explains"),
    ],
)
def test_a_refused_homing_says_why(answer, said):
    link = ScriptedLink(*WOKEN, Turn(b"$H\n", answer))
    with pytest.raises(StageError, match=said):
        stage_on(link).open()
    link.check_finished()


@pytest.mark.parametrize(
    ("number", "said"), [(6, "reset before"), (8, "did not release"), (9, "no limit switch")]
)
def test_an_alarm_while_homing_is_left_by_a_reset(number, said):
    link = ScriptedLink(*WOKEN, Turn(b"$H\n", b"ALARM:%d\r\n" % number), Turn(b"\x18", LOCKED))
    with pytest.raises(StageError, match=f"ALARM:{number}, .*{said}"):
        stage_on(link).open()
    link.check_finished()


def on_the_way(*places_mm: float, state: bytes = b"Run") -> list[Turn]:
    return [Turn(b"?", at(place, state)) for place in places_mm]


def test_ok_means_queued_so_the_state_is_asked_until_it_has_moved():
    places = [-1.0 - 10.0 * number for number in range(20)]
    link, stage = opened(*MOVED[:2], *on_the_way(*places), Turn(b"?", at(-200.0)))
    paused = []
    assert stage.move(0.2, 0.0, 0.0, paused.append) == pytest.approx(0.2)
    link.check_finished()
    assert len(paused) > 50


HOMED = Turn(b"$H\n", b"ok\r\n")

FAILED_MOVES: dict[str, tuple[str, list[Turn], bytes | None]] = {
    "refused": (r"error:9, .* locked out after", [MOVED[0], Turn(MOVE, b"error:9\r\n")], None),
    "unreadable": ("a number cannot be read", [MOVED[0], Turn(MOVE, b"error:2\r\n")], None),
    "off its way": (
        r"was held: it is at Z -221\.000 mm, outside -1\.000 to",
        [*MOVED[:2], *on_the_way(-150.0, -199.9, -221.0), Turn(b"!")],
        None,
    ),
    "silent": (
        r"answered nothing to the move to 0\.2 m for 2 s",
        [*MOVED[:2], *on_the_way(-20.0), Turn(b"!")],
        b"",
    ),
    "held by its button": (
        r"it says Hold:0 for 5 s, which its feed-hold button",
        [*MOVED[:2], *on_the_way(-50.0), Turn(b"!")],
        at(-90.0, b"Hold:0"),
    ),
    "creeping": (
        "held: it did not arrive within 14 s",
        [*MOVED[:2], Turn(b"!")],
        at(-90.0, b"Run"),
    ),
} | {
    f"in state {state}": (
        f"did not finish .*: it says {state}; reset it",
        [*MOVED[:2], *on_the_way(-1.0, state=state.encode()), Turn(b"!")],
        None,
    )
    for state in ("Check", "Door:1", "Sleep", "Jog")
}
"""What the error says, what happens until then, what every further question gets."""


@pytest.mark.parametrize("case", FAILED_MOVES)
def test_a_move_that_fails_says_why(case):
    said, turns, always = FAILED_MOVES[case]
    link, stage = opened(*turns, always=always)
    with pytest.raises(StageError, match=said):
        stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


def test_a_stage_that_stands_elsewhere_is_not_believed():
    _, stage = opened(*MOVED[:2], *on_the_way(-50.0), Turn(b"-"), always=at(-199.5))
    with pytest.raises(StageError, match=r"stands at Z -199\.500 mm instead of -200\.000 mm"):
        stage.move(0.2, 0.0, 0.0, quiet)


RECOVERIES: dict[str, tuple[str, list[Turn], bytes | None]] = {
    "a soft limit keeps the position": (
        "ALARM:2, the target lies outside",
        [
            MOVED[0],
            Turn(MOVE, b"ALARM:2\r\n[MSG:Reset to continue]\r\n"),
            Turn(b"\x18", LOCKED),
            Turn(b"$X\n", b"[MSG:Caution: Unlocked]\r\nok\r\n"),
        ],
        None,
    ),
    "an alarm loses it": (
        "ALARM:1, a limit switch was hit",
        [*MOVED[:2], Turn(b"?", b"ALARM:1\r\n"), Turn(b"\x18", LOCKED), HOMED],
        None,
    ),
    "a reset by somebody else loses it": (
        "started anew",
        [*MOVED[:2], Turn(b"?", LOCKED), HOMED],
        None,
    ),
    "off its way it is reset and homed": (
        "was held",
        [
            *MOVED[:2],
            *on_the_way(-221.0),
            Turn(b"!"),
            Turn(b"?", at(-230.0, b"Hold:0")),
            Turn(b"\x18", BANNER),
            HOMED,
        ],
        None,
    ),
    "half a line is discarded by a reset": (
        r"stands at Z -1\.000 mm instead of -200\.000 mm",
        [MOVED[0], Turn(MOVE), Turn(b"\x18", BANNER), HOMED],
        at(-1.0),
    ),
}


@pytest.mark.parametrize("case", RECOVERIES)
def test_after_a_move_that_failed_the_next_one_is_good(case):
    said, turns, always = RECOVERIES[case]
    link, stage = opened(*turns, *MOVED, always=always)
    with pytest.raises(StageError, match=said):
        stage.move(0.2, 0.0, 0.0, quiet)
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


@pytest.mark.parametrize(
    "turns",
    [
        # One wrong digit in a report at rest does no harm; a question that is lost is asked again.
        [*MOVED[:2], Turn(b"?", at(-220.0)), Turn(b"?", at(-200.0))],
        [Turn(b"?"), Turn(b"?", b"<Id#e|MP"), Turn(b"?", b"\r\n"), *MOVED],
    ],
)
def test_noise_does_no_harm(turns):
    link, stage = opened(*turns)
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


@pytest.mark.parametrize("answer", [b"", b"oj\r\n", b"ok\r\nok\r\n"])
def test_idle_at_the_target_is_arrival_whatever_became_of_the_ok(answer):
    link, stage = opened(
        MOVED[0], Turn(MOVE, answer), *on_the_way(-50.0, -150.0), Turn(b"?", at(-200.0)), *MOVED
    )
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    # What is left of its answers is not taken for that of the next line.
    stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({22: 0}, r"homing switched off \(\$22=0\)"),
        ({20: 0}, r"no soft limits \(\$20=0\)"),
        ({13: 1}, r"reports inches \(\$13=1\)"),
        ({112: 0}, r"has \$112=0; set it above 0"),
    ],
)
def test_what_cannot_be_moved_safely_is_named_before_anything_moves(changed, said):
    link = ScriptedLink(Turn(b"\x18", LOCKED), Turn(b"$$\n", settings_text("", changed)))
    with pytest.raises(StageError, match=said):
        stage_on(link).open()
    link.check_finished()
    assert link.closed == 1


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
        "$112 allows 300 mm/min where the rig's plate.speed_m_s asks for 3000, so moves take "
        "longer; Z stands only on multiples of 0.1 mm ($102=10)"
    )


def test_settings_that_noise_has_spoilt_are_asked_again():
    spoilt = settings_text("").replace(b"$22=1", b"$2\xb2=1")
    link = ScriptedLink(
        Turn(b"\x18", LOCKED), Turn(b"$$\n", spoilt), KNOWN, Turn(b"$H\n", b"ok\r\n")
    )
    stage_on(link).open()
    link.check_finished()


def test_a_homing_whose_alarm_was_lost_is_not_good():
    link = LateLink(*WOKEN, Turn(b"$H\n", b"ok\r\n" + b"\r\n" * 100 + LOCKED, 2), late={})
    with pytest.raises(StageError, match="started anew during homing"):
        stage_on(link).open()


def test_a_slow_stage_gets_the_time_to_stop_after_a_hold():
    slow = Turn(b"$$\n", settings_text("", {122: 5}))
    link = ScriptedLink(
        Turn(b"\x18", LOCKED),
        slow,
        Turn(b"$H\n", b"ok\r\n"),
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


def test_after_a_hold_the_rest_of_the_move_is_thrown_away_once_it_stands():
    link, stage = opened(
        Turn(b"!"),
        Turn(b"?", at(-90.0, b"Hold:1")),
        Turn(b"?", at(-91.0, b"Hold:0")),
        Turn(b"\x18", BANNER),
        *MOVED,
    )
    stage.hold()
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_a_hold_is_resumed_only_when_it_stands():
    link, stage = opened(
        Turn(b"!"),
        Turn(b"?", at(-90.0, b"Hold:1")),
        Turn(b"?", at(-90.5, b"Hold:1")),
        Turn(b"?", at(-91.0, b"Hold:0")),
        Turn(b"~"),
    )
    paused = []
    stage.hold()
    stage.resume(paused.append)
    link.check_finished()
    assert paused == [0.2, 0.2]


def test_the_offset_between_work_and_machine_comes_only_sometimes():
    work = b"<Idle|WPos:0.000,0.000,%.3f|FS:0,0%s>\r\n"
    link, stage = opened(
        Turn(b"?", work % (9.0, b"")),
        Turn(b"?", work % (9.0, b"|Ov:100,100,100")),
        Turn(b"?", work % (9.0, b"|WCO:0.000,0.000,-10.000")),
        Turn(MOVE, b"ok\r\n"),
        Turn(b"?", work % (-190.0, b"")),
    )
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_a_lateral_axis_moves_along():
    link = ScriptedLink(
        *OPENING,
        Turn(b"?", at(-1.0)),
        Turn(b"G21 G90 G53 G1 Z-200.000 X-249.000 F3000.0\n", b"ok\r\n"),
        Turn(b"?", b"<Idle|MPos:-249.000,-1.000,-200.000|FS:0,0>\r\n"),
    )
    stage = stage_on(link, GrblAxis("X", 0.3))
    stage.open()
    assert stage.move(0.2, 0.051, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_what_the_stage_cannot_do_is_refused_before_anything_is_sent():
    link, stage = opened()
    with pytest.raises(StageError, match="no lateral axis"):
        stage.move(0.2, 0.1, 0.0, quiet)
    with pytest.raises(StageError, match="no tilt axis"):
        stage.move(0.2, 0.0, 0.1, quiet)
    link.check_finished()


def test_an_axis_that_is_not_there_is_named():
    link = ScriptedLink(*WOKEN)
    stage = GrblStage(link, GrblAxis("A", 0.0), 0.05, clock=link.clock)
    with pytest.raises(StageError, match="has axes X Y Z, not A"):
        stage.open()
    link.check_finished()


def test_a_link_that_breaks_is_a_lost_link():
    link, stage = opened()
    link.write_after_end = LinkLost("gone")
    with pytest.raises(LinkLost):
        stage.move(0.2, 0.0, 0.0, quiet)
