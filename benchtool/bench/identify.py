"""Identification of an unexpected device from its first bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from benchtool.bench.serial.commands import RequestHello
from benchtool.bench.serial.frames import frame_command, split_messages
from benchtool.bench.stage.grbl_lines import UnknownLine, parse_line
from benchtool.bench.transport.transport import Transport

Kind = Literal["bench", "mavlink", "grbl", "text", "frames", "noise"]

PROBE = frame_command(1, RequestHello()) + b"?"  # hello of a bench, status query of a G-code stage
PROBE_S = 0.5  # reply timeout of the probe; both devices reply within milliseconds; assumed
PRINTABLE_SHARE = 0.9  # least share of printable bytes in text; half at a wrong baud rate; assumed


def identify_device(received: bytes) -> Kind:
    """Return the kind of device that sent these bytes.

    `frames` resembles MAVLink without one complete frame, `noise` is typical of a wrong baud rate.
    """
    from benchtool.bench.mavlink.frames import MavlinkFrames

    if any(message.letter for message in split_messages(received + b"\n")):
        return "bench"
    if MavlinkFrames().parse(received):
        return "mavlink"
    if _is_grbl(received):
        return "grbl"
    n_printable = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in received)
    if n_printable >= PRINTABLE_SHARE * len(received):
        return "text"
    return "frames" if 0xFD in received or 0xFE in received else "noise"


def probe_answer(transport: Transport, clock: Callable[[], float]) -> bytes:
    """Send the probe, which turns no motor, and return the received bytes, perhaps none."""
    transport.write(PROBE)
    received, deadline_s = b"", clock() + PROBE_S
    while (left_s := deadline_s - clock()) > 0.0:
        received += transport.read(left_s)
    return received


Expected = Literal["mavlink", "bench", "stage"]

MISMATCH_MESSAGES: dict[Expected, dict[Kind | Literal["else"], str]] = {
    "mavlink": {
        "bench": "speaks the bench protocol, not MAVLink; use a serial: or tcp: address",
        "grbl": "is a G-code stage, not an autopilot; use --stage grbl:PORT",
        "text": "sends text ({received}), not MAVLink; it is another device, or the autopilot's "
        "console port: choose its telemetry port",
        "noise": "sends bytes that are not MAVLink ({received}); the baud rate is wrong: try 57600 "
        "or 115200",
        "else": "sends bytes without one complete MAVLink frame ({received}); the baud rate is "
        "wrong, or another program reads from the same port",
    },
    "bench": {
        "bench": "speaks the bench protocol, but its hello is not readable; the line loses bytes, "
        "or the firmware is incomplete: check the cable, then the firmware",
        "mavlink": "speaks MAVLink: it is a flight controller; use mavlink:{link}",
        "grbl": "is no bench: it is a G-code stage; use --stage grbl:{port}",
        "text": "sends text ({received}), which is not the bench protocol; it is another device, "
        "or a board with another program: `benchtool firmware` writes one for an Arduino",
        "else": "sends bytes that are no text ({received}), but the bench protocol is text; the "
        "baud rate is wrong: set the device's rate with ?baud= (benchtool's firmware: 500000)",
    },
    "stage": {
        "bench": "speaks the bench protocol: it is the bench, not a G-code stage; swap the ports",
        "mavlink": "speaks MAVLink: it is a flight controller, not a G-code stage; swap the ports",
        "noise": "sends bytes that are no text ({received}); the baud rate is wrong: GRBL uses "
        "115200 unless ?baud= is set",
        "frames": "sends bytes that are no text ({received}); the baud rate is wrong: GRBL uses "
        "115200 unless ?baud= is set",
        "else": "sent no GRBL name after a reset, but sends text ({received}); it is another "
        "device, or no GRBL 1.1",
    },
}  # predicate of a sentence that starts with the address, by expected and by identified device


def mismatch_message(expected: Expected, received: bytes, address: str = "") -> str:
    """Return the predicate of a sentence that starts with the address of the expected device."""
    messages = MISMATCH_MESSAGES[expected]
    first_bytes = bytes(received[:40])
    link = address.partition("?")[0]
    return messages.get(identify_device(received), messages["else"]).format(
        received=repr(first_bytes if first_bytes.isascii() else first_bytes[:12]),
        link=link,
        port=link.partition(":")[2],
    )


def _is_grbl(received: bytes) -> bool:
    if b"Grbl" in received:
        return True
    lines = [line for line in received.decode("latin-1").splitlines() if line.strip()]
    # The first and the last line may be incomplete.
    lines = lines[1:-1] if len(lines) > 2 else lines
    return bool(lines) and not any(isinstance(parse_line(line), UnknownLine) for line in lines)
