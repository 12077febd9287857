"""Bench process on simulated benches, by its message protocol without server and browser."""

from __future__ import annotations

import pickle
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from http.client import HTTPConnection
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from benchtool.acquire.inputs import RecordInputs, SweepInputs
from benchtool.acquire.plan import plan_from_toml
from benchtool.data.run.append import Event
from benchtool.data.run.read import read_pitch, read_points
from benchtool.data.run.run import Run
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.process import run_bench_process
from benchtool.web.bench_process.publisher import FRAME
from benchtool.web.bench_process.spawn import StopEndpoint

T = TypeVar("T")
TIMEOUT_S = 60.0


def is_over(event: messages.SweepStatus) -> bool:
    """Return whether a sweep is over."""
    return event.status in ("ended", "stopped")


def drives_1400_us(event: messages.LiveStatus) -> bool:
    return max(event.command_pwm_us, default=0.0) >= 1400.0


SETTINGS = "plate.distances_m = [0.1, 0.2]\nthrottle.pwm_us = [1400.0]\n"
PLAN = plan_from_toml(f"repeats = 1\nsample_s = 0.5\n{SETTINGS}", "plan")


class Server:
    """Server side of the pipe."""

    def __init__(self, pipe: Pipe, process: Any) -> None:
        self.pipe, self.process = pipe, process
        self.events: list[messages.BenchEvent] = []
        self.frames = 0

    def send(self, command: messages.Command) -> None:
        self.pipe.send_bytes(pickle.dumps(command))

    def wait_for(self, kind: type[T], matches: Callable[[T], bool] = lambda event: True) -> T:
        """Return the next event of a kind that matches."""
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            if not self.pipe.poll(0.5):
                continue
            message = self.pipe.recv_bytes()
            if message[:1] == FRAME:
                self.frames += 1
                continue
            event = pickle.loads(message[1:])
            self.events.append(event)
            if isinstance(event, kind) and matches(event):
                return event
        raise AssertionError(f"no {kind.__name__} before the timeout: {self.events[-5:]}")

    def connect(self, address: str, **options: Any) -> messages.ConnectionStatus:
        self.send(messages.Connect(address=address, **options))
        return self.wait_for(messages.ConnectionStatus, lambda event: event.status != "opening")


@pytest.fixture
def bench():
    spawn = get_context("spawn")
    pipe, child_pipe = spawn.Pipe()
    process = spawn.Process(target=run_bench_process, args=(child_pipe,))
    process.start()
    child_pipe.close()
    yield Server(pipe, process)
    if process.is_alive():
        pipe.send_bytes(pickle.dumps(messages.Shutdown()))
    process.join(20)
    pipe.close()
    assert process.exitcode == 0


def test_a_bench_is_connected_told_of_and_let_go(bench):
    on = bench.connect("sim:pquad_single")
    assert on.identity is not None
    assert on.rig is not None
    assert (on.status, on.session, on.rig.name) == ("on", 1, "pquad_single")
    live = bench.wait_for(messages.LiveStatus, lambda event: event.rate_Hz > 0.0)
    assert live.rate_Hz == pytest.approx(200.0, rel=0.1)
    assert (live.lost, live.corrupt, live.armed) == (0, 0, True)
    assert bench.frames >= 5
    bench.send(messages.Disconnect())
    off = bench.wait_for(messages.ConnectionStatus)
    assert (off.status, off.reason) == ("off", "")


@pytest.mark.parametrize(
    ("address", "fragment"),
    [
        ("nonsense", "has no address scheme"),
        ("sim:none", "unknown rig"),
        ("serial:/dev/none", "no rig for serial"),
    ],
)
def test_what_cannot_be_opened_is_told_in_one_sentence(bench, address, fragment):
    off = bench.connect(address)
    assert off.status == "off"
    assert fragment in off.reason
    assert bench.connect("sim:pquad_single").status == "on"


def test_motors_turn_only_while_the_button_is_reported_as_held(bench):
    limits = bench.connect("sim:pquad_single").rig_limits
    for _ in range(30):
        bench.send(messages.HoldThrottle("a", 1, 1300.0, (1,)))
        time.sleep(0.05)
    turning = bench.wait_for(
        messages.LiveStatus, lambda event: max(event.command_pwm_us, default=0.0) > 1100.0
    )
    assert len(turning.command_pwm_us) == 1
    bench.wait_for(messages.PressEnded, lambda event: "no report of the button for" in event.reason)
    assert turning.standstill == ""
    standing = bench.wait_for(messages.LiveStatus, lambda event: "was seen" in event.standstill)
    assert max(standing.command_pwm_us) == 1000.0
    assert standing.standstill.startswith("rotor 1 was seen to stand")
    bench.send(messages.TightenLimits(replace(limits, thrust_N=1.0)))
    for _ in range(30):
        bench.send(messages.HoldThrottle("a", 2, 1300.0, (1,)))
        time.sleep(0.05)
    off = bench.wait_for(messages.ConnectionStatus, lambda event: event.status == "off")
    assert off.reason.startswith("Thrust limit reached: 1.")
    assert off.reason.endswith("your limits are removed. Lower the pulse, then connect again.")


def test_masses_are_weighed_on_a_bench_that_cannot_turn(bench):
    on = bench.connect("sim:pquad_single", is_weighing=True)
    assert on.is_weighing
    bench.send(messages.WeighMass(0.0, seconds=0.2))
    live = bench.wait_for(messages.LiveStatus, lambda event: len(event.weighed) == 1)
    assert live.weighed[0][0] == 0.0
    bench.send(messages.HoldThrottle("a", 1, 1300.0, (1,)))
    bench.send(messages.StartRun(SweepInputs(plan=PLAN)))
    assert "connected for calibration only" in bench.wait_for(messages.Notice).text
    bench.send(messages.WeighMass(1e6))
    assert "load cell rating" in bench.wait_for(messages.Notice).text


def test_a_pitch_recording_is_kept_and_stopped(bench, tmp_path):
    inputs = RecordInputs(address="ADDRESS", seconds=2.0, collective=1610.0, runs=tmp_path)
    command = messages.StartRun(inputs)
    bench.connect("sim:pquad_single")
    bench.send(command)
    assert "is not a pitch bench" in bench.wait_for(messages.Notice).text
    bench.send(messages.Disconnect())
    bench.wait_for(messages.ConnectionStatus, lambda event: event.status == "off")
    bench.connect("sim:beam?mode=pitch&schedule=steps")
    bench.send(messages.SetClockSpeed(20.0))
    bench.send(command)
    began = bench.wait_for(messages.SweepStatus, lambda event: event.remaining_s > 0.0)
    assert began.kind == "pitch"
    assert began.active
    ended = bench.wait_for(messages.SweepStatus, lambda event: not event.active)
    assert ended.status == "ended", ended.reason
    assert "2 s, " in ended.reason
    run = Run.open(Path(ended.run))
    assert run.metadata["experiment"] == "pitch"
    assert run.metadata["samples"]["parquet_sha256"]
    assert len(read_pitch(run.path)) == pytest.approx(500, abs=5)

    bench.send(messages.StartRun(replace(inputs, seconds=60.0)))
    bench.wait_for(messages.SweepStatus, lambda event: event.remaining_s > 0.0)
    bench.send(messages.Disconnect())
    assert "a recording is under way" in bench.wait_for(messages.Notice).text
    bench.send(messages.StopMotors("a test"))
    stopped = bench.wait_for(messages.SweepStatus, lambda event: not event.active)
    assert stopped.status == "stopped"
    assert "stopped from a test" in stopped.reason
    assert Run.open(Path(stopped.run)).metadata["state"] == "stopped"


def test_a_sweep_runs_pauses_and_ends(bench, tmp_path):
    bench.connect("sim:pquad_single")
    bench.send(messages.SetClockSpeed(100.0))
    bench.send(messages.StartRun(SweepInputs(plan=PLAN, runs=tmp_path)))
    bench.wait_for(messages.SweepStatus, lambda event: event.n_measured == 1)
    bench.send(messages.PauseSweep(True))
    bench.wait_for(messages.SweepStatus, lambda event: event.status == "paused")
    bench.send(messages.Disconnect())
    assert "a sweep is under way" in bench.wait_for(messages.Notice).text
    bench.send(messages.PauseSweep(False))
    ended = bench.wait_for(messages.SweepStatus, is_over)
    assert ended.status == "ended", ended.reason
    assert ended.n_measured == ended.n_points == 5
    run_events = [event for event in bench.events if isinstance(event, Event)]
    assert {"tare", "paused", "went_on", "ended"} <= {event.event for event in run_events}
    (path,) = tmp_path.iterdir()
    assert len(read_points(path)) == 5
    assert Run.open(path).metadata["samples"]["parquet_sha256"]


def test_a_lost_page_pauses_a_sweep_in_mid_visit_and_the_visit_is_repeated(bench, tmp_path):
    bench.connect("sim:pquad_single")
    bench.send(messages.StartRun(SweepInputs(plan=PLAN, runs=tmp_path)))
    bench.wait_for(messages.LiveStatus, drives_1400_us)
    for _ in range(3):
        bench.send(messages.ServerHeartbeat("the page is closed"))
    bench.wait_for(messages.SweepStatus, lambda event: event.status == "paused")
    halted = bench.wait_for(messages.LiveStatus)
    assert max(halted.command_pwm_us) == 1000.0
    bench.send(messages.SetClockSpeed(100.0))
    for _ in range(3):
        bench.send(messages.ServerHeartbeat())
    bench.send(messages.PauseSweep(False))

    def ends_with_a_server(event: messages.BenchEvent) -> bool:
        bench.send(messages.ServerHeartbeat())
        return isinstance(event, messages.SweepStatus) and is_over(event)

    ended = bench.wait_for(object, ends_with_a_server)
    assert (ended.status, ended.n_measured) == ("ended", 5), ended.reason
    run_events = [event for event in bench.events if isinstance(event, Event)]
    assert [event.text for event in run_events if event.event == "paused"] == [
        "the page is closed; motors at zero"
    ]
    run = Run.open(Path(ended.run))
    assert run.metadata["needs_page"] is True
    points = read_points(run.path)
    assert np.isfinite(points.column("thrust_N")).all()
    assert len(set(points.column("point"))) == len(points) == 5


@pytest.mark.parametrize("token", ["right", "wrong"])
def test_stop_has_a_port_of_its_own(token, tmp_path):
    spawn = get_context("spawn")
    pipe, child_pipe = spawn.Pipe()
    endpoint = StopEndpoint(socket.create_server(("127.0.0.1", 0)), "right")
    process = spawn.Process(target=run_bench_process, args=(child_pipe, *endpoint))
    process.start()
    child_pipe.close()
    server = Server(pipe, process)
    try:
        server.connect("sim:pquad_single")
        server.send(messages.StartRun(SweepInputs(plan=PLAN, runs=tmp_path)))
        server.wait_for(messages.LiveStatus, drives_1400_us)
        sent = HTTPConnection("127.0.0.1", endpoint.port, timeout=TIMEOUT_S)
        sent.request("POST", "/stop", token)
        assert sent.getresponse().status == (200 if token == "right" else 403)
        if token == "right":
            stopped = server.wait_for(messages.SweepStatus, is_over)
            assert stopped.reason.startswith("stopped from the page; zero was commanded")
    finally:
        pipe.send_bytes(pickle.dumps(messages.Shutdown()))
        process.join(20)
        pipe.close()
        endpoint.listening.close()
