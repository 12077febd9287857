"""The firmware's end of the wire: the conversation of the protocol's page, in simavr."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchtool.bench.serial.frames import Decoder, TextMessage, frame
from benchtool.bench.serial.hello import HelloReader
from tests.avr.avr_bench import BAUD, AvrBench

PAGE = Path(__file__).parents[2] / "docs/reference/bench-protocol.md"
UNKNOWN = "unknown command; known:"
NO_STAGE = "this device does not move the plate"


class Wire:
    """Say lines and collect what comes back.

    Attributes:
        time: the device time of the last answer, as it came.
    """

    def __init__(self, bench: AvrBench) -> None:
        self._bench = bench
        self._decoder = Decoder()
        self.heard: list[TextMessage] = []
        self.time = "0"
        bench.open()
        self.listen(0.02)

    def say(self, line: bytes) -> None:
        self._bench.write(line)

    def listen(self, seconds: float) -> list[TextMessage]:
        """Return what comes within so long."""
        end_s = self._bench.clock() + seconds
        come: list[TextMessage] = []
        while self._bench.clock() < end_s:
            batch = self._decoder.feed(self._bench.read(0.01))
            assert batch.corrupt == 0
            come += self._decoder.take_messages()
        self.heard += come
        return come

    def ask(self, payload: str) -> list[TextMessage]:
        """Return what comes up to the answer to a command."""
        self.say(frame(payload.encode()))
        return self.listen_for("AN", 1)

    def listen_for(self, letters: str, count: int) -> list[TextMessage]:
        """Return what comes until so many lines of these letters are there."""
        come: list[TextMessage] = []
        for _ in range(100):
            come += self.listen(0.02)
            if sum(message.letter in letters for message in come) >= count:
                return come
        raise AssertionError(f"{count} lines of {letters} wanted; heard {come}")

    def answer(self, payload: str) -> TextMessage:
        """Return the answer to a command, without its device time."""
        (found,) = (message for message in self.ask(payload) if message.letter in "AN")
        number, self.time, *fields = found.fields
        return TextMessage(found.letter, (number, *fields))

    def order(self, number: int, command: str, time: str | None = None) -> TextMessage:
        """Return the answer to an order that repeats the present device time."""
        self.answer("C,1,where,0")
        name, comma, values = command.partition(",")
        return self.answer(f"C,{number},{name},{time or self.time}{comma}{values}")


@pytest.fixture
def wire(bench):
    return Wire(bench)


@pytest.fixture
def pair_wire(pair):
    return Wire(pair)


def answers_of_the_page() -> list[tuple[str, list[str]]]:
    """List what the page's host says to which the device answers, and the answers after it."""
    (block,) = re.findall(r"^```text\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    said: list[tuple[str, list[str]]] = []
    for line in block.splitlines():
        if line.startswith("> "):
            said.append((line[2:], []))
        elif re.match(r"< \$[ANE],", line) and not line.startswith("< $E,arrived"):
            said[-1][1].append(line[3:-5])
    return said


def without_numbers(message: TextMessage) -> str:
    """Return letter and words; times and the milliseconds of a silence differ from run to run.

    The hash of the channels and the sum over the hello are those of other channels.
    """
    fields = list(message.fields)
    if message.letter in "AN":
        del fields[1]
    if message.letter == "A":
        del fields[1:]
    return re.sub(r"no line for \d+ ms", "no line for N ms", ",".join((message.letter, *fields)))


def test_the_pages_conversation(pair_wire):
    told: list[str] = []
    expected: list[str] = []
    times: dict[str, str] = {}  # of this device, by those of the page
    for line, page in answers_of_the_page():
        letter, *fields = line[1:-5].split(",")
        name = fields[1] if letter == "C" else ""
        if name not in ("", "hello"):
            fields[2] = times.get(fields[2]) or max(times.values(), key=int)
        pair_wire.say(frame(",".join((letter, *fields)).encode()))
        heard = pair_wire.listen_for("ANE", len(page)) if page else []
        heard = [message for message in heard if message.letter in "ANE"]
        told += [without_numbers(message) for message in heard]
        if name == "plate":
            # The page's device has a stage, this one has none.
            page = [f"N,{fields[0]},{page[0].split(',')[2]},{NO_STAGE}", *page[1:]]
        said = [TextMessage(text[0], tuple(text.split(",")[1:])) for text in page]
        expected += [without_numbers(message) for message in said]
        if said:
            times[said[0].fields[1]] = heard[0].fields[1]
    assert told == expected
    assert any("watchdog" in text for text in told)
    assert any("late" in text for text in told)


def test_the_hello_is_whole_and_true(wire):
    come = wire.ask("C,1,hello,2")
    reader = HelloReader()
    for message in come[:-1]:
        assert message.letter == "H"
        reader.take(message.fields)
    hello = reader.hello(come[-1].fields[2:])
    assert hello is not None
    assert hello.device_id == "bench-avr"
    assert [channel.name for channel in hello.channels] == [
        *("pwm1_us", "rpm1", "thrust_N", "thrust_raw", "voltage_V"),
    ]
    assert hello.limits == {"pwm_us": 1950, "thrust_N": 12, "rpm": 9800, "voltage_min_V": 9.6}
    assert (hello.pwm_stop_us, hello.pwm_idle_us, hello.watchdog_s) == (1000, 1050, 0.25)
    assert (hello.simulated, hello.moves_plate, hello.baud) == (True, False, BAUD)
    assert wire.order(2, "arm") == TextMessage("A", ("2", hello.channel_hash))


def test_a_host_of_an_older_version_is_refused(wire):
    answer = wire.answer("C,1,hello,1")
    assert answer == TextMessage(
        "N", ("1", "this device speaks protocol version 2; update benchtool")
    )


def test_a_number_is_carried_out_once(wire):
    first = wire.order(7, "limit,rpm,5000")
    assert wire.answer("C,7,limit,0,rpm,4000") == first
    assert wire.order(8, "limit,rpm,6000").fields[1] == "wider than 5000; only narrower ones"
    # A hello starts the numbers anew.
    wire.ask("C,8,hello,2")
    assert wire.order(8, "limit,rpm,4000").fields[1] == "late: number 8 comes after 8"
    assert wire.order(9, "limit,rpm,4000").letter == "A"


def test_late_orders_are_refused(wire, bench):
    wire.ask("C,1,hello,2")
    disarmed = "not armed since the last stop; send arm first"
    assert wire.order(2, "pwm,1200") == TextMessage("N", ("2", disarmed))
    assert wire.order(3, "arm").letter == "A"
    before = wire.time
    assert wire.answer("C,0,stop,0").letter == "A"
    assert wire.answer(f"C,4,arm,{before}").fields[1] == "late: given before the last stop"
    assert wire.order(5, "arm").letter == "A"
    assert wire.order(4, "pwm,1200").fields[1] == "late: number 4 comes after 5"
    slept_us = bench.state.time_us
    bench.wait(lambda state: state.time_us > slept_us + 0.6e6)
    reason = wire.answer(f"C,6,pwm,{wire.time},1200").fields[1]
    assert re.fullmatch(r"late: [56789]\d\d ms old; limit 500 ms", reason)
    # A time to come, and none.
    for bad, words in (("4294967295", "late: "), ("soon", "no device time; "), ("", "no device")):
        assert wire.answer(f"C,6,pwm,{bad},1200").fields[1].startswith(words)
    assert bench.state.pulses_us[0] == pytest.approx(1000.0, abs=0.5)
    assert wire.order(6, "pwm,1200").letter == "A"
    bench.wait(lambda state: state.pulses_us[0] == pytest.approx(1200.0, abs=0.5))
    assert wire.answer("C,3,stop").letter == "A"  # whatever its number, and without a time
    bench.wait(lambda state: state.pulses_us[0] == pytest.approx(1000.0, abs=0.5))


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("spin,1200", f"{UNKNOWN} hello pwm plate where tare rate limit stop clear arm"),
        ("pwm", "1 fields needed; 0 given"),
        ("pwm,1200,1200", "1 fields needed; 2 given"),
        ("pwm,1,2,3,4,5,6", "too many fields"),
        ("pwm,fast", "a field is no number from -1e6 to 1e6"),
        ("pwm,nan", "a field is no number from -1e6 to 1e6"),
        ("pwm,1e39", "a field is no number from -1e6 to 1e6"),
        ("pwm,999", "pulses must lie from 1000 to 1950 us"),
        ("pwm,1951", "pulses must lie from 1000 to 1950 us"),
        ("rate,1000", "rate must be 0 or lie from 0.1 to 200 Hz"),
        ("rate,-1", "rate must be 0 or lie from 0.1 to 200 Hz"),
        ("limit,rpm", "limit takes a name and a number"),
        ("limit,lift_N,3", "no such limit; known: pwm_us thrust_N rpm voltage_min_V"),
        ("limit,voltage_min_V,9", "wider than 9.6; only narrower ones"),
        ("plate,0.1,0,0", NO_STAGE),
    ],
)
def test_what_it_refuses(wire, command, reason):
    assert wire.order(4294967295, command) == TextMessage("N", ("4294967295", reason))


def test_where_and_numbers_with_exponents(wire):
    assert wire.answer("C,1,where").fields[1:] == ("0", "", "", "")
    wire.order(2, "arm")
    assert wire.order(3, "pwm,1.2e3").letter == "A"


def test_noise_is_thrown_away(wire):
    wire.listen(0.05)
    wire.heard.clear()
    whole = frame(b"C,3,where")
    for noise in (
        b"\n\r\nGrbl 1.1h\n$*\n$$$*****\n",
        b"x" * 700 + whole,
        whole.replace(b"3", b"4"),
        b"$C,3,where*" + b"\n",
        frame(b"C,,where") + frame(b"C,-1,where") + frame(b"C,4294967296,where") + frame(b"C"),
        frame(b"C," + b"0" * 60 + b"1,where") + frame(b"A,1,2") + frame(b""),
        bytes(range(256)) + b"\n",
    ):
        wire.say(noise)
        assert wire.listen(0.03) == []
    wire.say(b"noise" + whole.replace(b"\n", b"\r\n"))
    (answer,) = wire.listen_for("AN", 1)
    assert answer.fields[0] == "3"
