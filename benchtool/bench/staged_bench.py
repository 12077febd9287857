"""A bench whose plate something else moves: a G-code stage, or an operator."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import Bench, Identity, Readings
from benchtool.bench.join_readings import joined
from benchtool.bench.opened import Opened
from benchtool.bench.stage import Stage
from benchtool.core.channel import Channel
from benchtool.core.units import from_si

Array = NDArray[np.float64]

PLATE_CHANNELS = (
    Channel("plate_z_m", "m", "distance of the plate as its stage reports it"),
    Channel("plate_x_m", "m", "lateral position as it was asked for"),
    Channel("plate_tilt_deg", "deg", "inclination as it was asked for"),
)


class StagedBench(Opened):
    """Be another bench, with the plate moved by a stage.

    The stream gains the plate's channels, those that the bench streams itself are replaced: a
    value stands once, in the first sample after each move, nothing is repeated. Samples that
    arrive while the stage moves come with the next `read`.

    Args:
        bench: motors and sensors.
        stage: the plate.
    """

    def __init__(self, bench: Bench, stage: Stage) -> None:
        self._bench = bench
        self._stage = stage
        self._kept: list[Readings] = []
        self._news: Array | None = None

    @property
    def identity(self) -> Identity:
        identity = self._bench.identity
        own = tuple(identity.channels[index] for index in self._own_columns())
        return replace(identity, channels=(*own, *PLATE_CHANNELS), moves_plate=True)

    def now_s(self) -> float:
        return self._bench.now_s()

    def open(self) -> None:
        # The stage first: homing takes long, and a bench that nobody reads falls silent.
        self._stage.open()
        try:
            self._bench.open()
        except BaseException:
            self._stage.close()
            raise

    def close(self) -> None:
        with ExitStack() as both:
            both.callback(self._stage.close)
            self._bench.close()

    def set_pwm(self, pwm_us: Array) -> None:
        self._bench.set_pwm(pwm_us)

    def stop(self) -> None:
        with ExitStack() as both:
            both.callback(self._stage.hold)
            self._bench.stop()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        reached_m = self._stage.move(z_m, x_m, tilt_rad, self._listen)
        self._news = np.array([reached_m, x_m, from_si(tilt_rad, "deg")])

    def tare(self) -> None:
        self._bench.tare()

    def set_rate(self, rate_Hz: float) -> None:
        self._bench.set_rate(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        readings = joined([*self._kept, self._with_plate(self._bench.read(timeout_s))])
        self._kept = []
        return readings

    def _listen(self, duration_s: float) -> None:
        """Read on while the stage moves, so that the bench hears from us and nothing is lost."""
        self._kept.append(self._with_plate(self._bench.read(duration_s)))

    def _with_plate(self, readings: Readings) -> Readings:
        own = self._own_columns()
        plate = np.full((len(readings), len(PLATE_CHANNELS)), np.nan)
        if self._news is not None and len(readings):
            plate[0], self._news = self._news, None
        return replace(readings, values=np.column_stack([readings.values[:, own], plate]))

    def _own_columns(self) -> list[int]:
        names = {channel.name for channel in PLATE_CHANNELS}
        channels = self._bench.identity.channels
        return [index for index, channel in enumerate(channels) if channel.name not in names]
