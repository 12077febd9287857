"""Virtual ArduPilot or PX4 in front of simulated physics, without port or clock.

Timeouts use the wall time passed in, readings the device time. NAMED_VALUE_FLOAT `plate_z`,
`plate_x` and `plate_tilt` move the virtual plate; `plate_mov` reports the state of the move.
"""

from __future__ import annotations

import hashlib
from math import isfinite

import numpy as np

from benchtool.bench.mavlink.autopilots import HIL_FLAG
from benchtool.bench.mavlink.drive import ARMED_FLAG
from benchtool.bench.mavlink.frames import (
    ARM_DISARM,
    AUTOPILOT_COMPONENT,
    MOTOR_TEST,
    REQUEST_MESSAGE,
    SET_INTERVAL,
    MavlinkFrames,
    Message,
    dialect,
)
from benchtool.bench.serial.commands import SendPlate, SetPwm, StopDevice
from benchtool.virtual import autopilot_orders as orders
from benchtool.virtual.autopilot_streams import Streams
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.server import ServedDevice

HEARTBEAT_INTERVAL_S = 1.0
REBOOT = 246  # MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
SILENT_S, READY_S = 1.0, 2.4  # first heartbeat, first motor test after a restart; recorded
MAX_RATE_HZ = 400.0  # main loop rate, upper bound of stream rates (SCHED_LOOP_RATE)
PLATE_US = 50_000  # interval of the plate's distance reports; assumed
TEXT_LENGTH = 50  # characters in one STATUSTEXT
HOST_TIMEOUT_S = 5.0  # lost ground station ends an armed flight (FS_GCS_TIMEOUT)


class VirtualAutopilot(ServedDevice):
    """MAVLink device in front of a virtual bench."""

    def __init__(
        self,
        firmware: Firmware,
        kind: str = "ardupilot",
        system: int = 1,
        key: bytes | None = None,  # 32 bytes that sign every frame
        now_s: float = 0.0,  # since 1970, for signatures
        hover_us: float | None = None,  # hover pulse of an armed pitch bench
    ) -> None:
        super().__init__(firmware)
        self.kind, hello = kind, firmware.hello
        self._beat_s, self._plate_us = -HEARTBEAT_INTERVAL_S, 0
        self._dialect = dialect()
        self._system = system
        self._key, self._since_1970_s, self._hover_us = key, now_s, hover_us
        self._booted_s: float | None = None
        self._boot_us = 0
        self._forget()
        self._streams = Streams(hello.channels, self._orders.outputs)
        self._shows_armed = False
        self._host_s = 0.0
        self._plate_pose = {"plate_x": 0.0, "plate_tilt": 0.0}
        names = [channel.name for channel in hello.channels]
        self._thrust = names.index("thrust_N") if "thrust_N" in names else None
        self._texts = 0
        self._pending: list[Message] = []
        self._pulses = np.full(hello.n_rotors, hello.pwm_stop_us)
        self._show()

    def receive(self, data: bytes, now_s: float) -> bytes:
        self.firmware.note_host(now_s)
        if self._booting(now_s, SILENT_S):
            return b""
        answers = [
            answer
            for message in self._frames.parse(data)
            for answer in self._answer(message, now_s)
        ]
        return b"".join(map(self._frames.pack, answers))

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        # The timeouts of motor tests replace the heartbeat of a host.
        self.firmware.note_host(now_s)
        self._drive(now_s)
        rows = self.firmware.advance(n, now_s)
        messages = [*self._events(), *self._take_pending()]
        if self._booting(now_s, SILENT_S):
            return b"", []
        if self._booted_s is not None and not self._booting(now_s, READY_S):
            self._booted_s = None
            messages += self._text("ArduPilot Ready", orders.INFO)
            self._show()
        if now_s - self._beat_s >= HEARTBEAT_INTERVAL_S:
            self._beat_s = now_s
            messages.append(self._heartbeat())
        frames = [self._frames.pack(message) for message in messages]
        stream: list[bytes] = []
        if self._every_us:
            for time_us, row in zip(
                rows.device_time_us.tolist(), rows.values.tolist(), strict=True
            ):
                stream.extend(self._sample(time_us, row))
        return b"".join(frames), stream

    def report(self, kind: str, text: str) -> bytes:
        return b"".join(map(self._frames.pack, self._text(text)))

    @property
    def outputs_us(self) -> tuple[int, ...]:
        return tuple(self._streams.outputs_us)

    def _sample(self, time_us: int, row: list[float]) -> list[bytes]:
        streams, messages = self._streams, []
        streams.update(row)
        time_us -= self._boot_us
        for number, due_us in self._due_us.items():
            if time_us >= due_us:
                every_us = self._every_us[number]
                self._due_us[number] = max(due_us + every_us, time_us - every_us)
                if (message := streams.message(number, time_us)) is not None:
                    messages.append(message)
        thrust_N = row[self._thrust] if self._thrust is not None else np.nan
        if isfinite(thrust_N):
            messages.append(streams.named("thrust", thrust_N, time_us))
        plate_z_m = streams.value("plate_z_m")
        if isfinite(plate_z_m) and time_us - self._plate_us >= PLATE_US:
            self._plate_us = time_us
            messages.append(streams.named("plate_z", plate_z_m, time_us))
        return [self._frames.pack(message) for message in messages]

    def _answer(self, message: Message, now_s: float) -> list[Message]:
        if self.host_since_s is None:
            self.host_since_s = now_s
        self._host_s = now_s
        name = message.msgname
        if getattr(message, "target_system", self._system) not in (0, self._system):
            return []
        if name == "COMMAND_LONG":
            result, messages = self._command(message, now_s)
            ack = self._dialect.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
            return [ack, *messages]
        if name == "PARAM_REQUEST_READ":
            return self._parameter(str(message.param_id))
        if name == "NAMED_VALUE_FLOAT":
            self._move_plate(str(message.name), float(message.value), now_s)
        return self._take_pending()

    def _command(self, message: Message, now_s: float) -> tuple[int, list[Message]]:
        params = tuple(getattr(message, f"param{number}") for number in range(1, 8))
        command = message.command
        if command == REBOOT:
            if self._orders.running or self._armed:
                return orders.FAILED, []
            self.restart(now_s)
            return orders.ACCEPTED, []
        if command == SET_INTERVAL:
            return self._set_interval(int(params[0]), params[1])
        if command == REQUEST_MESSAGE:
            version = int(params[0]) == self._dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            return (orders.ACCEPTED, [self._version()]) if version else (orders.UNSUPPORTED, [])
        if command == ARM_DISARM:
            return self._arm(params[0] > 0.5, now_s)
        if command == MOTOR_TEST and self._booted_s is not None:
            return orders.FAILED, self._text("Motor Test: Board initialising", orders.CRITICAL)
        was_running = self._orders.running
        result = self._orders.order(command, params, now_s)
        self._shows_armed = self._shows_armed or (self._orders.running and not was_running)
        texts = self._take_texts()
        self._drive(now_s)
        return result, texts

    def restart(self, now_s: float) -> None:
        """Restart as after a loss of power: all earlier commands are forgotten."""
        self._forget()
        self._booted_s, self._boot_us = now_s, self.firmware.device_time_us
        self.firmware.execute(StopDevice(), now_s)
        self._pulses = np.array(self.firmware.pwm_us)
        self._streams.outputs_us[:] = [0] * 16

    def _forget(self) -> None:
        kind = orders.Px4Orders if self.kind == "px4" else orders.ArduPilotOrders
        self._orders: orders.MotorOrders = kind(self.firmware.hello)
        self._frames = MavlinkFrames(
            self._system, AUTOPILOT_COMPONENT, self._key, self._since_1970_s, counts=False
        )
        self._every_us: dict[int, float] = {}
        self._due_us: dict[int, float] = {}
        self._armed = False
        self._beat_s, self._plate_us = -HEARTBEAT_INTERVAL_S, 0

    def _booting(self, now_s: float, lasts_s: float) -> bool:
        return self._booted_s is not None and now_s - self._booted_s < lasts_s

    def _set_interval(self, number: int, every_us: float) -> tuple[int, list[Message]]:
        if number not in self._streams.known or number in self._orders.lacks:
            text = f"No ap_message for mavlink id ({number})"
            return orders.DENIED, self._text(text, orders.INFO) if self.kind == "ardupilot" else []
        if 0.0 < every_us < 1e6 / MAX_RATE_HZ:
            text = f"Requested rate for message ID {number} too fast. Increase SCHED_LOOP_RATE"
            return orders.DENIED, self._text(text, orders.INFO)
        self._every_us.pop(number, None)
        self._due_us.pop(number, None)
        if every_us > 0.0:
            self._every_us[number] = every_us
            self._due_us[number] = float(self.firmware.device_time_us - self._boot_us)
        return orders.ACCEPTED, []

    def _arm(self, arm: bool, now_s: float) -> tuple[int, list[Message]]:
        if arm and self._orders.running:
            return orders.ACCEPTED, []  # a motor test has armed it
        if arm and self._hover_us is None:
            return orders.FAILED, self._text("Arm: Throttle too high", orders.CRITICAL)
        if arm and self._hover_us is not None:
            hover = np.full(self.firmware.hello.n_rotors, self._hover_us)
            reply = self.firmware.execute(SetPwm(tuple(hover.tolist())), now_s)
            if not reply.ok:
                return orders.FAILED, self._text(f"Arm: {reply.reason}", orders.CRITICAL)
            self._armed = True
        else:
            # Disarming does not end a motor test.
            if self._armed:
                self.firmware.execute(StopDevice(), now_s)
            self._armed, self._shows_armed = False, False
        self._beat_s = -HEARTBEAT_INTERVAL_S
        return orders.ACCEPTED, []

    def _drive(self, now_s: float) -> None:
        """Set the motor pulses of the active motor tests."""
        if self._armed:
            if now_s - self._host_s > HOST_TIMEOUT_S:
                self._arm(False, now_s)
                self._pending += self._text("GCS Failsafe", orders.CRITICAL)
            return
        hello = self.firmware.hello
        pulses = self._orders.pulses_us(now_s)
        self._pending += self._take_texts()
        # The outputs may carry pulses that the bench behind them does not accept.
        clipped = np.clip(pulses, hello.pwm_stop_us, hello.limits.get("pwm_us", np.inf))
        clipped = np.where(self._orders.safe, hello.pwm_stop_us, clipped)
        if not np.array_equal(clipped, self.firmware.pwm_us):
            reply = self.firmware.execute(SetPwm(tuple(clipped.tolist())), now_s)
            if not reply.ok:
                self._orders.end()
                self._pending += self._text(f"Motor Test: {reply.reason}", orders.CRITICAL)
                pulses = np.array(self.firmware.pwm_us)
        self._pulses = pulses
        self._show()

    def _show(self) -> None:
        """Write the reported outputs; outputs of a frame's other motors have the stop pulse."""
        outputs_us = self._streams.outputs_us
        if self._booted_s is not None or self._orders.safe:
            outputs_us[:] = [0] * 16
            return
        stop_us = round(self.firmware.hello.pwm_stop_us)
        outputs_us[: self._orders.n_outputs] = [stop_us] * self._orders.n_outputs
        pulses = self.firmware.pwm_us if self._armed else self._pulses
        for output, pulse_us in zip(self._orders.outputs, pulses, strict=True):
            outputs_us[output - 1] = round(float(pulse_us))

    def _take_texts(self) -> list[Message]:
        texts, self._orders.texts = self._orders.texts, []
        return [message for severity, text in texts for message in self._text(text, severity)]

    def _events(self) -> list[Message]:
        """Return the events of the bench as MAVLink messages."""
        messages: list[Message] = []
        for event in self.firmware.take_events():
            if event.stops_motors:
                self._orders.end()
                self._armed = False
                self._pulses = np.array(self.firmware.pwm_us)
                self._show()
                messages += self._text(f"Failsafe: {event.text}", orders.CRITICAL)
            elif event.kind == "arrived":
                messages.append(self._plate(0.0))
        return messages

    def _move_plate(self, name: str, value: float, now_s: float) -> None:
        if name in self._plate_pose:
            self._plate_pose[name] = value
        elif name == "plate_z":
            move = SendPlate(value, self._plate_pose["plate_x"], self._plate_pose["plate_tilt"])
            reply = self.firmware.execute(move, now_s)
            if not reply.ok:
                self._pending += self._text(f"plate: {reply.reason}", orders.WARNING)
            self._pending.append(self._plate(1.0 if reply.ok else -1.0))
        elif name == "plate_halt":
            self.firmware.execute(StopDevice(), now_s)

    def _take_pending(self) -> list[Message]:
        pending, self._pending = self._pending, []
        return pending

    def _plate(self, state: float) -> Message:
        """Return the state of the plate's move: 1 moving, 0 arrived, -1 rejected."""
        time_us = self.firmware.device_time_us - self._boot_us
        return self._streams.named("plate_mov", state, time_us)

    def _text(self, text: str, severity: int = orders.WARNING) -> list[Message]:
        """Return a text as STATUSTEXT messages, split with one id if it is too long."""
        build = self._dialect.MAVLink_statustext_message
        if len(text) <= TEXT_LENGTH:
            return [build(severity, text.encode("ascii", "replace"), 0, 0)]
        self._texts = self._texts % 65535 + 1
        starts = range(0, len(text) + 1, TEXT_LENGTH)
        parts = [text[start : start + TEXT_LENGTH] for start in starts]
        return [
            build(severity, part.encode("ascii", "replace"), self._texts, number)
            for number, part in enumerate(parts)
        ]

    def _heartbeat(self) -> Message:
        # Quadrotor (2), also for fewer rotors; custom modes (1) as both autopilots have.
        testing = self.kind == "ardupilot" and self._orders.running
        self._shows_armed = self._shows_armed and testing
        armed = self._armed or self._shows_armed
        mode = 1 | HIL_FLAG | (ARMED_FLAG if armed else 0)
        return self._dialect.MAVLink_heartbeat_message(
            2, orders.AUTOPILOTS[self.kind], mode, 0, 3, 3
        )

    def _version(self) -> Message:
        digest = hashlib.sha256(self.firmware.hello.device_id.encode()).digest()
        release = 4 << 24 | 7 << 16 if self.kind == "ardupilot" else 1 << 24 | 16 << 16
        return self._dialect.MAVLink_autopilot_version_message(
            0, release, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0,
            int.from_bytes(digest[:7], "little"), list(digest[:18]),
        )  # fmt: skip

    def _parameter(self, name: str) -> list[Message]:
        """Return the value of a parameter; unknown parameters are not answered."""
        parameters = {**self._orders.parameters, "SIM_SPEEDUP": self.speed}
        if name not in parameters:
            return []
        # A float (9), with the index of a parameter requested by name.
        build = self._dialect.MAVLink_param_value_message
        return [build(name.encode(), parameters[name], 9, len(parameters), 65535)]
