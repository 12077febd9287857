"""The wire: frames decoded per second, and the share of a core that a reader takes at 1 kHz."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np

from benchtool.bench.serial.frames import Decoder, SampleFramer, crc16
from tests.proof.benchmarks.link_load import (
    device,
    emcee_beside,
    measure,
    read_bare,
    read_with_ours,
    read_with_readline,
)
from tests.proof.benchmarks.rows import Row


def decode_by_line(data: bytes) -> int:
    """Split, check and convert line by line, as somebody would write it first."""
    count = 0
    for line in data.splitlines():
        payload, _, checksum = line[1:].rpartition(b"*")
        if crc16(payload) == int(checksum, 16):
            count += len([float(f) if f else float("nan") for f in payload[2:].split(b",")]) > 0
    return count


def frames_per_second(data: bytes, count: int, chunk: int) -> float:
    """Decode everything in chunks of that many bytes."""
    decoder, rows = Decoder(12), 0
    start_s = time.process_time()
    for at in range(0, len(data), chunk):
        rows += len(decoder.feed(data[at : at + chunk]).values)
    taken_s = time.process_time() - start_s
    assert rows == count
    return rows / taken_s


def decoder_rows(count: int) -> Iterator[Row]:
    """Yield the decoder for small and large chunks, without and with empty fields."""
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(900.0, 20000.0, (count, 12)), 1)
    for empty in (0.0, 0.3):
        values[rng.random(values.shape) < empty] = np.nan
        data = b"".join(SampleFramer(12).frames(1000 * np.arange(count), values))
        start_s = time.process_time()
        assert decode_by_line(data) == count
        plain = count / (time.process_time() - start_s)
        for chunk in (550, 4096, 65536):
            ours = frames_per_second(data, count, chunk)
            work = f"decoder, chunks of {chunk} bytes, {empty:.0%} of fields empty"
            wanted = 0.6 if chunk == 550 else None
            yield Row(work, ours, "frames/s", plain, "splitting lines", wanted, of_peer=True)


def rows(quick: bool) -> Iterator[Row]:
    """Yield decoding, then readers of a device in turns, alone and beside emcee."""
    yield from decoder_rows(1000 if quick else 50_000)
    if os.name != "posix":
        return  # there are no pseudo-terminals
    seconds = 0.5 if quick else 5.0
    for where, beside, peer_name, peer, wanted in (
        ("alone", nullcontext, "bare pyserial", read_bare, 2.5),
        ("beside emcee", emcee_beside, "readline", read_with_readline, None),
    ):
        with device() as port, beside():
            ours = measure(read_with_ours, port, seconds)
            plain = measure(peer, port, seconds)
        assert quick or (ours.lost, ours.corrupt) == (0, 0), ours
        share, peer_share = 100.0 * ours.core_share, 100.0 * plain.core_share
        work = f"reader, 1 kHz x 12 channels, {where}"
        yield Row(work, share, "% of a core", peer_share, peer_name, wanted)
