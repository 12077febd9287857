"""Bench process: one thread each for the bench, for commands and for publishing.

If the web server closes the pipe or is killed, the process sets zero throttle, closes the run and
ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing.connection import Connection as Pipe
from typing import Any

import numpy as np

from benchtool.acquire import stop_listener
from benchtool.acquire.calibration import (
    current_date,
    find_calibration,
    fit_calibration,
    mean_counts,
)
from benchtool.acquire.inputs import SweepInputs, resolve_rig
from benchtool.acquire.operator import CONFIRMATION
from benchtool.bench.bench import Bench, DeviceInfo
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import StoppableBench, StopRequested
from benchtool.core.errors import (
    BenchError,
    BenchtoolError,
    InputError,
    LimitExceeded,
    StandstillNotConfirmed,
)
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.run.state import store_state
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import EventPublisher
from benchtool.web.bench_process.runs import RunSupervisor
from benchtool.web.bench_process.telemetry import Telemetry
from benchtool.web.bench_process.throttle import DeadManSwitch, ThrottleRamp

BENCH_NICENESS = -10  # applied if the user is permitted to; assumed
MAX_CLOCK_SPEED = 100.0  # of a virtual clock, in multiples of real time; assumed
MAX_SERVER_SILENCE_S = 1.0  # ten heartbeats; assumed
POLL_INTERVAL_S = 0.1


def run_bench_process(pipe: Pipe, listening: socket.socket | None = None, token: str = "") -> None:
    """Serve the web server until the pipe closes; `listening` is the STOP listener's socket."""
    # This loop feeds the device's watchdog, so it gets priority where permitted.
    with suppress(OSError, AttributeError):
        os.nice(BENCH_NICENESS)
    process = BenchProcess(pipe)
    if listening is None:
        process.run()
        return
    listener = stop_listener.StopListener(
        listening,
        token,
        lambda source: process.stop(f"stopped from {source}"),
        lambda: stop_listener.report_standstill(process.guard),
    )
    with listener:
        process.announce = partial(stop_listener.announce, listener=listener)
        process.run()


class BenchProcess:
    """Bench process; the bench belongs to the main thread, which receives signals."""

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._publisher = EventPublisher(pipe)
        self._commands: queue.SimpleQueue[messages.Command] = queue.SimpleQueue()
        self._dead_man = DeadManSwitch(
            lambda tab, reason: self._publisher.publish(messages.PressEnded(tab, reason))
        )
        self._runs = RunSupervisor(self._publisher)
        self._urgent: dict[type, Callable[[Any], object]] = {
            messages.StopMotors: lambda command: self.stop(f"stopped from {command.source}"),
            messages.HoldThrottle: lambda command: self._dead_man.hold(command, time.monotonic()),
            messages.ReleaseThrottle: self._dead_man.release,
            messages.PauseSweep: lambda command: self._runs.pause(command.on),
            messages.AnswerQuestion: lambda command: self._runs.answers.put(command.text),
            messages.EndRecording: lambda command: self._runs.ended.set(),
            messages.Annotate: self._annotate,
        }
        self._bench: StoppableBench | None = None
        self._sessions = 0
        self._server_heard_s: float | None = None
        self.guard: GuardedBench | None = None
        self.announce: Callable[[str], AbstractContextManager[None]] = lambda address: nullcontext()

    def run(self) -> None:
        threading.Thread(target=self._listen, name="listen", daemon=True).start()
        try:
            while not isinstance(command := self._commands.get(), messages.Shutdown):
                if isinstance(command, messages.Connect):
                    self._serve_bench(command)
                elif not isinstance(command, messages.Disconnect):
                    self._publisher.report_error("no bench is connected; connect one first")
        except KeyboardInterrupt:
            pass
        finally:
            self._runs.finish()
            self._publisher.close()

    def _listen(self) -> None:
        """Receive commands; execute urgent ones here, queue the others for the main thread."""
        while True:
            try:
                command = self._receive()
            except (EOFError, OSError):
                command = messages.Shutdown()
            if isinstance(command, messages.ServerHeartbeat):
                self._server_heard_s = time.monotonic()
                if command.page_problem and (bench := self._bench) is not None:
                    self._runs.lose_page(bench, command.page_problem)
            elif (execute := self._urgent.get(type(command))) is not None:
                execute(command)
            elif isinstance(command, messages.SetClockSpeed):
                if (bench := self._bench) is not None and bench.speed:
                    bench.speed = min(max(command.speed, 0.1), MAX_CLOCK_SPEED)
            elif isinstance(command, messages.Shutdown):
                self.stop("the web server has ended")
                self._commands.put(command)
                return
            elif self._runs.active:
                self._publisher.report_error(f"a {self._runs.noun} is under way; stop it first")
            else:
                self._commands.put(command)

    def _annotate(self, command: messages.Annotate) -> None:
        if self._runs.active:
            self._runs.texts.put(command.text)
        else:
            text = "an annotation needs a run; start a recording or a sweep first"
            self._publisher.report_error(text)

    def _receive(self) -> messages.Command:
        """Return the next command; stop the motors if heartbeats are missing meanwhile."""
        while not self._pipe.poll(POLL_INTERVAL_S):
            heard_s = self._server_heard_s
            if heard_s is not None and time.monotonic() - heard_s > MAX_SERVER_SILENCE_S:
                self._server_heard_s = None
                self.stop(f"no heartbeat from the web server for {MAX_SERVER_SILENCE_S:g} s")
        command: messages.Command = pickle.loads(self._pipe.recv_bytes())
        return command

    def stop(self, reason: str) -> None:
        """Stop motors, sweep and recording; callable from any thread."""
        self._dead_man.end_press(reason)
        if (bench := self._bench) is not None:
            bench.request_stop(reason)

    def _serve_bench(self, connect: messages.Connect) -> None:
        """Open a bench and run its session until disconnection or an error."""
        self._sessions += 1
        address = connect.address
        opening = messages.ConnectionStatus(
            status="opening", address=address, session=self._sessions
        )
        self._publisher.publish(opening)
        reason = problem = ""
        try:
            rig = resolve_rig(address, connect.rig or None)
            device = open_bench(address)
            telemetry = Telemetry(opening.session, rig, self._publisher, lambda: stoppable.speed)
            speed = 1.0 if address.startswith(stop_listener.VIRTUAL_CLOCKS) else 0.0
            self._bench = stoppable = StoppableBench(device, telemetry.add, speed)
            status = replace(
                opening, status="on", rig_limits=rig.limits, is_weighing=connect.is_weighing
            )
            session = Session(
                status, rig, self._publisher, self._commands, self._dead_man, self._runs, telemetry
            )
            closed_bench = stoppable if connect.is_weighing else GuardedBench(stoppable, rig)
            self.guard = closed_bench if isinstance(closed_bench, GuardedBench) else None
            with self.announce(address), closed_bench as bench:
                session.run(bench)
            state = bench.standstill if isinstance(bench, GuardedBench) else None
            if state is not None and not state.is_confirmed:
                self._publisher.report_error(state.text)
                problem = state.text
        except BenchtoolError as error:
            reason = str(error)
            if isinstance(error, LimitExceeded) and error is not self._runs.sweep_error:
                reason = messages.limit_message(error, session.rig.limits, rig.limits)
            problem = reason if isinstance(error, StandstillNotConfirmed) else ""
        finally:
            self._bench = self.guard = None
            self._publisher.publish(
                replace(opening, status="off", reason=reason, standstill_problem=problem)
            )


READ_TIMEOUT_S = 0.02  # polling interval of the command queue


@dataclass(eq=False)
class Session:
    """Session that reads the bench and executes commands, in the main thread."""

    status: messages.ConnectionStatus
    rig: Rig
    publisher: EventPublisher
    commands: queue.SimpleQueue[messages.Command]
    dead_man: DeadManSwitch
    runs: RunSupervisor
    telemetry: Telemetry

    def __post_init__(self) -> None:
        self._ramp = ThrottleRamp(self.rig)
        self._weighed: list[tuple[float, float]] = []
        self._armed = False

    def run(self, bench: Bench) -> None:
        """Serve an open bench until it is disconnected or an error ends the session."""
        guarded = bench if isinstance(bench, GuardedBench) else None
        self._armed = guarded is not None and bench.identity.simulated
        self.telemetry.begin(bench.identity, guarded)
        self._publish_connection(bench.identity)
        while True:
            try:
                command = None if self.commands.empty() else self.commands.get_nowait()
                if isinstance(command, messages.Shutdown):
                    self.commands.put(command)
                if isinstance(command, messages.Shutdown | messages.Disconnect):
                    return
                if command is not None:
                    self._execute(bench, guarded, command)
                if guarded is not None:
                    self._apply_throttle(guarded)
                bench.read(READ_TIMEOUT_S)
                if guarded is not None:
                    guarded.check_standstill()
            except StopRequested as stopped:
                self.dead_man.end_press(str(stopped))
                bench.stop()
                self.publisher.publish(messages.Notice(text=str(stopped)))
            self.telemetry.update(armed=self._armed, weighed=tuple(self._weighed))

    def _execute(
        self, bench: Bench, guarded: GuardedBench | None, command: messages.Command
    ) -> None:
        """Execute a command; publish its errors, raise those that end the session."""
        try:
            if isinstance(command, messages.WeighMass | messages.Calibrate):
                self._calibrate(bench, guarded, command)
            elif isinstance(command, messages.Connect):
                raise InputError("a bench is connected already; disconnect it first")
            elif guarded is None:
                raise InputError("the bench is connected for calibration only; reconnect it")
            else:
                self._execute_guarded(guarded, command)
        except StopRequested:
            raise
        except BenchtoolError as error:
            if isinstance(error, BenchError) and guarded is not None and guarded.reason:
                raise
            self.publisher.report_error(str(error))

    def _execute_guarded(self, bench: GuardedBench, command: messages.Command) -> None:
        if isinstance(command, messages.ArmMotors):
            self._armed = bench.identity.simulated or command.typed.strip() == CONFIRMATION
            if not self._armed:
                raise InputError(f"not armed: {CONFIRMATION} was not typed; no motor was started")
        elif isinstance(command, messages.TightenLimits):
            bench.tighten_limits(command.limits)
            self.rig = self.telemetry.rig = replace(self.rig, limits=command.limits)
            self._publish_connection(bench.identity)
        elif isinstance(command, messages.TareLoadCell):
            bench.tare()
            self.publisher.publish(messages.Notice(text="tared"))
        elif isinstance(command, messages.MovePlateTo):
            self.telemetry.update(busy=f"moving the plate to {1e3 * command.target_z_m:.0f} mm")
            bench.move_plate(command.target_z_m)
            self.telemetry.update(busy="")
        elif isinstance(command, messages.StartRun | messages.StartLiveRecording):
            is_live = isinstance(command, messages.StartLiveRecording)
            is_sweep = isinstance(command, messages.StartRun) and isinstance(
                command.inputs, SweepInputs
            )

            def apply_throttle() -> None:
                self._apply_throttle(bench)
                bench.check_standstill()

            self.dead_man.end_press(f"a {'sweep' if is_sweep else 'recording'} starts")
            bench.stop()
            self.runs.start(bench, self.rig, command, apply_throttle)
            if is_live:
                self.dead_man.end_press("the recording has ended")

    def _apply_throttle(self, bench: GuardedBench) -> None:
        now_s = time.monotonic()
        press = self.dead_man.current_press(now_s)
        if press is not None and not self._armed:
            self._end_press(f"motors are not armed; type {CONFIRMATION} first")
            press = None
        try:
            self._ramp.step(bench, press, now_s)
        except InputError as error:
            self._end_press(str(error))

    def _end_press(self, reason: str) -> None:
        self.dead_man.end_press(reason)
        self.publisher.report_error(reason)

    def _calibrate(
        self,
        bench: Bench,
        guarded: GuardedBench | None,
        command: messages.WeighMass | messages.Calibrate,
    ) -> None:
        if guarded is not None:
            raise InputError("weighing needs a connection for calibration; press Calibrate first")
        if isinstance(command, messages.WeighMass):
            self.telemetry.update(busy=f"averaging counts under {command.mass_kg:g} kg")
            _check_weighing(command, self.rig)
            self._weighed.append((command.mass_kg, mean_counts(bench, command.seconds).mean))
            self.telemetry.update(busy="")
        elif command.store:
            device_id = bench.identity.device_id
            masses_kg, counts = np.array(self._weighed, float).reshape(-1, 2).T
            calibration = fit_calibration(
                masses_kg, counts, date=current_date(), device_id=device_id,
                weighing=command.weighing,
            )  # fmt: skip
            store_state("calibration", device_id, asdict(calibration))
            self._weighed.clear()
            self._publish_connection(bench.identity)
            slope_uN = 1e6 * calibration.slope_N_per_count
            text = f"calibration stored for {device_id}: {slope_uN:.6g} uN per count"
            self.publisher.publish(messages.Notice(text=text))
        else:
            self._weighed.clear()

    def _publish_connection(self, identity: DeviceInfo) -> None:
        calibration = find_calibration(None, identity)
        self.publisher.publish(
            replace(self.status, identity=identity, rig=self.rig, calibration=calibration)
        )


MAX_WEIGHING_S = 60.0


def _check_weighing(command: messages.WeighMass, rig: Rig) -> None:
    rating_N, weight_N = rig.limits.load_cell_rating_N, command.mass_kg * STANDARD_GRAVITY_M_S2
    if not 0.0 <= weight_N <= rating_N:
        raise InputError(
            f"mass {command.mass_kg:g} kg ({weight_N:.3g} N) is out of range; allowed: 0 N to the "
            f"load cell rating of {rating_N:g} N; use another mass"
        )
    if not 0.0 < command.seconds <= MAX_WEIGHING_S:
        raise InputError(
            f"averaging time {command.seconds:g} s is out of range; allowed: above 0, at most "
            f"{MAX_WEIGHING_S:g} s"
        )
