"""A bench that writes down what a guard does with it."""

import numpy as np

from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.core.channel import Channel
from benchtool.core.rig_file import load_rig_by_name

RIG = load_rig_by_name("pquad_single")
NAMES = ("thrust_N", "rpm1", "voltage_V", "current_A", "temperature_degC")
UNITS = ("N", "rpm", "V", "A", "degC")
K = RIG.propulsion.thrust_coefficient_N_s2


class FakeBench:
    """Write every command down; rotors follow at once; `spoil` changes what is read until a stop.

    `tail_rpm` is a speed that no command changes.
    """

    def __init__(self):
        self.did = []
        self.clock_s = 0.0
        self.pwm_us = np.array([1000.0])
        self.spoil = lambda time_s, row: row
        self.failing = {}
        self.tail_rpm = 0.0
        self.stopped_s = 0.0

    identity = DeviceInfo(
        address="fake:",
        device_id="fake",
        firmware="",
        protocol="fake",
        channels=tuple(Channel(name, unit) for name, unit in zip(NAMES, UNITS, strict=True)),
        rate_Hz=100.0,
        n_rotors=1,
        simulated=True,
        moves_plate=True,
    )

    def _do(self, what):
        self.did.append(what)
        if error := self.failing.get(what.split()[0]):
            raise error

    def now_s(self):
        return self.clock_s

    def open(self):
        self._do("open")

    def close(self):
        self._do("close")

    def set_pwm(self, pwm_us):
        self._do(f"pwm {pwm_us[0]:.0f}")
        self.pwm_us = pwm_us

    def stop(self):
        if "stop" not in self.did:
            self.stopped_s = self.clock_s
        self._do("stop")
        self.pwm_us = np.array([1000.0])

    def move_plate(self, z_m, x_m=0.0, tilt_rad=0.0):
        self._do(f"plate {z_m:g}" + (f" {x_m:g} {tilt_rad:g}" if x_m or tilt_rad else ""))

    def tare(self):
        self._do("tare")

    def set_rate(self, rate_Hz):
        self._do(f"rate {rate_Hz:g}")

    def read(self, timeout_s):
        if error := self.failing.get("read"):
            raise error
        n = round(timeout_s * 100.0)
        rows = []
        for _ in range(n):
            self.clock_s += 0.01
            pulse = RIG.propulsion
            rad_s = max(self.pwm_us[0] - pulse.pwm_start_us, 0.0) * pulse.speed_per_us_rad_s
            rpm = rad_s * 30.0 / np.pi + self.tail_rpm
            wobble = 0.003 * np.sin(700.0 * self.clock_s)
            row = {"thrust_N": K * rad_s**2 + wobble, "rpm1": rpm + 1000.0 * wobble * (rpm > 0)}
            row |= {"voltage_V": 11.0, "current_A": 1.0, "temperature_degC": 30.0}
            if "stop" not in self.did:
                row = self.spoil(self.clock_s, row)
            shown = [row.get(channel.name, np.nan) for channel in self.identity.channels]
            rows.append((self.clock_s, *shown))
        table = np.array(rows).reshape(n, 1 + len(self.identity.channels))
        return Readings(table[:, 0], table[:, 0] * 1e6, table[:, 1:])


def check_zeroed_once_then_closed(fake):
    """Fail unless zero was commanded once, just before the link was closed."""
    assert fake.did.count("stop") == 1
    assert fake.did[-2:] == ["stop", "close"]
