"""Untrusted files: an import of arbitrary bytes ends in a result or an error message."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchtool.core.channel import unit_from_name
from benchtool.core.errors import InputError
from benchtool.data.formats.formats import import_bytes
from benchtool.data.repairs.import_result import ImportOptions, ImportResult
from tests.unit.data.flight_logs import dataflash, hop, text_log
from tests.unit.data.stand_logs import log_text, steps_1580
from tests.unit.data.test_mavlink_log import hop as link_hop
from tests.unit.data.test_mavlink_log import tlog

STAND = log_text(steps_1580()).encode()
SEEDS = {
    "stand": STAND,
    "map-less": b"t,thrust [gf],rpm1,note\n0,1.5,100,a\n1,2.5,200,b\n2,3.5,300,c\n" * 1,
    "crazyflie": b"weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4,v[V],i[A],p[W]\n"
    + b"".join(b"%d.5,%d,3.9,%d,%d,%d,%d,3.8,0.2,0.8\n" % ((i,) * 6) for i in range(12)),
    "prop_10x7_": b"RPM    CT       CP\n2283   0.1409   0.0678\n2586   0.1424   0.0676\n",
    "dataflash": dataflash(hop(0.4)),
    "text log": text_log(hop(0.2)).encode(),
    "tlog": tlog(link_hop()[:60]),
}
CELLS = st.sampled_from(
    ["", "1", "-2.5", "1e400", "nan", "inf", "x", '"a,b"', '"', "1,5", "1;5", "\x00", " 7 ", "é"]
)


def check_import(data: bytes, name: str) -> ImportResult | None:
    """Import, or be refused in one clear line; a recording is whole and its account balances."""
    read: ImportResult | None
    try:
        read = import_bytes(
            data, name, ImportOptions(near_m=0.5) if name == "dataflash" else ImportOptions()
        )
    except InputError as error:
        message = str(error)
        read = None
    if read is None:
        assert "\n" not in message
        assert len(message) > 20
        return None
    assert read.tally.is_balanced
    assert read.tally.refused >= 0
    assert read.tally.not_needed >= 0
    assert np.isinf(read.recording.values).sum() == 0
    if read.tally.unit == "row":
        assert read.tally.kept == len(read.recording)
    for channel in read.recording.channels:
        assert channel.unit == unit_from_name(channel.name)
    for item in read.findings:
        assert item.words
    return read


@pytest.mark.parametrize("name", SEEDS)
@given(data=st.data())
@settings(max_examples=60)
def test_mutated_files(name, data):
    seed = bytearray(SEEDS[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(len(seed) - 1, 0)))
        change = data.draw(st.sampled_from(["cut", "drop", "insert", "replace", "repeat"]))
        if change == "cut":
            del seed[at:]
        elif change == "drop":
            del seed[at : at + data.draw(st.integers(1, 40))]
        elif change == "insert":
            seed[at:at] = data.draw(st.binary(min_size=1, max_size=20))
        elif change == "replace":
            new = data.draw(st.binary(min_size=1, max_size=8))
            seed[at : at + len(new)] = new
        else:
            seed[at:at] = seed[at : at + data.draw(st.integers(1, 200))]
    check_import(bytes(seed), name)


@given(
    st.lists(st.lists(CELLS, min_size=1, max_size=7), min_size=1, max_size=14),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.booleans(),
)
@settings(max_examples=150)
def test_any_cells_under_a_known_header(rows, delimiter, end, is_ended):
    header = delimiter.join(["Time (s)", "ESC signal (µs)", "Thrust (gf)", "Voltage (V)", ""])
    lines = [header, *(delimiter.join(row) for row in rows)]
    check_import((end.join(lines) + end * is_ended).encode(), "cells")
