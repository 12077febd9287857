"""Boards that the firmware in `sketch/` was laid out for."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.core.errors import UnknownChoice


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """Say what compiling for a board and writing to it takes.

    Attributes:
        mcu: as avr-gcc and avrdude name it.
        clock_Hz: of its crystal.
        upload_baud: of its bootloader.
    """

    name: str
    title: str
    mcu: str
    clock_Hz: int
    upload_baud: int


BOARDS = (
    Board(
        name="uno",
        title="Arduino Uno R3",
        mcu="atmega328p",
        clock_Hz=16_000_000,
        upload_baud=115_200,
    ),
    Board(
        name="nano",
        title="Arduino Nano, bootloader of 2018 or later",
        mcu="atmega328p",
        clock_Hz=16_000_000,
        upload_baud=115_200,
    ),
)
"""Same chip, same clock, same pins; upload rates as in the Arduino core's boards.txt."""


def board_named(name: str) -> Board:
    """Return a board by its name."""
    for board in BOARDS:
        if board.name == name:
            return board
    raise UnknownChoice("board", name, (board.name for board in BOARDS))
