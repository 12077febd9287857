"""Session of a connected bench."""

from __future__ import annotations

import queue
import time
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchtool.acquire.calibration import (
    current_date,
    find_calibration,
    fit_calibration,
    mean_counts,
)
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import CONFIRMATION
from benchtool.bench.bench import Bench, DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import StopRequested
from benchtool.core.errors import BenchError, BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.run.state import store_state
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import EventPublisher
from benchtool.web.bench_process.runs import RunSupervisor
from benchtool.web.bench_process.telemetry import Telemetry
from benchtool.web.bench_process.throttle import DeadManSwitch, ThrottleRamp

READ_TIMEOUT_S = 0.02  # polling interval of the command queue


@dataclass(eq=False)
class Session:
    """Session that reads the bench and executes commands, in the main thread."""

    connect: messages.Connect
    number: int
    rig: Rig
    publisher: EventPublisher
    commands: queue.SimpleQueue[messages.Command]
    dead_man: DeadManSwitch
    runs: RunSupervisor
    telemetry: Telemetry

    def __post_init__(self) -> None:
        self._rig_limits = self.rig.limits
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
            self.rig = replace(self.rig, limits=command.limits)
            self.telemetry.set_limits(command.limits)
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
                masses_kg,
                counts,
                date=current_date(),
                device_id=device_id,
                weighing=command.weighing,
            )
            store_state("calibration", device_id, asdict(calibration))
            self._weighed.clear()
            self._publish_connection(bench.identity)
            slope_uN = 1e6 * calibration.slope_N_per_count
            text = f"calibration stored for {device_id}: {slope_uN:.6g} uN per count"
            self.publisher.publish(messages.Notice(text=text))
        else:
            self._weighed.clear()

    def _publish_connection(self, identity: DeviceInfo) -> None:
        self.publisher.publish(
            messages.ConnectionStatus(
                status="on",
                address=self.connect.address,
                session=self.number,
                identity=identity,
                rig=self.rig,
                rig_limits=self._rig_limits,
                calibration=find_calibration(None, identity),
                is_weighing=self.connect.is_weighing,
            )
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
