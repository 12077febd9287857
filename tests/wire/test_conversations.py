"""Exact conversations between host and device: bytes out expected, bytes in prepared."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.serial.frames import (
    HEARTBEAT,
    crc16,
    frame,
    frame_command,
    frame_fields,
    payload_of,
)
from benchtool.bench.serial.hello import hello_lines
from benchtool.core.errors import (
    CommandRefused,
    DeviceStopped,
    InputError,
    LinkLost,
    NoDevice,
    PortBusy,
    ProtocolError,
    StageError,
)
from benchtool.testing.scripted_link import ScriptedLink, Turn
from tests.wire.still_plant import still_hello


def ack(number: int, *fields: str, time_us: int = 0) -> bytes:
    return frame_fields("A", (str(number), str(time_us), *fields))


def hello_answer(number: int, **changes: object) -> bytes:
    lines = hello_lines(still_hello(**changes))
    payloads = [payload_of("H", (str(index), *line)) for index, line in enumerate(lines)]
    whole = crc16(b"".join(payload + b"\n" for payload in payloads))
    return b"".join(map(frame, payloads)) + ack(number, str(len(lines)), f"{whole:04X}")


def arm(number: int, time_us: int = 0) -> Turn:
    return Turn(
        frame_command(number, wire.ArmDevice(), time_us), ack(number, still_hello().channel_hash)
    )


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


def opened(*turns: Turn, then: LinkLost | None = None) -> tuple[SerialBench, ScriptedLink]:
    link = ScriptedLink(*OPENING, *turns, then=then)
    bench = bench_on(link)
    bench.open()
    return bench, link


def test_open_read_close() -> None:
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
    assert (link.opened, link.closed) == (1, 1)
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


def test_answers_may_come_byte_by_byte() -> None:
    slow = [Turn(turn.sent, turn.answer, piece=40) for turn in OPENING]
    link = ScriptedLink(*slow)
    bench_on(link).open()
    link.check_finished()


def test_a_lost_acknowledgement_is_asked_for_with_the_same_number() -> None:
    spin = frame_command(5, wire.SetPwm((1200.0, 1100.0)))
    bench, link = opened(arm(4), Turn(spin), Turn(HEARTBEAT), Turn(spin, ack(5)))
    bench.set_pwm(np.array([1200.0, 1100.0]))
    link.check_finished()


def test_a_late_answer_to_an_earlier_number_is_passed_over() -> None:
    bench, link = opened(Turn(frame_command(4, wire.StopDevice()), ack(3) + ack(2) + ack(4)))
    bench.stop()
    link.check_finished()


def test_no_answer_at_all_is_a_lost_link() -> None:
    stop = frame_command(4, wire.StopDevice())
    bench, link = opened(*[Turn(stop), Turn(HEARTBEAT)] * 5)
    with pytest.raises(LinkLost, match="did not answer 'stop' in 5 tries"):
        bench.stop()
    link.check_finished()


def test_a_refusal_carries_the_devices_words() -> None:
    answer = frame(b"N,5,70,pulses must lie from 1000, and up to 1900 us")
    bench, link = opened(arm(4), Turn(frame_command(5, wire.SetPwm((1200.0, 2500.0))), answer))
    with pytest.raises(CommandRefused) as caught:
        bench.set_pwm(np.array([1200.0, 2500.0]))
    assert caught.value.command == "pwm,1200,2500"
    assert caught.value.reason == "pulses must lie from 1000, and up to 1900 us"
    link.check_finished()


def test_a_hello_with_a_lost_line_is_asked_again() -> None:
    whole = hello_answer(1).splitlines(keepends=True)
    link = ScriptedLink(
        Turn(HELLO, b"".join(whole[:5] + whole[6:])),
        Turn(frame_command(2, wire.RequestHello()), hello_answer(2)),
        Turn(frame_command(3, wire.Clear()), ack(3)),
        Turn(frame_command(4, wire.SetRate(100.0)), ack(4)),
    )
    bench_on(link).open()
    link.check_finished()


def test_a_board_that_boots_first_is_waited_for() -> None:
    tries = [
        turn
        for number in range(1, 9)
        for turn in (
            Turn(
                frame_command(number, wire.RequestHello()),
                b"ets Jul 29 2019\r\n" if number == 3 else b"",
            ),
            *[Turn(HEARTBEAT)] * 2,
        )
    ]
    link = ScriptedLink(
        *tries,
        Turn(frame_command(9, wire.RequestHello()), frame(b"E,boot,power on") + hello_answer(9)),
        Turn(frame_command(10, wire.Clear()), ack(10)),
        Turn(frame_command(11, wire.SetRate(100.0)), ack(11)),
    )
    bench = bench_on(link)
    bench.open()
    link.check_finished()
    assert bench.read(0.0).messages == ()


class Mute(ScriptedLink):
    """Take anything and answer with the same bytes each time."""

    def __init__(self, answer: bytes = b"") -> None:
        super().__init__()
        self.answer = answer

    def write(self, data: bytes) -> None:
        self._answer = self.answer


def test_a_port_where_nothing_answers_is_given_up_after_5_s() -> None:
    link = Mute()
    with pytest.raises(NoDevice, match="nothing answered for 5 s"):
        bench_on(link).open()
    assert 5.0 <= link.now_s - 100.0 < 5.3
    assert link.closed == 1


def test_a_port_where_something_else_answers() -> None:
    link = Mute(b"\r\nGrbl 1.1h ['$' for help]\r\n")
    with pytest.raises(ProtocolError, match="it is a G-code stage; give it as --stage grbl:"):
        bench_on(link).open()
    assert link.closed == 1


def test_another_protocol_version_is_refused() -> None:
    link = ScriptedLink(Turn(HELLO, hello_answer(1, version=7)))
    with pytest.raises(ProtocolError, match="protocol version 7, this program versions 1 and 2"):
        bench_on(link).open()
    assert link.closed == 1


def test_a_refused_hello() -> None:
    link = ScriptedLink(
        Turn(HELLO, frame(b"N,1,not today")),
        Turn(frame_command(2, wire.RequestHello(1)), frame(b"N,2,not today")),
    )
    with pytest.raises(ProtocolError, match="refused the hello: not today"):
        bench_on(link).open()


def test_a_bench_on_tcp_that_somebody_else_holds() -> None:
    link = ScriptedLink(Turn(HELLO, frame(b"E,busy,192.0.2.7:5100")))
    with pytest.raises(PortBusy, match=r"in use by 192\.0\.2\.7:5100"):
        bench_on(link).open()
    assert link.closed == 1


def test_a_port_that_cannot_be_had() -> None:
    link = ScriptedLink(refuses=PortBusy("taken"))
    with pytest.raises(PortBusy, match="taken"):
        bench_on(link).open()
    assert link.opened == 0


def test_heartbeats_go_out_while_reading() -> None:
    bench, link = opened(Turn(HEARTBEAT), Turn(HEARTBEAT, sample(0)))
    assert len(bench.read(0.5)) == 1
    link.check_finished()


def test_no_heartbeat_between_reads() -> None:
    bench, link = opened()
    link.now_s += 10.0
    assert bench.now_s() == pytest.approx(link.now_s)
    link.check_finished()


def test_losses_are_told_once() -> None:
    damaged = sample(3).replace(b"1.5", b"7.5")
    stream = sample(0) + sample(2) + damaged + sample(4)
    bench, _ = opened(Turn(HEARTBEAT, stream))
    readings = bench.read(0.3)
    assert (len(readings), readings.lost, readings.corrupt) == (3, 2, 1)
    assert bench.read(0.0).lost == 0


def test_a_stop_of_the_device_comes_before_the_samples_around_it_and_none_is_lost() -> None:
    event = frame(b"E,limit,thrust_N 31 against limit 30; motors stopped")
    bench, link = opened(Turn(HEARTBEAT, sample(0) + event + sample(1)))
    with pytest.raises(DeviceStopped, match="thrust_N 31 against limit 30"):
        bench.read(0.3)
    readings = bench.read(0.3)
    assert len(readings) == 2
    assert readings.messages == ("limit: thrust_N 31 against limit 30; motors stopped",)
    with pytest.raises(DeviceStopped):
        bench.set_pwm(np.array([1200.0, 1200.0]))
    link.check_finished()


def test_an_order_repeats_the_last_device_time() -> None:
    spin = wire.SetPwm((1200.0, 1200.0))
    bench, link = opened(
        Turn(HEARTBEAT, sample(7)),
        arm(4, 70_000),
        Turn(frame_command(5, spin, 70_000), ack(5, time_us=75_000)),
        Turn(frame_command(6, spin, 75_000), ack(6)),
    )
    assert len(bench.read(0.1)) == 1
    bench.set_pwm(np.array(spin.pwm_us))
    bench.set_pwm(np.array(spin.pwm_us))
    link.check_finished()


def test_a_host_that_has_read_nothing_lately_asks_for_the_time_first() -> None:
    bench, link = opened(
        Turn(frame_command(4, wire.RequestPlate()), ack(4, "0", "", "", "", time_us=900_000)),
        arm(5, 900_000),
        Turn(frame_command(6, wire.SetPwm((1200.0, 1200.0)), 900_000), ack(6)),
    )
    link.now_s += 0.8
    bench.set_pwm(np.array([1200.0, 1200.0]))
    link.check_finished()


def test_arming_compares_the_channel_map() -> None:
    other = ack(4, "0BAD")
    bench, link = opened(
        Turn(frame_command(4, wire.ArmDevice()), other),
        Turn(frame_command(5, wire.StopDevice()), ack(5)),
    )
    with pytest.raises(ProtocolError, match="channel map of hash 0BAD, at its hello 2E39"):
        bench.set_pwm(np.array([1200.0, 1200.0]))
    link.check_finished()


def test_after_a_stop_the_next_order_arms_anew() -> None:
    spin = wire.SetPwm((1200.0, 1200.0))
    bench, link = opened(
        *(arm(4), Turn(frame_command(5, spin), ack(5))),
        Turn(frame_command(6, wire.StopDevice()), ack(6)),
        Turn(frame_command(7, wire.SetPwm((1000.0, 1000.0))), ack(7)),
        *(arm(8), Turn(frame_command(9, spin), ack(9))),
    )
    bench.set_pwm(np.array(spin.pwm_us))
    bench.stop()
    bench.set_pwm(np.array([1000.0, 1000.0]))  # the stop pulse needs no arming
    bench.set_pwm(np.array(spin.pwm_us))
    link.check_finished()


def test_an_order_that_is_refused_since_another_thread_stopped_is_not_armed_by_itself() -> None:
    spin = frame_command(5, wire.SetPwm((1200.0, 1200.0)))
    refused = frame(b"N,5,0,not armed since the last stop; send arm first")
    bench, link = opened(
        arm(4), Turn(frame_command(0, wire.StopDevice())), Turn(spin, ack(0) + refused)
    )
    bench._arm()
    bench.halt()
    with pytest.raises(CommandRefused, match="not armed since the last stop"):
        bench.set_pwm(np.array([1200.0, 1200.0]))
    link.check_finished()


def test_clear_lifts_a_stop() -> None:
    event = frame(b"E,watchdog,no line for 260 ms; motors stopped")
    bench, link = opened(
        Turn(HEARTBEAT, event),
        Turn(frame_command(4, wire.Clear()), event + ack(4)),
        arm(5),
        Turn(frame_command(6, wire.SetPwm((1200.0, 1200.0))), ack(6)),
    )
    with pytest.raises(DeviceStopped, match="watchdog"):
        bench.read(0.1)
    bench.clear()
    bench.set_pwm(np.array([1200.0, 1200.0]))
    link.check_finished()


def test_what_stopped_the_device_before_we_came_is_not_our_stop() -> None:
    event = frame(b"E,watchdog,no line for 260 ms; motors stopped")
    link = ScriptedLink(
        Turn(HELLO, event + hello_answer(1) + event),
        Turn(frame_command(2, wire.Clear()), event + ack(2)),
        Turn(frame_command(3, wire.SetRate(100.0)), ack(3) + sample(0)),
    )
    bench = bench_on(link)
    bench.open()
    readings = bench.read(0.1)
    assert (len(readings), readings.messages) == (1, ())
    link.check_finished()


def test_a_silent_stream_is_a_lost_link() -> None:
    bench, link = opened(*[Turn(HEARTBEAT)] * 20)
    with pytest.raises(LinkLost, match=r"sent nothing for 1\.0 s"):
        bench.read(5.0)
    assert link.now_s < 101.5


def test_a_pulled_cable_passes_through_and_close_stays_quiet() -> None:
    link = ScriptedLink(*OPENING, Turn(HEARTBEAT), then=LinkLost("gone"))
    link.write_after_end = LinkLost("gone as well")
    with pytest.raises(LinkLost, match=r"gone$"), bench_on(link) as bench:
        bench.read(1.0)
    link.check_finished()
    assert link.closed == 1


def test_the_plate_arrives() -> None:
    move = frame_command(5, wire.SendPlate(0.2, 0.0, 0.1))
    bench, link = opened(
        arm(4),
        Turn(move, ack(5) + sample(0)),
        Turn(HEARTBEAT, sample(1) + frame(b"E,arrived,0.2,0,0.1")),
    )
    bench.move_plate(0.2, tilt_rad=0.1)
    assert len(bench.read(0.1)) == 2
    link.check_finished()


def test_a_plate_whose_arrival_got_lost_is_asked_for() -> None:
    bench, link = opened(
        arm(4),
        Turn(frame_command(5, wire.SendPlate(0.2)), ack(5)),
        *[Turn(HEARTBEAT)] * 5,
        Turn(frame_command(6, wire.RequestPlate()), ack(6, "0", "0.2", "0", "0")),
    )
    bench.move_plate(0.2)
    link.check_finished()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (frame(b"N,5,0,stage alarm"), "refused to move to 0.2 m: stage alarm"),
        (ack(5) + frame(b"E,stage,hard limit"), "did not reach 0.2 m: hard limit"),
    ],
)
def test_a_stage_that_fails(answer: bytes, words: str) -> None:
    bench, _ = opened(arm(4), Turn(frame_command(5, wire.SendPlate(0.2)), answer))
    with pytest.raises(StageError, match=words):
        bench.move_plate(0.2)


def test_a_rate_that_does_not_fit_is_refused_before_it_is_sent() -> None:
    link = ScriptedLink(
        Turn(HELLO, hello_answer(1, frame_bytes=101, baud=921_600)), *OPENING[1:], baud=921_600
    )
    bench = bench_on(link)
    bench.open()
    with pytest.raises(InputError, match="1,010,000 baud"):
        bench.set_rate(1000.0)
    link.check_finished()


def test_the_first_stream_fits_the_line() -> None:
    link = ScriptedLink(
        Turn(HELLO, hello_answer(1, frame_bytes=100, baud=57_600)),
        OPENING[1],
        Turn(frame_command(3, wire.SetRate(57.6)), ack(3)),
        baud=57_600,
    )
    bench_on(link).open()
    link.check_finished()


def test_time_of_a_fast_virtual_bench_is_device_time() -> None:
    link = ScriptedLink(Turn(HELLO, hello_answer(1, speed=20.0)), *OPENING[1:], Turn(HEARTBEAT))
    bench = bench_on(link)
    bench.open()
    start_s, wall_s = bench.now_s(), link.now_s
    assert len(bench.read(2.0)) == 0
    assert link.now_s - wall_s == pytest.approx(0.1, abs=0.02)
    assert bench.now_s() - start_s == pytest.approx(20.0 * (link.now_s - wall_s))


def test_another_device_on_the_same_port_is_refused() -> None:
    link = ScriptedLink(Turn(HELLO, hello_answer(1)))
    bench = SerialBench(link, "serial:scripted", clock=link.clock, device_id="bench-0041")
    with pytest.raises(NoDevice, match="answers as device 'bench-0042', but 'bench-0041'"):
        bench.open()
    assert link.closed == 1
    link.check_finished()


def test_opening_twice_is_opening_once() -> None:
    bench, link = opened()
    bench.open()
    assert link.opened == 1
