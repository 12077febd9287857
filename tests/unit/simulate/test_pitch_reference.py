"""The loop's physics against recordings of an independent rigid-body engine.

Driven by the logged pulses from a state estimated from the first moments alone, the plant must
predict the encoder for a second with an error near its noise and the wake's.
"""

from __future__ import annotations

import numpy as np

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import MIN_PARKED_Z_M, LoggedPitch, predict_windows
from benchtool.simulate.pitch.lane import FREE

WINDOW, TICKS = 250, 7500

WAKE_FLOOR_RAD = 0.004 / 0.03096 * np.sqrt(2.0 * 0.1 / 3.0) * 0.5
"""What the stated wake torque alone leaves over a second: its spectrum, integrated twice, root
mean square over the window. The bench's small imperfections and the starting rate add to it."""


def test_logged_pulses_predict_the_encoder(reference_data):
    table = np.genfromtxt(
        reference_data / "pitch_bench" / "nothing_hidden.csv", delimiter=",", names=True
    )
    bench = PitchBench.from_model(
        Model.single(load_rig_by_name("beam")), sensors={}, inertia_kgm2=0.03096, pwm_quantum_us=0.0
    )
    rate, theta = table["gyro"], table["theta"]
    speed = np.array([table["rpm1"], table["rpm2"]]) * np.pi / 30.0
    logged = LoggedPitch(
        rate_Hz=250.0,
        pwm_us=np.array([table["pwm1"], table["pwm2"]]),
        plate_z_m=table["plate_z"],
        plate_share=(table["plate_z"] < MIN_PARKED_Z_M).astype(float),
        theta_rad=theta,
        gyro_rad_s=rate,
        speed_rad_s=speed,
        mode=np.full(len(theta), float(FREE)),
    )
    starts, states = range(250, TICKS - WINDOW, WINDOW), {}
    for start in starts:
        fit = np.polyfit(np.arange(-12, 1), theta[start - 12 : start + 1], 2)
        began_rad_s = 0.5 * fit[-2] * 250.0 + 0.5 * rate[start - 1 : start + 2].mean()
        states[start] = np.array([[fit[-1], began_rad_s, 0.0, 0.0, *speed[:, start]]]).T
    predicted = predict_windows([bench], logged, states, WINDOW, 0)
    errors = [
        run.theta_rad[:, 0] - theta[start : start + WINDOW]
        for start, run in zip(starts, predicted, strict=True)
    ]
    rms = float(np.sqrt(np.mean(np.square(errors))))
    moved = np.array([table["theta"][s : s + WINDOW] for s in range(250, TICKS - WINDOW, WINDOW)])
    motion = float(np.sqrt(np.mean((moved - moved[:, :1]) ** 2)))
    assert rms < 2.0 * WAKE_FLOOR_RAD
    assert rms < 0.2 * motion
