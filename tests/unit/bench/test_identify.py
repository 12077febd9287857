"""Every kind of sender, judged by every kind of listener in one sentence."""

from __future__ import annotations

import re

import numpy as np
import pytest

from benchtool.bench.identify import Kind, identify_device
from benchtool.bench.mavlink.frames import MavlinkFrames, dialect
from benchtool.bench.serial.frames import frame
from benchtool.core.errors import ProtocolError
from tests.doubles.grbl import grbl_stage
from tests.doubles.scripted_link import Talker

BEAT = MavlinkFrames(1, 1).pack(dialect().MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3))
NOISE = np.random.default_rng(5).integers(128, 250, 200).astype(np.uint8).tobytes()
HEARD: dict[Kind, bytes] = {
    "bench": frame(b"E,boot,ready"),
    "mavlink": b"\x12\x00" + BEAT + BEAT[:5],
    "grbl": b"k\r\nok\r\nerror:20\r\n<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\no",
    "text": b"HX711 reading: 124006\r\nHX711 reading: 124011\r\n",
    "frames": NOISE + b"\xfd\x80\x01",
    "noise": NOISE,
}


@pytest.mark.parametrize("kind", HEARD)
def test_what_speaks_is_known(kind):
    assert identify_device(HEARD[kind]) == kind


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("bench", "it is the bench, not a G-code stage; swap the ports"),
        ("noise", "the baud rate is wrong: GRBL uses 115200"),
    ],
)
def test_a_stage_that_is_none_is_named(kind, said):
    link = Talker(HEARD[kind])
    stage = grbl_stage(link)
    with pytest.raises(ProtocolError, match=re.escape(said)):
        stage.open()
    assert link.closed == 1
