"""Session of a connected bench."""

from __future__ import annotations

import queue
import time
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from benchtool.acquire.arming import CONFIRMATION
from benchtool.acquire.calibration import (
    current_date,
    find_calibration,
    fit_calibration,
    mean_counts,
)
from benchtool.acquire.inputs import SweepInputs, WeighingInputs
from benchtool.bench.bench import Bench, DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.bench.wrappers import StopRequested
from benchtool.core.errors import BenchError, BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.calibration import Calibration
from benchtool.data.run.state import store_state
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import EventPublisher
from benchtool.web.bench_process.runs import RunSupervisor
from benchtool.web.bench_process.telemetry import Telemetry
from benchtool.web.bench_process.throttle import DeadManSwitch, ThrottleRamp

READ_TIMEOUT_S = 0.02  # polling interval of the command queue


class Session:
    """Session that reads the bench and executes commands, in the main thread."""

    def __init__(
        self,
        connect: messages.Connect,
        number: int,
        rig: Rig,
        publisher: EventPublisher,
        commands: queue.SimpleQueue[messages.Command],
        dead_man: DeadManSwitch,
        runs: RunSupervisor,
        telemetry: Telemetry,
    ) -> None:
        self._connect, self._number, self._rig = connect, number, rig
        self._publisher, self._commands, self._dead_man = publisher, commands, dead_man
        self._runs, self._telemetry = runs, telemetry
        self._rig_limits = rig.limits
        self._ramp = ThrottleRamp(rig)
        self._weighed: list[tuple[float, float]] = []
        self._armed = False

    def run(self, bench: Bench) -> None:
        """Serve an open bench until it is disconnected or an error ends the session."""
        guarded = bench if isinstance(bench, GuardedBench) else None
        self._armed = guarded is not None and bench.identity.simulated
        self._telemetry.begin(bench.identity, guarded)
        self._publish_connection(bench.identity)
        while True:
            try:
                command = self._next_command()
                if isinstance(command, messages.Shutdown):
                    self._commands.put(command)
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
                self._dead_man.end_press(str(stopped))
                bench.stop()
                self._publisher.publish(messages.Notice(text=str(stopped)))
            self._telemetry.update(armed=self._armed, weighed=tuple(self._weighed))

    def _next_command(self) -> messages.Command | None:
        try:
            return self._commands.get_nowait()
        except queue.Empty:
            return None

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
            self._publisher.publish(messages.Notice(text=str(error), is_error=True))

    def _execute_guarded(self, bench: GuardedBench, command: messages.Command) -> None:
        if isinstance(command, messages.ArmMotors):
            self._armed = bench.identity.simulated or command.typed.strip() == CONFIRMATION
            if not self._armed:
                raise InputError(f"not armed: {CONFIRMATION} was not typed; no motor was started")
        elif isinstance(command, messages.TightenLimits):
            bench.tighten_limits(command.limits)
            self._rig = replace(self._rig, limits=command.limits)
            self._telemetry.set_limits(command.limits)
            self._publish_connection(bench.identity)
        elif isinstance(command, messages.TareLoadCell):
            bench.tare()
            self._publisher.publish(messages.Notice(text="tared"))
        elif isinstance(command, messages.MovePlateTo):
            self._telemetry.update(busy=f"moving the plate to {1e3 * command.target_z_m:.0f} mm")
            bench.move_plate(command.target_z_m)
            self._telemetry.update(busy="")
        elif isinstance(command, messages.StartRun):
            is_sweep = isinstance(command.inputs, SweepInputs)
            self._dead_man.end_press(f"a {'sweep' if is_sweep else 'recording'} starts")
            bench.stop()
            self._runs.start(bench, self._rig, command)
        elif isinstance(command, messages.StartLiveRecording):
            self._dead_man.end_press("a recording starts")
            bench.stop()

            def apply_throttle() -> None:
                self._apply_throttle(bench)
                bench.check_standstill()

            self._runs.record_live(bench, self._rig, command, apply_throttle)
            self._dead_man.end_press("the recording has ended")

    def _apply_throttle(self, bench: GuardedBench) -> None:
        now_s = time.monotonic()
        press = self._dead_man.current_press(now_s)
        if press is not None and not self._armed:
            self._end_press(f"motors are not armed; type {CONFIRMATION} first")
            press = None
        try:
            self._ramp.step(bench, press, now_s)
        except InputError as error:
            self._end_press(str(error))

    def _end_press(self, reason: str) -> None:
        self._dead_man.end_press(reason)
        self._publisher.publish(messages.Notice(text=reason, is_error=True))

    def _calibrate(
        self,
        bench: Bench,
        guarded: GuardedBench | None,
        command: messages.WeighMass | messages.Calibrate,
    ) -> None:
        if guarded is not None:
            raise InputError("weighing needs a connection for calibration; press Calibrate first")
        if isinstance(command, messages.WeighMass):
            self._telemetry.update(busy=f"averaging counts under {command.mass_kg:g} kg")
            self._weighed.append(weigh(bench, self._rig, command.mass_kg, command.seconds))
            self._telemetry.update(busy="")
        elif command.store:
            device_id = bench.identity.device_id
            calibration = store_calibration(self._weighed, device_id, command.weighing)
            self._weighed.clear()
            self._publish_connection(bench.identity)
            slope_uN = 1e6 * calibration.slope_N_per_count
            text = f"calibration stored for {device_id}: {slope_uN:.6g} uN per count"
            self._publisher.publish(messages.Notice(text=text))
        else:
            self._weighed.clear()

    def _publish_connection(self, identity: DeviceInfo) -> None:
        self._publisher.publish(
            messages.ConnectionStatus(
                status="on",
                address=self._connect.address,
                session=self._number,
                identity=identity,
                rig=self._rig,
                rig_limits=self._rig_limits,
                calibration=find_calibration(None, identity),
                is_weighing=self._connect.is_weighing,
            )
        )


MAX_WEIGHING_S = 60.0


def weigh(bench: Bench, rig: Rig, mass_kg: float, seconds: float) -> tuple[float, float]:
    """Return a mass and the mean counts under it."""
    rating_N, weight_N = rig.limits.load_cell_rating_N, mass_kg * STANDARD_GRAVITY_M_S2
    if not 0.0 <= weight_N <= rating_N:
        raise InputError(
            f"mass {mass_kg:g} kg ({weight_N:.3g} N) is out of range; allowed: 0 N to the load "
            f"cell rating of {rating_N:g} N; use another mass"
        )
    if not 0.0 < seconds <= MAX_WEIGHING_S:
        raise InputError(
            f"averaging time {seconds:g} s is out of range; allowed: above 0, at most "
            f"{MAX_WEIGHING_S:g} s"
        )
    return mass_kg, mean_counts(bench, seconds).mean


def store_calibration(
    weighed: Sequence[tuple[float, float]], device_id: str, weighing: WeighingInputs
) -> Calibration:
    """Fit a calibration to masses in kg and counts, store it for the device and return it."""
    table = np.array(weighed, float).reshape(-1, 2)
    calibration = fit_calibration(
        *table.T, date=current_date(), device_id=device_id, weighing=weighing
    )
    store_state("calibration", device_id, asdict(calibration))
    return calibration
