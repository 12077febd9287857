"""Our MAVLink against node-mavlink, an implementation with nothing in common with pymavlink.

Runs where node finds the package: `npm install node-mavlink` in the project's folder, or NODE_PATH.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchtool.bench.mavlink.frames import LinkCounts, MavlinkFrames, dialect

ROOT = Path(__file__).parents[2]
NODE = shutil.which("node")
KEY = bytes(range(32))
W = dialect()


def node_path() -> str:
    return os.pathsep.join(filter(None, [os.environ.get("NODE_PATH"), str(ROOT / "node_modules")]))


def has_peer() -> bool:
    if NODE is None:
        return False
    ended = subprocess.run(
        [NODE, "-e", "require('node-mavlink')"],
        capture_output=True,
        env={**os.environ, "NODE_PATH": node_path()},
        timeout=30,
    )
    return ended.returncode == 0


pytestmark = pytest.mark.skipif(
    not has_peer(), reason="node-mavlink is not installed (npm install node-mavlink)"
)


def ask_peer(frames: bytes, messages: list[dict[str, Any]], key: bytes | None) -> dict[str, Any]:
    """Let node-mavlink read frames and write messages."""
    assert NODE is not None
    given = {"frames": frames.hex(), "messages": messages, "key": key.hex() if key else None}
    ended = subprocess.run(
        [NODE, str(Path(__file__).with_name("mavlink_peer.js"))],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        env={**os.environ, "NODE_PATH": node_path()},
        timeout=30,
    )
    assert ended.returncode == 0, ended.stderr
    told: dict[str, Any] = json.loads(ended.stdout)
    return told


SENT = (
    W.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    W.MAVLink_command_long_message(1, 1, 209, 0, 2.0, 1.0, 1150.0, 0.25, 1.0, 0.0, 0.0),
    W.MAVLink_command_long_message(1, 1, 511, 0, 36.0, 20000.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    W.MAVLink_param_request_read_message(1, 1, b"MOT_PWM_MIN", -1),
    W.MAVLink_servo_output_raw_message(4_000_000_000, 0, *range(1000, 1008), *range(1008, 1016)),
    W.MAVLink_named_value_float_message(7, b"thrust", 1.5),
    W.MAVLink_esc_telemetry_1_to_4_message(
        [30, 31, 32, 33], [1200] * 4, [250] * 4, [1] * 4, [3000, 3001, 3002, 3003], [1, 2, 3, 4]
    ),
    W.MAVLink_attitude_message(123, 0.1, -0.2, 0.3, 1.0, -2.0, 3.0),
    W.MAVLink_battery_status_message(0, 0, 0, 32767, [4100] * 3 + [65535] * 7, 250, -1, -1, -1),
    W.MAVLink_distance_sensor_message(5, 2, 400, 34, 0, 0, 25, 0),
)


@pytest.mark.parametrize("key", [None, KEY], ids=["plain", "signed"])
def test_the_peer_reads_what_we_send(key):
    ours = MavlinkFrames(key=key, now_s=1.7e9)
    heard = ask_peer(b"".join(map(ours.pack, SENT)), [], key)["heard"]
    assert [one["name"] for one in heard] == [message.msgname for message in SENT]
    assert [one["sequence"] for one in heard] == list(range(len(SENT)))
    assert {one["system"] for one in heard} == {255}
    assert {one["signed"] for one in heard} == {True if key else None}
    for message, one in zip(SENT, heard, strict=True):
        for name, value in one["fields"].items():
            # A command's parameters are called _param1 there; extensions may be left out here.
            own = getattr(message, name.lstrip("_"), None)
            if isinstance(own, bytes):
                own = own.rstrip(b"\0").decode()
            if isinstance(own, tuple):
                own = list(own)
            if own is not None:
                assert value == (pytest.approx(own) if isinstance(own, float) else own), name


RECEIVED: list[dict[str, Any]] = [
    {"name": "HEARTBEAT", "fields": {"type": 2, "autopilot": 3, "base_mode": 81}},
    {"name": "COMMAND_ACK", "fields": {"command": 209, "result": 0}},
    {
        "name": "SERVO_OUTPUT_RAW",
        "fields": {"time_usec": 5000, "port": 0, "servo1_raw": 1200, "servo16_raw": 1600},
    },
    {"name": "NAMED_VALUE_FLOAT", "fields": {"time_boot_ms": 9, "name": "thrust", "value": 2.5}},
    {"name": "STATUSTEXT", "fields": {"severity": 2, "text": "Battery failsafe"}},
    {
        "name": "ESC_TELEMETRY_1_TO_4",
        "fields": {"rpm": [1, 2, 3, 65535], "count": [1, 2, 3, 4], "temperature": [1, 2, 3, 4]},
    },
    {"name": "RPM", "fields": {"rpm1": 3100.5, "rpm2": -1.0}},
]


@pytest.mark.parametrize("key", [None, KEY], ids=["plain", "signed"])
def test_we_read_what_the_peer_sends(key):
    frames = ask_peer(b"", RECEIVED, key)["frames"]
    ours = MavlinkFrames(key=key)
    heard = [message for frame in frames for message in ours.parse(bytes.fromhex(frame))]
    assert [message.msgname for message in heard] == [one["name"] for one in RECEIVED]
    assert {message.get_srcSystem() for message in heard} == {42}
    assert ours.take_counts(42) == LinkCounts(messages=len(RECEIVED))
    for message, one in zip(heard, RECEIVED, strict=True):
        for name, value in one["fields"].items():
            assert getattr(message, name) == value


def test_a_signature_of_another_key_is_refused():
    frames = ask_peer(b"", RECEIVED, bytes(32))["frames"]
    ours = MavlinkFrames(key=KEY)
    assert [ours.parse(bytes.fromhex(frame)) for frame in frames] == [[]] * len(frames)
    assert ours.unsigned == len(frames)
