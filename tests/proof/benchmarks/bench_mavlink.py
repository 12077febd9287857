"""MAVLink messages that one core decodes, beside bare pymavlink.

Decoding is parsing and rows; live is an open bench with its checks, fed in chunks as fast as it
takes them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.frames import MavlinkFrames, dialect
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.firmware import Firmware
from tests.proof.benchmarks.rows import Row

START_US = 60_000_000  # later than all stamps of an autopilot while the bench opens
CHUNK = 1000  # bytes that a reading of 5 ms finds at 5,000 messages per second

W = dialect()
WIRING = MotorMap(
    rig="", autopilot="", motors=(1, 2, 3, 4), outputs=(3, 1, 4, 2), escs=(3, 1, 4, 2)
)


def stream(count: int) -> list[bytes]:
    """Give frames of the messages of a sweep, in the shares of 50 Hz outputs and an 80 Hz cell."""
    device = MavlinkFrames(1, 1)
    frames: list[bytes] = []
    step = 0
    while len(frames) < count:
        time_us = START_US + 20_000 * step
        made = [
            W.MAVLink_servo_output_raw_message(time_us % 2**32, 0, *[1000 + step % 7] * 8),
            W.MAVLink_named_value_float_message(time_us // 1000, b"thrust", 1.5),
            W.MAVLink_attitude_message(time_us // 1000, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
            W.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [1200] * 4, [250] * 4, [1] * 4, [3000 + step % 9] * 4, [step % 65536] * 4
            ),
        ]
        frames += [device.pack(message) for message in made]
        step += 1
    return frames


def bare(data: bytes, chunk: int) -> int:
    """Parse with pymavlink alone."""
    parser = W.MAVLink(None, 255, 190)
    parser.robust_parsing = True
    return sum(
        len(parser.parse_buffer(data[at : at + chunk]) or []) for at in range(0, len(data), chunk)
    )


def ours(data: bytes, chunk: int) -> int:
    """Parse, count losses, and make rows."""
    frames, rows, count = MavlinkFrames(), MavlinkRows(WIRING, MavlinkSettings(), 1100.0), 0
    for at in range(0, len(data), chunk):
        for message in frames.parse(data[at : at + chunk]):
            rows.update(message)
            count += 1
        rows.take_rows()
    return count


def per_second(take: Callable[[bytes, int], int], data: bytes, chunk: int) -> float:
    """Return messages per second of processor time."""
    begun_s = time.process_time()
    count = take(data, chunk)
    return count / (time.process_time() - begun_s)


class Spring:
    """A transport from which as many frames flow as anybody takes, behind a virtual autopilot."""

    baud = None

    def __init__(self, device: VirtualAutopilot, frames: bytes) -> None:
        self._device, self._frames, self._at = device, frames, 0
        self._answer = b""
        self.flows = False

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def write(self, data: bytes) -> None:
        """Hand over to the autopilot."""
        self._answer += self._device.receive(data, time.monotonic())

    def read(self, timeout_s: float) -> bytes:
        """Give what there is."""
        if self.flows and self._at < len(self._frames):
            self._at += CHUNK
            return self._frames[self._at - CHUNK : self._at]
        told, samples = self._device.tick(1, time.monotonic())
        answer, self._answer = self._answer + told + b"".join(samples), b""
        return answer


def live(data: bytes, count: int) -> float:
    """Return messages per second that a whole bench takes, checks and losses among it."""
    rig = load_rig_by_name("pquad")
    truth = load_model("quad_body_lift", rig).model
    plant = virtual_plant(rig, truth, 1)
    hello = replace(build_hello(plant, truth, 1), speed=50.0)
    spring = Spring(VirtualAutopilot(Firmware(plant, hello)), data)
    with MavlinkBench(spring, "mavlink:spring", MavlinkSettings(system=1)) as bench:
        bench.read(0.1)
        spring.flows = True
        begun_s, rows = time.process_time(), 0
        while spring._at < len(data):
            rows += len(bench.read(0.1))
        taken_s = time.process_time() - begun_s
        spring.flows = False
    assert rows > count // 5
    return count / taken_s


def rows(quick: bool) -> Iterator[Row]:
    """Yield decoding in small and large chunks, and a live bench."""
    frames = stream(2000 if quick else 60_000)
    data = b"".join(frames)
    for chunk in (500, 4096):
        decoded, plain = (per_second(take, data, chunk) for take in (ours, bare))
        work = f"MAVLink decoder, chunks of {chunk} bytes"
        yield Row(work, decoded, "messages/s", plain, "pymavlink")
    plain = per_second(bare, data, CHUNK)
    rate = live(data, len(frames))
    yield Row("MAVLink bench, live", rate, "messages/s", plain, "pymavlink", 30_000)
