"""Function `bt.sweep`: sweep from Python with arming confirmation."""

from __future__ import annotations

import importlib.util
import signal
import time
from pathlib import Path

import pytest

import benchtool as bt
from benchtool.acquire.operator import Unattended
from benchtool.core.errors import InputError, RunInterrupted, WouldOverwrite
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.unit.acquire.fake_bench import FakeBench
from tests.unit.acquire.interrupted import Interrupting

PLAN = {"z_over_r": (1, 2), "pwm": 1500, "repeats": 1, "sample_s": 0.5, "anchor_every": 0}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    return tmp_path


def test_a_sweep_returns_the_result_of_read(capsys):
    result = bt.sweep("sim:pquad", **PLAN, yes=True, out="run", operator="Ada")
    assert capsys.readouterr() == ("", "")
    bt.sweep("sim:pquad", **PLAN, yes=True, out="shown", progress=True)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert f"[{30 * '#'}] 3/3 visits" in shown.err
    assert result.found.metadata["operator"] == "Ada"
    assert len(repr(result.found)) < 100
    assert result.summary() == bt.read("run").summary()
    assert result.tables == ("points", "settings", "samples")
    points = result.to_dataframe()
    assert {str(points[name].dtype) for name in ("point", "n_samples")} == {"int64"}
    assert points["thrust_N"].to_numpy() == pytest.approx(
        read_points(Path("run")).column("thrust_N")
    )
    assert result.plot().axes
    assert "<svg" in result._repr_html_()
    with pytest.raises(WouldOverwrite):
        bt.sweep("sim:pquad", **PLAN, yes=True, out="run")
    with pytest.raises(InputError, match="nothing to resume in run"):
        bt.sweep(resume="run", yes=True)
    with pytest.raises(InputError, match="pwm and resume are both given"):
        bt.sweep(resume="run", pwm=1500, yes=True)


def test_no_bench_is_opened_without_confirmation(capsys):
    with pytest.raises(InputError, match=r"not armed: bt\.sweep turns motors"):
        bt.sweep("tcp:127.0.0.1:1", "pquad", **PLAN)
    with pytest.raises(InputError, match="z_over_r names -1"):
        bt.sweep("sim:pquad", z_over_r=-1, yes=True)
    with pytest.raises(InputError, match="dry_run needs the command line"):
        bt.sweep("sim:pquad", dry_run=True, yes=True)
    assert capsys.readouterr().out == ""


class Answering(Unattended):
    """Operator with the same answer to every question."""

    def __init__(self, text: str) -> None:
        self.text = text

    def answer(self, question: str, meanwhile: object = None) -> str:
        return self.text


def test_an_operator_arms_in_place_of_yes():
    with pytest.raises(RunInterrupted, match="not armed: ARM was not typed"):
        bt.sweep("sim:pquad", **PLAN, operator=Answering("yes"), out="run")
    assert not Path("run").exists()
    assert (
        len(bt.sweep("sim:pquad", **PLAN, operator=Answering("ARM"), out="run").found.points) == 3
    )


def test_yes_does_not_arm_an_unchecked_real_bench(monkeypatch):
    bench = FakeBench()
    monkeypatch.setattr("benchtool.acquire.session.open_bench", lambda *_: bench)
    with pytest.raises(InputError, match="it was never checked; run benchtool bench check fake:1"):
        bt.sweep("serial:fake", "pquad_single", **PLAN, yes=True, out="run")
    assert not Path("run").exists()
    assert {value for what, value in bench.log if what == "pwm"} <= {1000.0}


def assert_stopped(run: Path) -> None:
    """Check that a run is closed with zero throttle."""
    assert Run.open(run).metadata["state"] == "stopped"
    assert read_events(run / "events.jsonl")[-1].event == "stopped"
    pulses_us = read_samples(run).column("pwm1_us")
    assert pulses_us.max() == 1500.0
    assert pulses_us[-1] <= 1000.0


def test_ctrl_c_stops_motors_and_the_run_resumes(monkeypatch):
    monkeypatch.setattr("benchtool.acquire.operator.ProgressBar", Interrupting)
    with pytest.raises(RunInterrupted, match="stopped by Ctrl-C; zero was commanded") as stopped:
        bt.sweep("sim:pquad", **PLAN, yes=True, out="run", progress=True)
    assert_stopped(Path("run"))
    assert "resume with: benchtool sweep --resume run" in stopped.value.__notes__[0]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    bt.sweep(resume="run", yes=True)
    assert sorted(read_points(Path("run")).column("point")) == [1, 2, 3]


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("nbclient") is None, reason="nbclient (`make docs`)")
def test_interrupt_of_a_notebook_stops_motors(tmp_path):
    from jupyter_client.manager import start_new_kernel

    manager, client = start_new_kernel(kernel_name="python3", cwd=str(tmp_path))
    try:
        options = ", ".join(f"{name}={value!r}" for name, value in {**PLAN, "repeats": 500}.items())
        request = client.execute(
            f"import benchtool as bt; bt.sweep('sim:pquad', {options}, yes=True, out='run')"
        )
        points = tmp_path / "run" / "points.csv"
        end_s = time.monotonic() + 60.0
        while not (points.exists() and points.read_text().count("\n") > 3):
            assert time.monotonic() < end_s
            time.sleep(0.05)
        manager.interrupt_kernel()
        while (reply := client.get_shell_msg(timeout=60))["parent_header"]["msg_id"] != request:
            pass
        assert reply["content"]["ename"] == "RunInterrupted"
        assert "stopped by Ctrl-C; zero was commanded" in reply["content"]["evalue"]
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
    assert_stopped(tmp_path / "run")
