"""A hello: its text, the range of every field, and lines that get lost, doubled or exchanged."""

from __future__ import annotations

import pytest

from benchtool.bench.serial.frames import build_payload, crc16
from benchtool.bench.serial.hello import (
    MAX_HELLO_LINES,
    Hello,
    HelloReader,
    hello_lines,
    parse_hello,
)
from benchtool.core.errors import ProtocolError
from tests.wire.still_plant import still_hello

LINES = hello_lines(still_hello())


def test_a_hello_survives_its_text():
    hello = still_hello(speed=20.0, simulated=True, baud=115200, watchdog_s=0.1)
    lines = hello_lines(hello)
    assert parse_hello(lines) == hello
    assert parse_hello([*lines, ("novelty", "1", "2")]) == hello


def changed(key: str, *values: str) -> list[tuple[str, ...]]:
    """Return the lines with one changed, or added where there is none of that key."""
    others = [line for line in LINES if line[0] != key]
    return [*others, (key, *values)]


BAD_NUMBERS = ("nan", "inf", "-inf", "-1", "1e400", "9" * 400, "", "ten", "0x10")


@pytest.mark.parametrize("text", BAD_NUMBERS)
@pytest.mark.parametrize(
    "key", ["speed", "watchdog", "rate", "rotors", "frame", "baud", "plate", "simulated"]
)
def test_every_number_has_a_range(key, text):
    with pytest.raises(ProtocolError, match=rf"hello is invalid: {key} is .*, not a number"):
        parse_hello(changed(key, text))


@pytest.mark.parametrize(
    ("key", "values", "words"),
    [
        ("speed", ["0"], "speed is '0', not a number from 0.001 to 1000"),
        ("limit", ["rpm", "0"], "limit rpm is '0', not a number from 1e-09"),
        ("watchdog", ["0"], "watchdog is '0', not a number from 100 to 10000"),
        ("rotors", ["2.5"], "rotors is '2.5', not a whole number"),
        ("pwm", ["1100", "1050"], "idle pulse is '1050', not a number from 1100"),
        ("protocol", ["3"], "protocol version 3, this program version 2"),
        ("device", [""], "device is '', not a text of 1 to 100 characters"),
        ("firmware", ["x" * 101], "not a text of 1 to 100 characters"),
        ("device", ["bench\x1b[2J"], "has non-printable characters"),
        ("channel", ["way", "furlong", "1"], "unknown unit 'furlong'"),
        ("channel", ["way"], "too few fields"),
    ],
)
def test_what_else_makes_no_sense(key, values, words):
    with pytest.raises(ProtocolError, match=words.replace("[", r"\[")):
        parse_hello(changed(key, *values))


INDEXED = [(str(index), *line) for index, line in enumerate(LINES)]
WHOLE = crc16(b"".join(build_payload("H", line) + b"\n" for line in INDEXED))
ANSWER = (str(len(LINES)), f"{WHOLE:04X}")


def read(
    lines: list[tuple[str, ...]], answer: tuple[str, ...], reader: HelloReader
) -> Hello | None:
    for line in lines:
        reader.take(line)
    return reader.hello(answer)


def test_a_line_that_got_lost_may_come_with_the_next_try():
    reader = HelloReader()
    assert read(INDEXED[:7] + INDEXED[8:], ANSWER, reader) is None
    assert read(INDEXED[7:9], ANSWER, reader) == still_hello()


def test_a_wrong_sum_over_all_lines_starts_over():
    reader = HelloReader()
    damaged = [*INDEXED[:3], ("3", "rotors", "7"), *INDEXED[4:]]
    assert read(damaged, ANSWER, reader) is None
    assert read(INDEXED[:3], ANSWER, reader) is None
    assert read(INDEXED[3:], ANSWER, reader) == still_hello()


def test_a_hello_without_end_is_not_stored():
    reader = HelloReader()
    for index in range(10_000):
        reader.take((str(index), "fact", "a", "b"))
    assert len(reader._indexed) == MAX_HELLO_LINES
