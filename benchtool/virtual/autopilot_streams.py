"""What the virtual autopilot streams: messages from the newest readings of a bench. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, isnan, nan, sin

from benchtool.bench.mavlink.frames import MODULUS
from benchtool.bench.mavlink.messages import ESC_STATUS, Message, dialect
from benchtool.core.channel import Channel

NO_PULSE = 0


class Streams:
    """Hold what a bench last reported, and make messages of it.

    Attributes:
        outputs_us: pulse of every output, 0 where there is none.

    Args:
        channels: of the rows that `hold` is given.
        order: (n_rotors,) output that drives each rotor, from 1.
        silent: numbers of messages that are accepted and never come: nothing is connected there.
    """

    def __init__(
        self, channels: Sequence[Channel], order: Sequence[int], silent: Sequence[int] = ()
    ) -> None:
        self._words = words = dialect()
        names = [channel.name for channel in channels]
        self._index = {name: index for index, name in enumerate(names)}
        self._last = [nan] * len(names)
        self._order = tuple(order)
        self.outputs_us = [NO_PULSE] * 16
        self._count = 0
        self._silent = set(silent)
        self.pitch = "theta_rad" in self._index
        w = words
        self._makers: dict[int, Callable[[int], Message]] = {
            w.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo,
            w.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            w.MAVLINK_MSG_ID_ATTITUDE_TARGET: self._target,
            w.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4: lambda us: self._telemetry(0),
            w.MAVLINK_MSG_ID_ESC_TELEMETRY_5_TO_8: lambda us: self._telemetry(4),
            w.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._distance,
            w.MAVLINK_MSG_ID_BATTERY_STATUS: lambda us: self._battery(),
            w.MAVLINK_MSG_ID_SYS_STATUS: lambda us: self._power(),
            w.MAVLINK_MSG_ID_SYSTEM_TIME: self._time,
            w.MAVLINK_MSG_ID_RPM: lambda us: w.MAVLink_rpm_message(-1.0, -1.0),
            ESC_STATUS: self._esc_status,
        }

    @property
    def known(self) -> frozenset[int]:
        """Numbers of the messages that there are."""
        return frozenset(self._makers)

    def hold(self, row: Sequence[float]) -> None:
        """Take a row of readings (c,); nan where a channel has no new value."""
        self._last = [old if isnan(new) else new for old, new in zip(self._last, row, strict=True)]

    def message(self, number: int, time_us: int) -> Message | None:
        """Return a message at a time since boot; None when nothing is connected there."""
        return None if number in self._silent else self._makers[number](time_us)

    def value(self, name: str) -> float:
        """Return what a channel last read, nan when it has read nothing."""
        return self._last[self._index[name]] if name in self._index else nan

    def named(self, name: str, value: float, time_us: int) -> Message:
        """Return a value under a name, as a companion or a script sends it."""
        return self._words.MAVLink_named_value_float_message(_ms(time_us), name.encode(), value)

    def _servo(self, time_us: int) -> Message:
        outputs = list(self.outputs_us)
        for rotor, output in enumerate(self._order if self.pitch else ()):
            pulse_us = self.value(f"pwm{rotor + 1}_us")  # of the loop on board, not of the host
            outputs[output - 1] = outputs[output - 1] if isnan(pulse_us) else round(pulse_us)
        return self._words.MAVLink_servo_output_raw_message(
            time_us % MODULUS, 0, *outputs[:8], *outputs[8:]
        )

    def _speeds(self) -> dict[int, float]:
        """Return the speed of the rotor at every output that has one."""
        return {output: self._known(f"rpm{rotor + 1}") for rotor, output in enumerate(self._order)}

    def _telemetry(self, first: int) -> Message:
        self._count = self._count % 65535 + 1
        speeds, words = self._speeds(), self._words
        places = [first + place + 1 for place in range(4)]
        there = [place in speeds for place in places]
        made = (
            words.MAVLink_esc_telemetry_5_to_8_message
            if first
            else words.MAVLink_esc_telemetry_1_to_4_message
        )
        return made(
            [round(self._known("temperature_degC")) * here for here in there],
            [round(100.0 * self._known("voltage_V")) * here for here in there],
            [0] * 4,
            [0] * 4,
            [min(round(speeds.get(place, 0.0)), 65535) for place in places],
            [self._count * here for here in there],
        )

    def _esc_status(self, time_us: int) -> Message:
        speeds = self._speeds()
        rpm = [round(speeds.get(place, 0.0)) for place in (1, 2, 3, 4)]
        volts = self._known("voltage_V")
        return self._words.mavlink_map[ESC_STATUS](0, time_us, rpm, [volts] * 4, [0.0] * 4)

    def _distance(self, time_us: int) -> Message:
        whole_cm = min(round(100.0 * self._known("plate_z_m")), 65535)
        # A laser (0) that looks down (25).
        return self._words.MAVLink_distance_sensor_message(
            _ms(time_us), 2, 400, whole_cm, 0, 0, 25, 0
        )

    def _battery(self) -> Message:
        volts = self._known("voltage_V")
        whole_mV = round(1000.0 * volts) if volts else 65535
        centiamperes = round(100.0 * self._known("current_A"))
        return self._words.MAVLink_battery_status_message(
            0, 0, 0, 32767, [whole_mV] + [65535] * 9, centiamperes, -1, -1, -1
        )

    def _power(self) -> Message:
        whole_mV = round(1000.0 * self._known("voltage_V")) or 65535
        centiamperes = round(100.0 * self._known("current_A"))
        return self._words.MAVLink_sys_status_message(
            0, 0, 0, 0, whole_mV, centiamperes, -1, 0, 0, 0, 0, 0, 0
        )

    def _attitude(self, time_us: int) -> Message:
        pitch, rate = -self._known("theta_rad"), -self._known("gyro_rad_s")
        return self._words.MAVLink_attitude_message(_ms(time_us), 0.0, pitch, 0.0, 0.0, rate, 0.0)

    def _target(self, time_us: int) -> Message:
        half = -0.5 * self._known("theta_ref_rad")
        return self._words.MAVLink_attitude_target_message(
            _ms(time_us), 0, [cos(half), 0.0, sin(half), 0.0], 0.0, 0.0, 0.0, 0.0
        )

    def _time(self, time_us: int) -> Message:
        return self._words.MAVLink_system_time_message(0, _ms(time_us))

    def _known(self, name: str) -> float:
        value = self.value(name)
        return 0.0 if isnan(value) else value


def _ms(time_us: int) -> int:
    return time_us // 1000 % MODULUS
