"""Change bytes at random, and judge what a target makes of them."""

from __future__ import annotations

import re
import signal
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

from benchtool.core.errors import BenchtoolError, DataWarning
from tests.proof.fuzz.targets import Target

HOSTILE = (
    b"1" * 5000, b"-" + b"9" * 4400, b"nan", b"inf", b"-inf", b"1e400", b"1e-400", b"-0.0", b"0",
    b"-1", b"99999999999999999999", b"1.5", b"true", b"null", b'""', b"''", b"[]", b"{}",
    b"[" * 3000, b'{"a":' * 3000, b"\0", b"\xff\xfe", b"\xe2\x80\xae", b"\xed\xa0\x80", b"\r\n",
    b"\n", b",", b",,,,", b";", b"*", b"$", b"..", b"../../x", b"/dev/full", b"%00", b"%s%n",
    b"1979-05-27T07:32:00Z", b"0x7fffffff", b"2147483648", b"65536", b"18446744073709551616",
    b"1_000", b"\xc2\xb2", b"\xd9\xa3", b"::1", b"[", b"]", b"?", b"&", b"=", b'"""', b"1e308",
    b"a" * 300, b"true\n", b"# ", b"{", b"}", b"\t", b" ",
)  # fmt: skip
"""Words that have broken parsers."""

LONGEST_S = 5.0  # processor time that one input may take; assumed

MOST_BYTES = 100_000

_WORD = re.compile(rb'[\w.+-]+|"[^"\n]*"')


class TooLong(BaseException):
    """One input took longer than LONGEST_S."""


def changed(random: Random, seeds: tuple[bytes, ...]) -> bytes:
    """Return a seed with one to six changes: bits, words, pieces cut, doubled or moved in."""
    data = bytearray(random.choice(seeds))
    for _ in range(random.choice((1, 1, 1, 2, 3, 6))):
        how, at = random.random(), random.randrange(len(data) + 1)
        if how < 0.15 and at < len(data):
            data[at] ^= 1 << random.randrange(8)
        elif how < 0.3:
            data[at:at] = random.choice(HOSTILE)
        elif how < 0.4:
            del data[at : at + random.choice((1, 4, 20, 200))]
        elif how < 0.5:
            data[at:at] = data[at : at + random.randrange(1, 60)] * random.choice((1, 2, 40))
        elif how < 0.6:
            other = random.choice(seeds)
            data[at:] = other[random.randrange(len(other) + 1) :]
        elif found := _WORD.search(data, at):
            data[found.start() : found.end()] = random.choice(HOSTILE)
    return bytes(data[:MOST_BYTES])


def fault_of(target: Target, data: bytes) -> str:
    """Return what is wrong with how a target ends, "" where it reads or refuses the bytes."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # states a defect of the bytes
            target.parse(data)
    except BenchtoolError:
        return ""
    except (Exception, TooLong) as error:  # noqa: BLE001
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:100]} ({last.filename}:{last.lineno})"
    return ""


@contextmanager
def watched() -> Iterator[None]:
    """Raise TooLong in a target that computes without end; Python's warnings are errors."""

    def ring(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, ring)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)


def fuzz(
    target: Target, random: Random, *, seconds: float = 1e9, most: int = 10**9
) -> tuple[int, dict[str, bytes]]:
    """Give a target changed seeds.

    Args:
        seconds: of processor time.
        most: inputs.

    Returns:
        How many there were, and the shortest input of each fault.
    """
    until_s, count, faults = time.process_time() + seconds, 0, dict[str, bytes]()
    with watched():
        while count < most and time.process_time() < until_s:
            signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
            for _ in range(min(20, most - count)):
                data = changed(random, target.seeds)
                count += 1
                fault = fault_of(target, data)
                if fault and len(data) < len(faults.get(fault, data + b"1")):
                    faults[fault] = data
    return count, faults
