"""Apply what the user says about a file: turn a sign, take off a zero, scale a channel."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from benchtool.core.errors import InputError
from benchtool.data.repairs.at_rest import zero_of
from benchtool.data.repairs.finding import Finding
from benchtool.data.repairs.imported import Imported
from benchtool.data.repairs.options import Options


def as_told(read: Imported, options: Options) -> Imported:
    """Return the import with what the user says about its channels done to them."""
    for name in options.flip:
        read = flipped(read, name)
    for name in options.tare:
        read = tared(read, name)
    for told in options.scale:
        read = scaled(read, told)
    return read


def flipped(read: Imported, name: str) -> Imported:
    """Return the import with one channel's sign turned."""
    words = "sign turned, as told by --flip"
    turned = read.with_values(name, -read.recording.column(name))
    return turned.with_findings([Finding("repaired", "wrong sign", words, name)])


def tared(read: Imported, name: str) -> Imported:
    """Return the import with what one channel reads at rest taken off it."""
    zero = zero_of(read.recording, name)
    if zero is None:
        raise InputError(
            f"--tare {name}: no row is at rest and too few speeds to extrapolate; map the channel "
            f"with a column map"
        )
    words = f"{zero.value:.6g} taken off, what it reads {zero.where}, as told by --tare"
    values = read.recording.column(name) - zero.value
    return read.with_values(name, values).with_findings(
        [Finding("repaired", "untared", words, name)]
    )


def scaled(read: Imported, told: str) -> Imported:
    """Return the import with one channel multiplied, told as `rpm1=1/6`."""
    name, sign, text = told.partition("=")
    try:
        factor = float(Fraction(text.strip()))
    except (ValueError, ZeroDivisionError, OverflowError):
        factor = float("nan")
    if not sign or not np.isfinite(factor) or factor == 0.0:
        raise InputError(f"--scale {told!r}: write it as CHANNEL=FACTOR, for example rpm1=1/6")
    name = name.strip()
    words = f"multiplied by {text.strip()}, as told by --scale"
    values = factor * read.recording.column(name)
    return read.with_values(name, values).with_findings([Finding("repaired", "scale", words, name)])
