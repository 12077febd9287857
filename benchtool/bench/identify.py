"""What answers where another device was expected, judged from its first bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from benchtool.bench.serial.commands import RequestHello
from benchtool.bench.serial.frames import frame_command, split_messages
from benchtool.bench.stage.grbl_lines import Other, parse_line
from benchtool.bench.transport.transport import Transport

Kind = Literal["bench", "mavlink", "grbl", "text", "frames", "noise"]

PROBE = frame_command(1, RequestHello()) + b"?"
"""What makes those speak that are quiet until asked, and turns no motor: a bench answers the
hello, a G-code stage the question for its state."""

PROBE_S = 0.5  # how long an answer to it is waited for; both answer within milliseconds; assumed
PRINTABLE_SHARE = 0.9  # from here on bytes are text; half at a wrong baud rate; assumed


def identify_device(received: bytes) -> Kind:
    """Return what the sender of some bytes is.

    `frames` looks like MAVLink without one whole frame in it, `noise` is what a wrong baud rate
    gives.
    """
    from benchtool.bench.mavlink.frames import MavlinkFrames

    if any(message.letter for message in split_messages(received + b"\n")):
        return "bench"
    if MavlinkFrames().parse(received):
        return "mavlink"
    if _is_grbl(received):
        return "grbl"
    letters = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in received)
    if letters >= PRINTABLE_SHARE * len(received):
        return "text"
    return "frames" if 0xFD in received or 0xFE in received else "noise"


def probe_answer(transport: Transport, clock: Callable[[], float]) -> bytes:
    """Send the probe on an open transport and return what answers, perhaps nothing."""
    transport.write(PROBE)
    received, until_s = b"", clock() + PROBE_S
    while (left_s := until_s - clock()) > 0.0:
        received += transport.read(left_s)
    return received


Expected = Literal["mavlink", "bench", "stage"]

MISMATCH_MESSAGES: dict[Expected, dict[Kind | Literal["else"], str]] = {
    "mavlink": {
        "bench": "speaks the bench protocol, not MAVLink; use a serial: or tcp: address for it",
        "grbl": "is a G-code stage, not an autopilot; give it as --stage grbl:PORT",
        "text": "sends text ({shown}), not MAVLink; it is another device, or the autopilot's "
        "console port: choose its telemetry port",
        "noise": "sends bytes that are not MAVLink ({shown}); the baud rate is wrong: try 57600 or "
        "115200",
        "else": "sends bytes of which none makes a whole MAVLink frame ({shown}); the baud rate "
        "is wrong, or another program reads from the same port",
    },
    "bench": {
        "bench": "speaks the bench protocol, but gave no hello that can be read; the line loses "
        "bytes, or its firmware is not whole: look at the cable, then at the firmware",
        "mavlink": "speaks MAVLink: it is a flight controller; use mavlink:{place} for it",
        "grbl": "is no bench: it is a G-code stage; give it as --stage grbl:{port}",
        "text": "sends text ({shown}), which is not the bench protocol; it is another device, or "
        "a board with another program: `benchtool firmware` writes one for an Arduino",
        "else": "sends bytes that are no text ({shown}), and benches speak text; the baud rate is "
        "wrong: write the device's own as ?baud= (benchtool's firmware has 500000)",
    },
    "stage": {
        "bench": "speaks the bench protocol: it is the bench, not a G-code stage; swap the ports",
        "mavlink": "speaks MAVLink: it is a flight controller, not a G-code stage; swap the ports",
        "noise": "sends bytes that are no text ({shown}); the baud rate is wrong: GRBL has 115200 "
        "unless ?baud= says otherwise",
        "frames": "sends bytes that are no text ({shown}); the baud rate is wrong: GRBL has 115200 "
        "unless ?baud= says otherwise",
        "else": "did not say its name after a reset, but sends text ({shown}); it is another "
        "device, or no GRBL 1.1",
    },
}
"""What a sentence that begins with an address ends in, by what was expected and what answers."""


def mismatch_message(expected: Expected, received: bytes, address: str = "") -> str:
    """Return the end of a sentence that begins with the address of what was expected."""
    known = MISMATCH_MESSAGES[expected]
    start = bytes(received[:40])
    place = address.partition("?")[0]
    return known.get(identify_device(received), known["else"]).format(
        shown=repr(start if start.isascii() else start[:12]),
        place=place,
        port=place.partition(":")[2],
    )


def _is_grbl(received: bytes) -> bool:
    if b"Grbl" in received:
        return True
    lines = [line for line in received.decode("latin-1").splitlines() if line.strip()]
    # The first and the last may be cut.
    whole = lines[1:-1] if len(lines) > 2 else lines
    return bool(whole) and not any(isinstance(parse_line(line), Other) for line in whole)
