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
from functools import partial
from multiprocessing.connection import Connection as Pipe
from typing import Any

from benchtool.acquire.inputs import resolve_rig
from benchtool.acquire.stop_listener import (
    VIRTUAL_CLOCKS,
    StopListener,
    announce,
    report_standstill,
)
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import StoppableBench
from benchtool.core.errors import BenchtoolError, StandstillNotConfirmed
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import EventPublisher
from benchtool.web.bench_process.runs import RunSupervisor
from benchtool.web.bench_process.session import Session
from benchtool.web.bench_process.telemetry import Telemetry
from benchtool.web.bench_process.throttle import DeadManSwitch

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
    listener = StopListener(
        listening,
        token,
        lambda source: process.stop(f"stopped from {source}"),
        lambda: report_standstill(process.guard),
    )
    with listener:
        process.announce = partial(announce, listener=listener)
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
            messages.AnswerQuestion: lambda command: self._runs.receive_answer(command.text),
            messages.EndRecording: lambda command: self._runs.end_live(),
            messages.Annotate: lambda command: self._annotate(command.text),
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

    def _annotate(self, text: str) -> None:
        if not text:
            self._publisher.report_error("the annotation is empty; type a text first")
        elif not self._runs.active:
            self._publisher.report_error(
                "an annotation needs a run; start a recording or a sweep first"
            )
        else:
            self._runs.annotate(text)

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
        number, address = self._sessions, connect.address
        self._publisher.publish(
            messages.ConnectionStatus(status="opening", address=address, session=number)
        )
        reason = problem = ""
        try:
            rig = resolve_rig(address, connect.rig or None)
            device = open_bench(address)
            telemetry = Telemetry(number, rig, self._publisher, lambda: stoppable.speed)
            speed = 1.0 if address.startswith(VIRTUAL_CLOCKS) else 0.0
            self._bench = stoppable = StoppableBench(device, telemetry.add, speed)
            session = Session(
                connect, number, rig, self._publisher, self._commands, self._dead_man, self._runs,
                telemetry,
            )  # fmt: skip
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
            problem = reason if isinstance(error, StandstillNotConfirmed) else ""
        finally:
            self._bench = self.guard = None
            self._publisher.publish(
                messages.ConnectionStatus(
                    address=address, session=number, reason=reason, standstill_problem=problem
                )
            )
