"""What answers on a port where an autopilot was expected, judged from its first bytes. Pure."""

from __future__ import annotations

from benchtool.bench.link import Decoder

PRINTABLE_SHARE = 0.9
"""Share of letters above which bytes count as text; a choice: at a wrong baud rate half are not."""


def is_mavlink(heard: bytes) -> bool:
    """Tell whether bytes hold a whole frame of MAVLink."""
    from benchtool.bench.mavlink_frames import MavlinkFrames

    return bool(MavlinkFrames().parse(heard))


def what_it_is(heard: bytes) -> str:
    """Return the end of a sentence that begins with the address."""
    shown = repr(bytes(heard[:40]))
    if any(message.letter for message in Decoder().feed(heard + b"\n").messages):
        return "speaks the bench protocol, not MAVLink; use a serial: or tcp: address for it"
    if b"Grbl" in heard or heard.lstrip().startswith((b"<Idle", b"<Alarm")):
        return "is a G-code stage, not an autopilot; give it as --stage grbl:PORT"
    letters = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in heard)
    if letters >= PRINTABLE_SHARE * len(heard):
        return (
            f"sends text ({shown}), not MAVLink; it is another device, or the autopilot's console "
            f"port: choose its telemetry port"
        )
    if 0xFD in heard or 0xFE in heard:
        return (
            f"sends bytes of which none makes a whole MAVLink frame ({shown}); the baud rate is "
            f"wrong, or another program reads from the same port"
        )
    return (
        f"sends bytes that are not MAVLink ({shown}); the baud rate is wrong: try 57600 or 115200"
    )
