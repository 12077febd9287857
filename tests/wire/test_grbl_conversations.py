"""Exact conversations with a GRBL 1.1 stage, after what unmodified Grbl 1.1h answered."""

from __future__ import annotations

import pytest

from benchtool.bench.grbl_stage import GrblAxis, GrblStage
from benchtool.bench.strangers import KNOCK
from benchtool.errors import LinkLost, NoDevice, StageError
from benchtool.testing.scripted_link import ScriptedLink, Turn

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCKED = BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"
OPENING = (Turn(b"\x18", LOCKED), Turn(b"$H\n", b"ok\r\n"))
MOVE = b"G21 G90 G53 G1 Z-200.000 F3000.0\n"
DWELL = b"G4 P0\n"


def at(z_mm: float, state: bytes = b"Idle", rest: bytes = b"|FS:0,0") -> bytes:
    return b"<%s|MPos:-1.000,-1.000,%.3f%s>\r\n" % (state, z_mm, rest)


MOVED = (
    Turn(b"?", at(-1.0)),
    Turn(MOVE, b"ok\r\n"),
    Turn(DWELL, b"ok\r\n"),
    Turn(b"?", at(-200.0)),
    Turn(b"?", at(-200.0)),
)


class LateLink(ScriptedLink):
    """Answer some lines only after a while; `?` that is asked meanwhile stays without answer."""

    def __init__(self, *turns: Turn, late: dict[bytes, float], deaf: bool = False) -> None:
        super().__init__(*turns)
        self._late = late
        self._deaf = deaf
        self._ready_s = 0.0
        self.asked = 0

    def write(self, data: bytes) -> None:
        if data == b"?" and self.now_s < self._ready_s and not self._deaf:
            self.asked += 1
            self._answer = at(-50.0, b"Run") + self._answer
            return
        super().write(data)
        self._ready_s = self.now_s + self._late.get(data, 0.0)
        self._whole, self._answer = self._answer, b""

    def read(self, timeout_s: float) -> bytes:
        if self.now_s >= self._ready_s and getattr(self, "_whole", b""):
            self._answer, self._whole = self._answer + self._whole, b""
        return super().read(timeout_s)


def stage_on(link: ScriptedLink, lateral: GrblAxis | None = None) -> GrblStage:
    return GrblStage(link, GrblAxis("Z", 0.0, -1), 0.05, lateral, clock=link.clock)


def quiet(duration_s: float) -> None:
    pass


def opened(*turns: Turn, **options: object) -> tuple[ScriptedLink, GrblStage]:
    link = ScriptedLink(*OPENING, *turns)
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
    link = ScriptedLink(Turn(b"\x18"), Turn(b"\x18", LOCKED), Turn(b"$H\n", b"ok\r\n"))
    stage_on(link).open()
    link.check_finished()
    assert link.now_s > 101.0


def test_nothing_that_answers_is_said_and_the_port_given_back():
    link = ScriptedLink(*[Turn(b"\x18")] * 5, Turn(KNOCK))
    with pytest.raises(NoDevice, match="did not answer a reset within 5 s"):
        stage_on(link).open()
    link.check_finished()
    assert link.closed == 1


def test_silence_while_homing_is_not_a_dead_stage():
    link = LateLink(*OPENING, late={b"$H\n": 40.0})
    stage_on(link).open()
    link.check_finished()
    assert link.now_s > 140.0


def test_a_stage_that_never_ends_homing_is_given_up():
    link = ScriptedLink(Turn(b"\x18", LOCKED), Turn(b"$H\n"))
    with pytest.raises(StageError, match="answered nothing to homing for 90 s and is given up"):
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
    link = InterruptedLink(Turn(b"\x18", LOCKED), Turn(b"$H\n"), Turn(b"\x18"))
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
    link = ScriptedLink(Turn(b"\x18", LOCKED), Turn(b"$H\n", answer))
    with pytest.raises(StageError, match=said):
        stage_on(link).open()
    link.check_finished()


@pytest.mark.parametrize(
    ("number", "said"), [(6, "reset before"), (8, "did not release"), (9, "no limit switch")]
)
def test_an_alarm_while_homing_is_left_by_a_reset(number, said):
    link = ScriptedLink(
        Turn(b"\x18", LOCKED), Turn(b"$H\n", b"ALARM:%d\r\n" % number), Turn(b"\x18", LOCKED)
    )
    with pytest.raises(StageError, match=f"ALARM:{number}, .*{said}"):
        stage_on(link).open()
    link.check_finished()


def test_a_soft_limit_is_left_by_a_reset_and_keeps_the_position():
    link, stage = opened(
        Turn(b"?", at(-1.0)),
        Turn(b"G21 G90 G53 G1 Z-900.000 F3000.0\n", b"ALARM:2\r\n[MSG:Reset to continue]\r\n"),
        Turn(b"\x18", LOCKED),
        Turn(b"$X\n", b"[MSG:Caution: Unlocked]\r\nok\r\n"),
        *MOVED,
    )
    with pytest.raises(StageError, match="ALARM:2, the target lies outside"):
        stage.move(0.9, 0.0, 0.0, quiet)
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_after_an_alarm_that_loses_the_position_it_is_homed():
    link, stage = opened(
        Turn(b"?", at(-1.0)),
        Turn(MOVE, b"ok\r\n"),
        Turn(DWELL, b"ALARM:1\r\n"),
        Turn(b"\x18", LOCKED),
        Turn(b"$H\n", b"ok\r\n"),
        *MOVED,
    )
    with pytest.raises(StageError, match="ALARM:1, a limit switch was hit"):
        stage.move(0.2, 0.0, 0.0, quiet)
    stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


def test_a_reset_by_somebody_else_loses_the_position():
    link, stage = opened(
        Turn(b"?", at(-1.0)),
        Turn(MOVE, b"ok\r\n"),
        Turn(DWELL, LOCKED),
        Turn(b"$H\n", b"ok\r\n"),
        *MOVED,
    )
    with pytest.raises(StageError, match="started anew"):
        stage.move(0.2, 0.0, 0.0, quiet)
    stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"error:9\r\n", "locked out after an alarm"),
        (b"error:22\r\n", "no feed rate"),
        (b"error:2\r\n", "a number cannot be read"),
    ],
)
def test_a_refused_move_says_why(answer, said):
    link, stage = opened(Turn(b"?", at(-1.0)), Turn(MOVE, answer))
    with pytest.raises(StageError, match=said):
        stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


def test_ok_means_queued_so_the_state_is_asked_until_it_has_moved():
    link = LateLink(*OPENING, *MOVED, late={DWELL: 3.0})
    stage = stage_on(link)
    stage.open()
    paused = []
    assert stage.move(0.2, 0.0, 0.0, paused.append) == pytest.approx(0.2)
    link.check_finished()
    assert link.asked == pytest.approx(3.0 / 0.2, abs=2)
    assert len(paused) > 50


def test_a_stage_that_falls_silent_while_moving_is_given_up():
    _, stage = opened(Turn(b"?", at(-1.0)), Turn(MOVE, b"ok\r\n"), Turn(DWELL), *[Turn(b"?")] * 10)
    with pytest.raises(StageError, match=r"answered nothing to the move to 0\.2 m for 2 s"):
        stage.move(0.2, 0.0, 0.0, quiet)


def test_a_feed_hold_that_nobody_lifts_runs_into_the_time_limit():
    link, stage = opened(
        Turn(b"?", at(-1.0)),
        Turn(MOVE, b"ok\r\n"),
        Turn(DWELL),
        *[Turn(b"?", at(-90.0, b"Hold:0"))] * 69,
        Turn(b"!"),
    )
    with pytest.raises(StageError, match=r"did not finish the move to 0\.2 m within 14 s"):
        stage.move(0.2, 0.0, 0.0, quiet)
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


def test_a_stage_that_lost_steps_is_not_believed():
    link, stage = opened(*MOVED[:-2], Turn(b"?", at(-199.5)), Turn(b"?", at(-199.5)))
    with pytest.raises(StageError, match=r"stands at Z -199\.500 mm instead of -200\.000 mm"):
        stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


def test_the_offset_between_work_and_machine_comes_only_sometimes():
    work = b"<Idle|WPos:0.000,0.000,%.3f|FS:0,0%s>\r\n"
    link, stage = opened(
        Turn(b"?", work % (9.0, b"")),
        Turn(b"?", work % (9.0, b"|Ov:100,100,100")),
        Turn(b"?", work % (9.0, b"|WCO:0.000,0.000,-10.000")),
        Turn(MOVE, b"ok\r\n"),
        Turn(DWELL, b"ok\r\n"),
        Turn(b"?", work % (-190.0, b"")),
        Turn(b"?", work % (-190.0, b"")),
    )
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    link.check_finished()


def test_a_lateral_axis_moves_along():
    link = ScriptedLink(
        *OPENING,
        Turn(b"?", at(-1.0)),
        Turn(b"G21 G90 G53 G1 Z-200.000 X-249.000 F3000.0\n", b"ok\r\n"),
        Turn(DWELL, b"ok\r\n"),
        *[Turn(b"?", b"<Idle|MPos:-249.000,-1.000,-200.000|FS:0,0>\r\n")] * 2,
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
    link = ScriptedLink(*OPENING, Turn(b"?", at(-1.0)))
    stage = GrblStage(link, GrblAxis("A", 0.0), 0.05, clock=link.clock)
    stage.open()
    with pytest.raises(StageError, match="reports no axis A, only X Y Z"):
        stage.move(0.2, 0.0, 0.0, quiet)
    link.check_finished()


def test_a_link_that_breaks_is_a_lost_link():
    link = ScriptedLink(*OPENING, then=LinkLost("gone"))
    stage = stage_on(link)
    stage.open()
    link.write_after_end = LinkLost("gone")
    with pytest.raises(LinkLost):
        stage.move(0.2, 0.0, 0.0, quiet)
