"""Message streams of the virtual autopilot, built from the newest readings of a bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, isnan, nan, sin

from benchtool.bench.mavlink.frames import ESC_STATUS, Message, dialect
from benchtool.bench.mavlink.rows import TIME_MODULUS
from benchtool.core.channel import Channel


class Streams:
    """Newest readings of a bench and the messages built from them."""

    def __init__(self, channels: Sequence[Channel], order: Sequence[int]) -> None:
        self._dialect = w = dialect()
        self._index = {channel.name: index for index, channel in enumerate(channels)}
        self._last = [nan] * len(channels)
        self._order = tuple(order)
        self.outputs_us = [0] * 16  # 0: no pulse
        self._count = 0
        read = self._reading
        self._makers: dict[int, Callable[[int], Message | None]] = {
            w.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo,
            w.MAVLINK_MSG_ID_ATTITUDE: lambda us: w.MAVLink_attitude_message(
                _ms(us), 0.0, -read("theta_rad"), 0.0, 0.0, -read("gyro_rad_s"), 0.0
            ),
            w.MAVLINK_MSG_ID_ATTITUDE_TARGET: self._target,
            w.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4: lambda us: self._telemetry(
                0, w.MAVLink_esc_telemetry_1_to_4_message
            ),
            w.MAVLINK_MSG_ID_ESC_TELEMETRY_5_TO_8: lambda us: self._telemetry(
                4, w.MAVLink_esc_telemetry_5_to_8_message
            ),
            # Laser (0), pointing down (25).
            w.MAVLINK_MSG_ID_DISTANCE_SENSOR: lambda us: w.MAVLink_distance_sensor_message(
                _ms(us), 2, 400, min(round(100.0 * read("plate_z_m")), 65535), 0, 0, 25, 0
            ),
            w.MAVLINK_MSG_ID_BATTERY_STATUS: lambda us: w.MAVLink_battery_status_message(
                0, 0, 0, 32767, [self._mV()] + [65535] * 9, self._cA(), -1, -1, -1
            ),
            w.MAVLINK_MSG_ID_SYS_STATUS: lambda us: w.MAVLink_sys_status_message(
                0, 0, 0, 0, self._mV(), self._cA(), -1, 0, 0, 0, 0, 0, 0
            ),
            w.MAVLINK_MSG_ID_SYSTEM_TIME: lambda us: w.MAVLink_system_time_message(0, _ms(us)),
            w.MAVLINK_MSG_ID_RPM: lambda us: None,  # known, but without a sensor
            ESC_STATUS: self._esc_status,
        }
        self.known = frozenset(self._makers)

    def update(self, row: Sequence[float]) -> None:
        """Store a row of readings (c,); nan where a channel has no new value."""
        self._last = [old if isnan(new) else new for old, new in zip(self._last, row, strict=True)]

    def message(self, number: int, time_us: int) -> Message | None:
        """Return a message at a time since boot; None for a sensor that is not connected."""
        return self._makers[number](time_us)

    def value(self, name: str) -> float:
        """Return the last reading of a channel, nan before the first."""
        return self._last[self._index[name]] if name in self._index else nan

    def named(self, name: str, value: float, time_us: int) -> Message:
        """Return a NAMED_VALUE_FLOAT message, as a companion or script sends it."""
        return self._dialect.MAVLink_named_value_float_message(_ms(time_us), name.encode(), value)

    def _reading(self, name: str) -> float:
        value = self.value(name)
        return 0.0 if isnan(value) else value

    def _mV(self) -> int:
        return round(1000.0 * self._reading("voltage_V")) or 65535

    def _cA(self) -> int:
        return round(100.0 * self._reading("current_A"))

    def _servo(self, time_us: int) -> Message:
        outputs = list(self.outputs_us)
        for rotor, output in enumerate(self._order if "theta_rad" in self._index else ()):
            pulse_us = self.value(f"pwm{rotor + 1}_us")  # of the control loop on board
            outputs[output - 1] = outputs[output - 1] if isnan(pulse_us) else round(pulse_us)
        return self._dialect.MAVLink_servo_output_raw_message(
            time_us % TIME_MODULUS, 0, *outputs[:8], *outputs[8:]
        )

    def _speeds(self) -> dict[int, float]:
        """Return the rotor speed of every output with a rotor: rpm."""
        return {
            output: self._reading(f"rpm{rotor + 1}") for rotor, output in enumerate(self._order)
        }

    def _telemetry(self, first: int, make: Callable[..., Message]) -> Message:
        self._count = self._count % 65535 + 1
        speeds = self._speeds()
        outputs = range(first + 1, first + 5)
        is_present = [output in speeds for output in outputs]
        return make(
            [round(self._reading("temperature_degC")) * present for present in is_present],
            [round(100.0 * self._reading("voltage_V")) * present for present in is_present],
            [0] * 4,
            [0] * 4,
            [min(round(speeds.get(output, 0.0)), 65535) for output in outputs],
            [self._count * present for present in is_present],
        )

    def _esc_status(self, time_us: int) -> Message:
        speeds = self._speeds()
        rpm = [round(speeds.get(output, 0.0)) for output in (1, 2, 3, 4)]
        volts = self._reading("voltage_V")
        return self._dialect.mavlink_map[ESC_STATUS](0, time_us, rpm, [volts] * 4, [0.0] * 4)

    def _target(self, time_us: int) -> Message:
        half = -0.5 * self._reading("theta_ref_rad")
        return self._dialect.MAVLink_attitude_target_message(
            _ms(time_us), 0, [cos(half), 0.0, sin(half), 0.0], 0.0, 0.0, 0.0, 0.0
        )


def _ms(time_us: int) -> int:
    return time_us // 1000 % TIME_MODULUS
