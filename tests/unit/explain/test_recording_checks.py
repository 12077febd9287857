"""Faults put into good recordings are found and mended or refused; good ones are left alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.data.columns import KINDS
from benchtool.data.run.read import read_points
from benchtool.explain.pitch.log import pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.recording_checks import repair_readings
from benchtool.explain.sweep.log import sweep_log
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import changed, recorded, without

Fault = Callable[[Recording], Recording]
DATASETS = Path(__file__).parents[3] / "datasets"


def late(channel: str, rows: int) -> Fault:
    """Return a fault: channels that begin with a word come so many rows late."""

    def put(good: Recording) -> Recording:
        columns = {
            name: np.concatenate(
                [np.repeat(good.column(name)[:1], rows), good.column(name)[:-rows]]
            )
            for name in good.names
            if name.startswith(channel)
        }
        return changed(good, **columns)

    return put


def scaled(channel: str, factor: float) -> Fault:
    def put(good: Recording) -> Recording:
        found = {n: factor * good.column(n) for n in good.names if n.startswith(channel)}
        return changed(good, **found)

    return put


def edited(channel: str, edit: Callable[[np.ndarray], np.ndarray]) -> Fault:
    return lambda good: changed(good, **{channel: edit(good.column(channel).copy())})


def spikes(channel: str, size: float) -> Fault:
    return edited(channel, lambda values: values + size * (np.arange(len(values)) % 701 == 100))


def hung(channel: str, rows: int) -> Fault:
    def hold(values: np.ndarray) -> np.ndarray:
        values[600 : 600 + rows] = values[600]
        return values

    return edited(channel, hold)


def clipped(channel: str) -> Fault:
    def clip(values: np.ndarray) -> np.ndarray:
        most = float(np.quantile(np.abs(values), 0.9))
        return values.clip(-most, most)

    return edited(channel, clip)


def exchanged(good: Recording) -> Recording:
    return changed(good, rpm1=good.column("rpm2"), rpm2=good.column("rpm1"))


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_beam").model


@pytest.fixture(scope="module")
def good(model):
    return recorded(model, 5, seconds=20.0)


MENDED: dict[str, tuple[Fault, str]] = {
    "angle 12 ms late": (late("theta_rad", 3), "theta_rad is 1[12]"),
    "angle 40 ms late": (late("theta_rad", 10), "theta_rad is (39|40)"),
    "rate 12 ms late": (late("gyro_rad_s", 3), "gyro_rad_s is 1[12]"),
    "speeds 12 ms late": (late("rpm", 3), "rpm is 1[123]"),
    "pulses 12 ms late": (late("pwm", 3), "pwm_us is 1[123]"),
    "speeds in rad/s": (scaled("rpm", np.pi / 30.0), "converted from rad/s"),
    "plate in mm": (scaled("plate_z_m", 1000.0), "converted from mm"),
    "speeds exchanged": (exchanged, "rpm2 follows pwm1_us"),
    "spikes of the angle": (spikes("theta_rad", 0.3), "7 spikes of theta_rad"),
    "spikes of the rate": (spikes("gyro_rad_s", -2.0), "7 spikes of gyro_rad_s"),
    "spikes of a speed": (spikes("rpm1", -3000.0), "7 spikes of rpm1"),
    "angle hangs": (hung("theta_rad", 200), "theta_rad is frozen"),
    "rate hangs": (hung("gyro_rad_s", 400), "gyro_rad_s is frozen"),
    "speed hangs": (hung("rpm2", 1500), "rpm2 is frozen"),
    "rate ends its range": (clipped("gyro_rad_s"), "gyro_rad_s saturates"),
    "angle ends its range": (clipped("theta_rad"), "theta_rad saturates"),
}


@pytest.mark.parametrize("fault", MENDED)
def test_a_fault_in_a_pitch_recording_is_mended_with_a_sentence(model, good, fault):
    put, words = MENDED[fault]
    log = pitch_log(put(good), model.rig)
    assert len([line for line in log.remarks if "judged in parts" not in line]) == 1
    assert re.search(words, log.remarks[0])


def test_angle_and_rate_that_both_come_late_are_refused(model, good):
    wrong = late("gyro_rad_s", 6)(late("theta_rad", 6)(good))
    with pytest.raises(InputError, match=r"responds 2[345].* ms after the rotors' thrust"):
        pitch_log(wrong, model.rig)


def test_a_loop_logged_at_half_its_rate_is_said(model, good):
    (said,) = pitch_log(good.select(np.arange(0, len(good), 2)), model.rig).remarks
    assert "rate of pwm1_us is 125 Hz, and the beam of rig beam is read at 250" in said


def test_a_filtered_rate_is_said_and_not_shifted(model, good):
    slow = lfilter([0.18], [1.0, -0.82], good.column("gyro_rad_s"))
    log = pitch_log(changed(good, gyro_rad_s=slow), model.rig)
    assert len(log.remarks) == 1
    assert "as through a low-pass filter" in log.remarks[0]
    np.testing.assert_array_equal(log.logged.gyro_rad_s, slow)


def test_what_was_shifted_stands_where_it_stood(model, good):
    before, after = (pitch_log(one, model.rig).logged for one in (good, late("rpm", 5)(good)))
    missed = (after.speed_rad_s - before.speed_rad_s)[:, 50:-50]
    assert np.sqrt(np.mean(missed**2)) < 0.5 * np.sqrt(np.mean(np.diff(before.speed_rad_s) ** 2))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pitch_beam", "pitch_pquad"])
@pytest.mark.parametrize("schedule", ["identify", "steps", "triangle", "chirp", "plate"])
def test_of_good_pitch_recordings_nothing_is_claimed(name, schedule):
    """Two benches and three seeds; all channels, and each kind of them missing."""
    model = load_model(name).model
    inertia = 0.0305 if name == "pitch_beam" else model.rig.body.inertia_yy_kgm2
    for seed in (10, 11, 12):
        good = recorded(model, seed, seconds=20.0, inertia=inertia, schedule=schedule)
        for missing in ("nothing", "gyro_rad_s", r"rpm\d", r"pwm\d_us"):
            remarks = pitch_log(without(good, missing), model.rig).remarks
            assert [line for line in remarks if not line.startswith("no ")] == []


def test_recordings_of_two_pitch_benches_are_refused(model, good):
    logs = [
        pitch_log(recorded(model, 6, seconds=20.0, inertia=inertia), model.rig, name)
        for name, inertia in (("learn", 0.0305), ("check", 0.045))
    ]
    with pytest.raises(InputError, match=r"acceleration over thrust in check is 0.6"):
        PitchSubject(model, logs[:1], logs[1:])
    faster = changed(good, **{f"rpm{k}": 1.4 * good.column(f"rpm{k}") for k in (1, 2)})
    with pytest.raises(InputError, match=r"speed over pulse in check is 1.4"):
        PitchSubject(model, logs[:1], [pitch_log(faster, model.rig, "check")])


@pytest.fixture(scope="module")
def swept():
    return read_points(DATASETS / "quad" / "run", KINDS)


def spike_of_thrust(good: Recording) -> Recording:
    thrust = good.column("thrust_N").copy()
    thrust[np.flatnonzero(good.column("kind") == KINDS.index("measure"))[5]] *= 1.5
    return changed(good, thrust_N=thrust)


SWEPT: dict[str, tuple[Fault, str]] = {
    "plate in mm": (scaled("plate_z_m", 1000.0), "converted from mm"),
    "speeds in rad/s": (scaled("rpm", np.pi / 30.0), "converted from rad/s"),
    "spike": (spike_of_thrust, "1 spike of thrust_N"),
    "full cell": (edited("thrust_N", lambda v: v.clip(max=9.0)), "thrust_N saturates at 9 N"),
}


@pytest.mark.parametrize("fault", SWEPT)
def test_a_fault_in_a_sweep_is_mended_with_a_sentence(swept, fault):
    put, words = SWEPT[fault]
    rig = load_model("quad").model.rig
    before, after = (sweep_log(one, rig, "points") for one in (swept, put(swept)))
    added = [line for line in after.remarks if line not in before.remarks]
    assert words in added[0]
    for channel in ("plate_z_m", "speed_rad_s"):
        if len(after) == len(before):
            np.testing.assert_allclose(
                getattr(after.conditions, channel), getattr(before.conditions, channel)
            )


@pytest.mark.parametrize("name", ["quad", "single_rotor"])
def test_of_good_sweeps_nothing_is_claimed(name):
    points = read_points(DATASETS / name / "run", KINDS)
    repaired = repair_readings(
        points, load_model("quad" if name == "quad" else "single").model.rig, name
    )
    assert repaired[1] == []


def test_sweeps_of_two_benches_are_refused(swept):
    model = load_model("quad").model
    other = changed(swept, thrust_N=1.4 * swept.column("thrust_N"))
    logs = [sweep_log(one, model.rig, name) for one, name in ((swept, "learn"), (other, "check"))]
    with pytest.raises(InputError, match=r"thrust over squared speed in check is 1.40 times"):
        SweepSubject(model, logs[:1], logs[1:])
