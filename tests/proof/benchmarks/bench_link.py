"""Print what the wire costs: frames per second on one core, and the share of a core at 1 kHz.

The aims: 120,000 frames of 12 channels per second; 8 % of a core at 1 kHz with no frame lost, also
while emcee runs beside it. `--seconds 60` gives the long run.
"""

from __future__ import annotations

import argparse
import os
import time
from contextlib import nullcontext

import numpy as np
from link_load import (
    Load,
    device,
    emcee_beside,
    measure,
    read_with_ours,
    read_with_readline,
)

from benchtool.bench.serial.frames import Decoder, SampleFramer, crc16

FRAMES = 50_000


def decode_by_line(data: bytes) -> int:
    """Split, check and convert line by line, as somebody would write it first."""
    count = 0
    for line in data.splitlines():
        payload, _, checksum = line[1:].rpartition(b"*")
        if crc16(payload) == int(checksum, 16):
            count += len([float(f) if f else float("nan") for f in payload[2:].split(b",")]) > 0
    return count


def frames_per_second(data: bytes, chunk: int) -> float:
    """Decode everything in chunks of that many bytes."""
    decoder, rows = Decoder(12), 0
    start_s = time.process_time()
    for at in range(0, len(data), chunk):
        rows += len(decoder.feed(data[at : at + chunk]).values)
    taken_s = time.process_time() - start_s
    assert rows == FRAMES
    return rows / taken_s


def decoding() -> None:
    """Print frames per second."""
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(900.0, 20000.0, (FRAMES, 12)), 1)
    for empty in (0.0, 0.3):
        values[rng.random(values.shape) < empty] = np.nan
        data = b"".join(SampleFramer(12).frames(1000 * np.arange(FRAMES), values))
        start_s = time.process_time()
        assert decode_by_line(data) == FRAMES
        plain = FRAMES / (time.process_time() - start_s)
        for chunk in (550, 4096, 65536):
            ours = frames_per_second(data, chunk)
            print(
                f"decode, {empty:3.0%} empty, chunks of {chunk:5d} bytes: {ours:9,.0f} frames/s; "
                f"line by line {plain:9,.0f}; ratio {ours / plain:.2f}"
            )


def show(name: str, load: Load) -> None:
    """Print one reader's load."""
    print(
        f"{name:28s} {load.rows:7d} rows in {load.wall_s:5.1f} s, {load.lost} lost, "
        f"{load.corrupt} corrupt, {load.core_share:6.2%} of a core",
        flush=True,
    )


def main() -> None:
    """Print decoding, then the readers in turns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each reader")
    seconds = parser.parse_args().seconds
    decoding()
    if os.name != "posix":
        print("no pseudo-terminals on this system: 1 kHz not measured")
        return
    for name, beside in (("alone", nullcontext), ("beside emcee", emcee_beside)):
        with device() as port, beside():
            ours = measure(read_with_ours, port, seconds)
            show(f"ours, {name}", ours)
            plain = measure(read_with_readline, port, seconds)
            show(f"readline, {name}", plain)
            print(f"ratio of processor time, {name}: {ours.core_share / plain.core_share:.3f}")


if __name__ == "__main__":
    main()
