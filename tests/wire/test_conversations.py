"""Exact conversations between host and device: bytes out expected, bytes in prepared."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.serial.frames import (
    HEARTBEAT,
    build_payload,
    crc16,
    frame,
    frame_command,
    frame_fields,
)
from benchtool.bench.serial.hello import hello_lines
from benchtool.core import errors
from tests.doubles.scripted_link import ScriptedLink, Talker, Turn
from tests.wire.still_plant import still_hello


def ack(number: int, *fields: str, time_us: int = 0) -> bytes:
    return frame_fields("A", (str(number), str(time_us), *fields))


def hello_answer(number: int, **changes: object) -> bytes:
    lines = hello_lines(still_hello(**changes))
    payloads = [build_payload("H", (str(index), *line)) for index, line in enumerate(lines)]
    whole = crc16(b"".join(payload + b"\n" for payload in payloads))
    return b"".join(map(frame, payloads)) + ack(number, str(len(lines)), f"{whole:04X}")


def framed(payload: str) -> bytes:
    return frame(payload.strip().encode()) if payload.strip() else b""


def sample(sequence: int, thrust: str = "1.5") -> bytes:
    return frame(b"S,%d,%d,1000,1000,%s,0.1,12" % (sequence, 10_000 * sequence, thrust.encode()))


HELLO = frame_command(1, wire.RequestHello())
OPENING = (
    Turn(HELLO, hello_answer(1)),
    Turn(frame_command(2, wire.Clear()), ack(2)),
    Turn(frame_command(3, wire.SetRate(100.0)), ack(3)),
)


def bench_on(link: ScriptedLink) -> SerialBench:
    return SerialBench(link, "serial:scripted", clock=link.clock)


def opened(*turns: Turn) -> tuple[SerialBench, ScriptedLink]:
    link = ScriptedLink(*OPENING, *turns)
    bench = bench_on(link)
    bench.open()
    return bench, link


def test_open_read_close():
    stream = Turn(frame_command(3, wire.SetRate(100.0)), ack(3) + sample(0) + sample(1, ""))
    link = ScriptedLink(
        *OPENING[:2],
        stream,
        Turn(frame_command(4, wire.StopDevice(), 10_000), ack(4, time_us=11_000)),
        Turn(frame_command(5, wire.SetRate(0.0), 11_000), ack(5)),
    )
    with bench_on(link) as bench:
        identity = bench.identity
        readings = bench.read(0.1)
    link.check_finished()
    assert (link.active, link.closed) == (1, 1)
    assert identity.device_id == "bench-0042"
    assert identity.protocol == "benchtool-2"
    assert identity.rate_Hz == 100.0
    assert identity.facts["load_cell"] == "HX711 no 7"
    np.testing.assert_array_equal(readings.device_time_us, [0, 10_000])
    np.testing.assert_array_equal(
        readings.values, [[1000, 1000, 1.5, 0.1, 12], [1000, 1000, np.nan, 0.1, 12]]
    )
    assert np.diff(readings.time_s) == pytest.approx(0.01)
    bench.close()
    assert link.closed == 1


def test_answers_may_come_byte_by_byte():
    link = ScriptedLink(*[Turn(turn.sent, turn.answer, piece=40) for turn in OPENING])
    bench = bench_on(link)
    bench.open()
    bench.open()  # twice is once
    link.check_finished()
    assert link.active == 1


SPIN, CLEAR = np.array([1200.0, 1200.0]), wire.Clear()
STOPPED = frame(b"E,watchdog,no line for 260 ms; motors stopped")

TALKS = Path(__file__).with_name("serial_talks.txt").read_text("utf-8").strip().split("\n\n")
"""Calls, with the error or the number of samples that they bring, and what then goes over the wire:
payloads of the host, and behind the arrow those of the device."""


def call(bench: SerialBench, link: ScriptedLink, text: str) -> object:
    """Make a call as it stands in `TALKS`."""
    name, *words = text.split()
    given = [float(word) for word in words]
    if name == "pause":
        return link.pause(*given)
    return getattr(bench, name)(*([np.array(given)] if name == "set_pwm" else given))


@pytest.mark.parametrize("talk", TALKS, ids=lambda talk: talk.split("\n")[0])
def test_an_exact_conversation(talk):
    _, *lines = talk.split("\n")
    wires = [line.split(" ->") for line in lines if "->" in line]
    bench, link = opened(
        *[Turn(framed(sent), b"".join(map(framed, answer.split(" + ")))) for sent, answer in wires]
    )
    for line in lines[: len(lines) - len(wires)]:
        words, _, failure = line.partition(" ! ")
        words, _, count = words.partition(" = ")
        kind, _, said = failure.partition(" ")
        with pytest.raises(getattr(errors, kind), match=said) if kind else nullcontext():
            found = call(bench, link, words)
            assert not count or len(found) == int(count)  # type: ignore[arg-type]
    link.check_finished()


def test_a_hello_with_a_lost_line_is_requested_again():
    whole = hello_answer(1).splitlines(keepends=True)
    link = ScriptedLink(
        Turn(HELLO, b"".join(whole[:5] + whole[6:])),
        Turn(frame_command(2, wire.RequestHello()), hello_answer(2)),
        Turn(frame_command(3, CLEAR), ack(3)),
        Turn(frame_command(4, wire.SetRate(100.0)), ack(4)),
    )
    bench_on(link).open()
    link.check_finished()


def test_a_board_that_boots_first_is_waited_for():
    tries: list[Turn] = []
    for number in range(1, 9):
        said = b"ets Jul 29 2019\r\n" if number == 3 else b""
        tries += [Turn(frame_command(number, wire.RequestHello()), said), *[Turn(HEARTBEAT)] * 2]
    link = ScriptedLink(
        *tries,
        Turn(frame_command(9, wire.RequestHello()), frame(b"E,boot,power on") + hello_answer(9)),
        Turn(frame_command(10, CLEAR), ack(10)),
        Turn(frame_command(11, wire.SetRate(100.0)), ack(11)),
    )
    bench = bench_on(link)
    bench.open()
    link.check_finished()
    assert bench.read(0.0).messages == ()


NOT_OPENED: dict[str, tuple[Callable[[], ScriptedLink], type[errors.BenchError], str]] = {
    "silence": (Talker, errors.NoDevice, "sent nothing for 5 s"),
    "something else": (
        lambda: Talker(b"\r\nGrbl 1.1h ['$' for help]\r\n"),
        *(errors.ProtocolError, "it is a G-code stage; use --stage grbl:"),
    ),
    "another version": (
        lambda: ScriptedLink(Turn(HELLO, hello_answer(1, version=7))),
        *(errors.ProtocolError, "protocol version 7, this program version 2"),
    ),
    "version 1, whose lines have no index": (
        lambda: ScriptedLink(Turn(HELLO, frame(b"H,protocol,1") + ack(1, "1"))),
        *(errors.ProtocolError, "protocol version 1, this program version 2"),
    ),
    "version 1, which refuses the hello": (
        lambda: ScriptedLink(Turn(HELLO, frame(b"N,1,this device speaks version 1"))),
        *(errors.ProtocolError, "rejected the hello: this device speaks version 1"),
    ),
    "a refused hello": (
        lambda: ScriptedLink(
            Turn(HELLO, frame(b"N,1,0,not today")),
        ),
        *(errors.ProtocolError, "rejected the hello: not today"),
    ),
    "held by somebody else": (
        lambda: ScriptedLink(Turn(HELLO, frame(b"E,busy,192.0.2.7:5100"))),
        *(errors.PortBusy, r"in use by 192\.0\.2\.7:5100"),
    ),
    "a port in use": (
        lambda: ScriptedLink(refuses=errors.PortBusy("taken")),
        errors.PortBusy,
        "taken",
    ),
}


@pytest.mark.parametrize("case", NOT_OPENED)
def test_what_cannot_be_opened_is_named_and_closed(case):
    make, kind, said = NOT_OPENED[case]
    link = make()
    bench = SerialBench(link, "serial:scripted", clock=link.clock)
    with pytest.raises(kind, match=said):
        bench.open()
    assert link.closed == 1
    assert link.now_s < 105.3 + 0.6  # a probe of what is silent, at most


def test_losses_are_counted_once():
    damaged = sample(3).replace(b"1.5", b"7.5")
    bench, _ = opened(Turn(HEARTBEAT, sample(0) + sample(2) + damaged + sample(4)))
    readings = bench.read(0.3)
    assert (len(readings), readings.lost, readings.corrupt) == (3, 2, 1)
    assert bench.read(0.0).lost == 0


def test_a_stop_of_the_device_comes_before_the_samples_around_it_and_none_is_lost():
    event = frame(b"E,limit,thrust_N 31 against limit 30; motors stopped")
    bench, link = opened(Turn(HEARTBEAT, sample(0) + event + sample(1)))
    with pytest.raises(errors.DeviceStopped, match="thrust_N 31 against limit 30"):
        bench.read(0.3)
    readings = bench.read(0.3)
    assert len(readings) == 2
    assert readings.messages == ("limit: thrust_N 31 against limit 30; motors stopped",)
    with pytest.raises(errors.DeviceStopped):
        bench.set_pwm(SPIN)
    link.check_finished()


def test_what_stopped_the_device_before_we_came_is_not_our_stop():
    link = ScriptedLink(
        Turn(HELLO, STOPPED + hello_answer(1) + STOPPED),
        Turn(frame_command(2, CLEAR), STOPPED + ack(2)),
        Turn(frame_command(3, wire.SetRate(100.0)), ack(3) + sample(0)),
    )
    bench = bench_on(link)
    bench.open()
    readings = bench.read(0.1)
    assert (len(readings), readings.messages) == (1, ())
    link.check_finished()


def test_a_halt_is_sent_at_once_without_a_number():
    bench, link = opened(Turn(frame_command(0, wire.StopDevice())))
    bench.halt()
    link.check_finished()


def test_a_silent_stream_is_a_lost_link():
    bench, link = opened(*[Turn(HEARTBEAT)] * 20)
    with pytest.raises(errors.LinkLost, match=r"sent nothing for 1\.0 s"):
        bench.read(5.0)
    assert link.now_s < 101.5


def test_a_pulled_cable_passes_through_and_close_stays_quiet():
    link = ScriptedLink(*OPENING, Turn(HEARTBEAT), then=errors.LinkLost("gone"))
    link.write_after_end = errors.LinkLost("gone as well")
    with pytest.raises(errors.LinkLost, match=r"gone$"), bench_on(link) as bench:
        bench.read(1.0)
    link.check_finished()
    assert link.closed == 1


@pytest.mark.parametrize(
    ("frame_bytes", "baud", "first_Hz", "refused"),
    [(101, 921_600, 100.0, "1,010,000 baud"), (100, 57_600, 57.6, "1,000,000 baud")],
)
def test_a_stream_fits_the_line(frame_bytes, baud, first_Hz, refused):
    link = ScriptedLink(
        Turn(HELLO, hello_answer(1, frame_bytes=frame_bytes, baud=baud)),
        OPENING[1],
        Turn(frame_command(3, wire.SetRate(first_Hz)), ack(3)),
        baud=baud,
    )
    bench = bench_on(link)
    bench.open()
    with pytest.raises(errors.InputError, match=refused):
        bench.set_rate(1000.0)
    link.check_finished()


def test_time_of_a_fast_virtual_bench_is_device_time():
    link = ScriptedLink(Turn(HELLO, hello_answer(1, speed=20.0)), *OPENING[1:], Turn(HEARTBEAT))
    bench = bench_on(link)
    bench.open()
    start_s, wall_s = bench.now_s(), link.now_s
    assert len(bench.read(2.0)) == 0
    assert link.now_s - wall_s == pytest.approx(0.1, abs=0.02)
    assert bench.now_s() - start_s == pytest.approx(20.0 * (link.now_s - wall_s))
