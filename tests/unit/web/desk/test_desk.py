"""The bench process by its own protocol, on simulated benches: no server, no browser."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import Any, TypeVar

import pytest

from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.acquire.plan import plan_from_toml
from benchtool.store import Run, read_pitch, read_points
from benchtool.web.desk.asks import (
    Ask,
    Connect,
    Disconnect,
    Hold,
    Leave,
    Pace,
    Pause,
    Record,
    Stop,
    Sweep,
    Tare,
    Weigh,
)
from benchtool.web.desk.desk import run_desk
from benchtool.web.desk.news import Connection, Happened, Live, News, PressEnded, Said, Swept
from benchtool.web.desk.outbox import FRAME

T = TypeVar("T")
PATIENCE_S = 60.0

PLAN = plan_from_toml(
    """
repeats = 1
sample_s = 0.5
[plate]
distances_m = [0.1, 0.2]
[throttle]
pwm_us = [1400.0]
""",
    "plan",
)


class Other:
    """Be the server's end of the pipe."""

    def __init__(self, pipe: Pipe, process: Any) -> None:
        self.pipe, self.process = pipe, process
        self.news: list[News] = []
        self.frames = 0

    def ask(self, ask: Ask) -> None:
        self.pipe.send_bytes(pickle.dumps(ask))

    def wait_for(self, kind: type[T], fits: Callable[[T], bool] = lambda news: True) -> T:
        """Return the next news of a kind that fits."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if not self.pipe.poll(0.5):
                continue
            told = self.pipe.recv_bytes()
            if told[:1] == FRAME:
                self.frames += 1
                continue
            news = pickle.loads(told[1:])
            self.news.append(news)
            if isinstance(news, kind) and fits(news):
                return news
        raise AssertionError(f"nothing of it came: {self.news[-5:]}")

    def connect(self, address: str, **more: Any) -> Connection:
        self.ask(Connect(address=address, **more))
        return self.wait_for(Connection, lambda news: news.status != "opening")


@pytest.fixture
def desk() -> Iterator[Other]:
    spawn = get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=run_desk, args=(theirs,))
    process.start()
    theirs.close()
    yield Other(ours, process)
    if process.is_alive():
        ours.send_bytes(pickle.dumps(Leave()))
    process.join(20)
    ours.close()
    assert process.exitcode == 0


def test_a_bench_is_connected_told_of_and_let_go(desk: Other) -> None:
    on = desk.connect("sim:pquad_single")
    assert on.identity is not None
    assert on.rig is not None
    assert (on.status, on.session, on.rig.name) == ("on", 1, "pquad_single")
    live = desk.wait_for(Live, lambda news: news.rate_Hz > 0.0)
    assert live.rate_Hz == pytest.approx(200.0, rel=0.1)
    assert (live.lost, live.corrupt, live.armed) == (0, 0, True)
    assert desk.frames >= 5
    desk.ask(Disconnect())
    off = desk.wait_for(Connection)
    assert (off.status, off.reason) == ("off", "")


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("nonsense", "names no scheme"),
        ("sim:none", "unknown rig"),
        ("serial:/dev/none", "which rig stands on"),
    ],
)
def test_what_cannot_be_opened_is_told_in_one_sentence(desk: Other, address: str, why: str) -> None:
    off = desk.connect(address)
    assert off.status == "off"
    assert why in off.reason
    assert desk.connect("sim:pquad_single").status == "on"


def test_asks_that_do_not_fit_are_refused_with_a_sentence(desk: Other) -> None:
    desk.ask(Tare())
    assert "no bench is connected" in desk.wait_for(Said).text
    desk.connect("sim:pquad_single")
    desk.ask(Connect(address="sim:pquad"))
    assert "connected already" in desk.wait_for(Said).text
    desk.ask(Weigh(0.1))
    assert "masses need a bench without limits" in desk.wait_for(Said).text
    desk.ask(Sweep(plan=plan_from_toml("[throttle]\npwm_us = [9000.0]", "plan")))
    said = desk.wait_for(Said)
    assert said.is_error
    assert "asks for 9000 us" in said.text


def test_a_hand_turns_motors_only_while_it_is_heard_of(desk: Other) -> None:
    desk.connect("sim:pquad_single")
    for _ in range(30):
        desk.ask(Hold("a", 1, 1300.0, (1,)))
        time.sleep(0.05)
    turning = desk.wait_for(Live, lambda news: max(news.pulses_us, default=0.0) > 1100.0)
    assert len(turning.pulses_us) == 1
    desk.wait_for(PressEnded, lambda news: "the button was not heard of" in news.reason)
    assert turning.standstill == ""
    standing = desk.wait_for(Live, lambda news: "was seen" in news.standstill)
    assert max(standing.pulses_us) == 1000.0
    assert standing.standstill.startswith("rotor 1 was seen to stand")


def test_masses_are_weighed_on_a_bench_that_cannot_turn(desk: Other) -> None:
    on = desk.connect("sim:pquad_single", weighs=True)
    assert on.weighs
    desk.ask(Weigh(0.0, seconds=0.2))
    live = desk.wait_for(Live, lambda news: len(news.weighed) == 1)
    assert live.weighed[0][0] == 0.0
    desk.ask(Hold("a", 1, 1300.0, (1,)))
    desk.ask(Sweep(plan=PLAN))
    assert "held for masses only" in desk.wait_for(Said).text
    desk.ask(Weigh(1e6))
    assert "the load cell's rating" in desk.wait_for(Said).text


def test_a_pitch_recording_is_kept_and_stopped(desk: Other, tmp_path: Path) -> None:
    asked = Record(experiment=PitchExperiment(seconds=2.0, collective_us=1610.0), runs=tmp_path)
    desk.connect("sim:pquad_single")
    desk.ask(asked)
    assert "so it is no pitch bench" in desk.wait_for(Said).text
    desk.ask(Disconnect())
    desk.wait_for(Connection, lambda news: news.status == "off")
    desk.connect("sim:beam?mode=pitch&schedule=steps")
    desk.ask(Pace(20.0))
    desk.ask(asked)
    began = desk.wait_for(Swept, lambda news: news.left_s > 0.0)
    assert began.pitch
    assert began.active
    ended = desk.wait_for(Swept, lambda news: not news.active)
    assert ended.status == "ended", ended.reason
    assert "2 s, " in ended.reason
    run = Run.open(Path(ended.run))
    assert run.metadata["experiment"] == "pitch"
    assert run.metadata["samples"]["parquet_sha256"]
    assert len(read_pitch(run.path)) == pytest.approx(500, abs=5)

    desk.ask(Record(experiment=PitchExperiment(seconds=60.0, collective_us=1610.0), runs=tmp_path))
    desk.wait_for(Swept, lambda news: news.left_s > 0.0)
    desk.ask(Disconnect())
    assert "a recording is under way" in desk.wait_for(Said).text
    desk.ask(Stop("a test"))
    stopped = desk.wait_for(Swept, lambda news: not news.active)
    assert stopped.status == "stopped"
    assert "stopped from a test" in stopped.reason
    assert Run.open(Path(stopped.run)).metadata["state"] == "stopped"


def test_a_sweep_runs_pauses_and_ends(desk: Other, tmp_path: Path) -> None:
    desk.connect("sim:pquad_single")
    desk.ask(Pace(100.0))
    desk.ask(Sweep(plan=PLAN, runs=tmp_path))
    desk.wait_for(Swept, lambda news: news.done == 1)
    desk.ask(Pause(True))
    desk.wait_for(Swept, lambda news: news.status == "paused")
    desk.ask(Disconnect())
    assert "a sweep is under way" in desk.wait_for(Said).text
    desk.ask(Pause(False))
    ended = desk.wait_for(Swept, lambda news: news.status in ("ended", "stopped"))
    assert ended.status == "ended", ended.reason
    assert ended.done == ended.visits == 5
    assert {news.event.event for news in desk.news if isinstance(news, Happened)} >= {
        "tare", "paused", "went_on", "ended",
    }  # fmt: skip
    (path,) = tmp_path.iterdir()
    assert len(read_points(path)) == 5
    assert Run.open(path).metadata["samples"]["parquet_sha256"]


def test_a_stopped_sweep_is_gone_on_with(desk: Other, tmp_path: Path) -> None:
    desk.connect("sim:pquad_single")
    desk.ask(Pace(20.0))
    desk.ask(Sweep(plan=PLAN, runs=tmp_path))
    desk.wait_for(Swept, lambda news: news.done == 2)
    desk.ask(Stop("a test"))
    stopped = desk.wait_for(Swept, lambda news: news.status in ("ended", "stopped"))
    assert stopped.reason.startswith("stopped from a test; zero was commanded")
    desk.ask(Pace(100.0))
    desk.ask(Sweep(resume=Path(stopped.run)))
    ended = desk.wait_for(Swept, lambda news: news.status in ("ended", "stopped"))
    assert (ended.status, ended.run, ended.done) == ("ended", stopped.run, 5)


def test_a_server_that_is_gone_stops_the_sweep_and_ends_the_process(
    desk: Other, tmp_path: Path
) -> None:
    desk.connect("sim:pquad_single")
    desk.ask(Sweep(plan=PLAN, runs=tmp_path))
    running = desk.wait_for(Swept, lambda news: news.status == "running")
    desk.pipe.close()
    desk.process.join(20)
    assert desk.process.exitcode == 0
    facts = Run.open(Path(running.run)).metadata
    assert facts["state"] == "stopped"
    assert "the page's server is gone" in facts["reason"]
