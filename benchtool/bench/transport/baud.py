"""The arithmetic of a serial line: how many samples per second fit a baud rate."""

from __future__ import annotations

from benchtool.core.errors import InputError

BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit (8N1)."""


def highest_rate_Hz(frame_bytes: int, baud: int) -> float:
    """Return the fastest stream of frames of that length, in frames per second."""
    return baud / (BITS_PER_BYTE * frame_bytes)


def check_rate(rate_Hz: float, frame_bytes: int, baud: int) -> None:
    """Refuse a stream that does not fit the line; a baud of 0 has no limit.

    Raises:
        InputError: with the arithmetic.
    """
    if rate_Hz < 0.0 or rate_Hz != rate_Hz:
        raise InputError(f"a stream rate of {rate_Hz:g} Hz makes no sense; give 0 or more")
    needed = rate_Hz * frame_bytes * BITS_PER_BYTE
    if baud and needed > baud:
        raise InputError(
            f"{rate_Hz:g} frames/s x {frame_bytes} bytes x {BITS_PER_BYTE} bits = {needed:,.0f} "
            f"baud, but the link runs at {baud:,} baud; ask for at most "
            f"{int(highest_rate_Hz(frame_bytes, baud))} Hz or raise baud on both ends"
        )
