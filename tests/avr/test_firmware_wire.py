"""The firmware's end of the wire: the conversation of the protocol's page, in simavr."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchtool.bench.hello import hello_from
from benchtool.bench.link import Decoder, Message, frame
from benchtool.bench.serial_port import SerialPort
from tests.avr.avr_bench import BAUD, AvrBench

PAGE = Path(__file__).parents[2] / "docs/reference/bench-protocol.md"
NO_STAGE = "this device does not move the plate"


class Wire:
    """Say lines and collect what comes back."""

    def __init__(self, port: SerialPort) -> None:
        self._port = port
        self._decoder = Decoder()
        self.heard: list[Message] = []

    def say(self, line: bytes) -> None:
        self._port.write(line)

    def listen(self, seconds: float) -> list[Message]:
        """Return what comes within so long."""
        end_s = time.monotonic() + seconds
        come: list[Message] = []
        while time.monotonic() < end_s:
            batch = self._decoder.feed(self._port.read(0.01))
            assert batch.corrupt == 0
            come += batch.messages
        self.heard += come
        return come

    def ask(self, payload: str) -> list[Message]:
        """Return what comes up to the answer to a command."""
        self.say(frame(payload.encode()))
        return self.listen_for("AN", 1)

    def listen_for(self, letters: str, count: int) -> list[Message]:
        """Return what comes until so many lines of these letters are there."""
        come: list[Message] = []
        for _ in range(100):
            come += self.listen(0.02)
            if sum(message.letter in letters for message in come) >= count:
                return come
        raise AssertionError(f"{count} lines of {letters} wanted; heard {come}")

    def answer(self, payload: str) -> Message:
        """Return the answer to a command."""
        (found,) = (message for message in self.ask(payload) if message.letter in "AN")
        return found


def wired(bench: AvrBench) -> Iterator[Wire]:
    port = SerialPort(bench.port, BAUD)
    port.open()
    wire = Wire(port)
    try:
        # A chip that has not started yet hears nothing.
        bench.wait(lambda state: state.edge_us > 0.0)
        wire.listen(0.02)
        yield wire
    finally:
        port.close()


@pytest.fixture
def wire(bench: AvrBench) -> Iterator[Wire]:
    yield from wired(bench)


@pytest.fixture
def pair_wire(pair: AvrBench) -> Iterator[Wire]:
    yield from wired(pair)


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


def without_numbers(message: Message) -> str:
    """Return letter and words; times and the milliseconds of a silence differ from run to run."""
    fields = list(message.fields)
    if message.letter == "A":
        del fields[1:]
    return re.sub(r"no line for \d+ ms", "no line for N ms", ",".join((message.letter, *fields)))


def as_messages(payloads: list[str]) -> list[Message]:
    split = [payload.split(",") for payload in payloads]
    return [Message(letter, tuple(fields)) for letter, *fields in split]


def test_the_pages_conversation(pair_wire: Wire) -> None:
    told: list[str] = []
    expected: list[str] = []
    for line, page in answers_of_the_page():
        pair_wire.say(line.encode() + b"\n")
        heard = pair_wire.listen_for("ANE", len(page))
        told += [without_numbers(message) for message in heard if message.letter in "ANE"]
        if ",plate," in line:
            # The page's device has a stage, this one has none.
            page = [f"N,{line.split(',')[1]},{NO_STAGE}", *page[1:]]
        expected += [without_numbers(message) for message in as_messages(page)]
    assert told == expected
    assert any("watchdog" in text for text in told)


def test_the_hello_is_whole_and_true(wire: Wire) -> None:
    come = wire.ask("C,1,hello,1")
    lines = [message.fields for message in come if message.letter == "H"]
    assert come[-1].fields[2] == str(len(lines))
    hello = hello_from(lines)
    assert hello.device_id == "bench-avr"
    assert [channel.name for channel in hello.channels] == [
        *("pwm1_us", "rpm1", "thrust_N", "thrust_raw", "voltage_V"),
    ]
    assert hello.limits == {"pwm_us": 1950, "thrust_N": 12, "rpm": 9800, "voltage_min_V": 9.6}
    assert (hello.pwm_stop_us, hello.pwm_idle_us, hello.watchdog_s) == (1000, 1050, 0.25)
    assert (hello.simulated, hello.moves_plate, hello.baud) == (True, False, BAUD)


def test_a_number_is_carried_out_once(wire: Wire) -> None:
    first = wire.answer("C,7,limit,rpm,5000")
    assert wire.answer("C,7,limit,rpm,4000") == first
    assert wire.answer("C,8,limit,rpm,6000").fields[1] == "wider than 5000; only narrower ones"
    # A hello starts the numbers anew.
    wire.ask("C,8,hello,1")
    assert wire.answer("C,8,limit,rpm,4000").letter == "A"


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("spin,1200", "unknown command; known: hello pwm plate where tare rate limit stop clear"),
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
def test_what_it_refuses(wire: Wire, command: str, reason: str) -> None:
    assert wire.answer(f"C,65535,{command}") == Message("N", ("65535", reason))


def test_where_and_numbers_with_exponents(wire: Wire) -> None:
    assert wire.answer("C,1,where").fields[2:] == ("0", "", "", "")
    assert wire.answer("C,2,pwm,1.2e3").letter == "A"


def test_noise_is_thrown_away(wire: Wire) -> None:
    wire.listen(0.05)
    wire.heard.clear()
    whole = frame(b"C,3,where")
    for noise in (
        b"\n\r\nGrbl 1.1h\n$*\n$$$*****\n",
        b"x" * 700 + whole,
        whole.replace(b"3", b"4"),
        b"$C,3,where*" + b"\n",
        frame(b"C,,where") + frame(b"C,0,where") + frame(b"C,70000,where") + frame(b"C"),
        frame(b"C," + b"0" * 60 + b"1,where") + frame(b"A,1,2") + frame(b""),
        bytes(range(256)) + b"\n",
    ):
        wire.say(noise)
        assert wire.listen(0.03) == []
    wire.say(b"noise" + whole.replace(b"\n", b"\r\n"))
    (answer,) = wire.listen_for("AN", 1)
    assert answer.fields[0] == "3"
