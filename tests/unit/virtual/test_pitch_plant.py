"""The pitch bench as a device: armed by the host, its own loop, limits, a catch when idle."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.drivers import SimAddress, open_bench
from benchtool.bench.serial import commands as wire
from benchtool.core.errors import (
    InputError,
)
from benchtool.core.rig_file import load_rig_by_name
from benchtool.simulate.controllers.controller import PitchCommand, PitchMeasurement, PitchReference
from benchtool.simulate.pitch.simulate import simulate_pitch
from benchtool.virtual.devices import pitch_hello, pitch_plant
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.pitch_plant import PitchBenchPlant

RIG = load_rig_by_name("pquad")
NAMES = [channel.name for channel in pitch_plant(RIG, SimAddress(rig="pquad")).channels]


def hover_us() -> float:
    pulse = RIG.propulsion
    speed = np.sqrt(RIG.body.mass_kg * 9.81 / 4.0 / pulse.thrust_coefficient_N_s2)
    return float(pulse.pwm_start_us + speed / pulse.speed_per_us_rad_s)


def started(seed: int = 3, **named: str) -> tuple[PitchBenchPlant, Firmware]:
    plant = pitch_plant(RIG, SimAddress(rig="pquad", seed=seed, **named))
    return plant, Firmware(plant, pitch_hello(plant, seed))


def pulses(us: float) -> wire.SetPwm:
    return wire.SetPwm((us,) * 4)


def column(values: np.ndarray, name: str) -> np.ndarray:
    return values[:, NAMES.index(name)]


def test_it_agrees_with_the_simulation_of_the_same_seed():
    plant, device = started()
    assert device.execute(pulses(hover_us()), 0.0).ok
    values = device.advance(10_000, 0.0).values
    run = simulate_pitch(plant.job, plant.schedule.sampled(250.0, 0.12), seed=3)
    theta, expected = column(values, "theta_rad"), run.column("theta_rad")
    # The rotors begin at rest here and at hover there; friction keeps a little of that.
    before, visit = slice(250, 2400), slice(3750, 7250)
    assert np.degrees(np.abs(theta[before] - expected[before]).max()) < 0.1
    assert np.degrees(np.abs(theta[visit] - expected[visit]).max()) < 0.1
    assert np.degrees(expected[visit].mean()) == pytest.approx(-1.56, abs=0.1)
    assert column(values, "plate_z_m")[5000] == pytest.approx(0.24)
    assert column(values, "plate_z_m")[9000] == 1.0


def test_two_armings_have_noise_of_their_own_and_the_same_seed_has_the_same():
    both = []
    for _ in range(2):
        _, device = started(seed=5)
        device.execute(pulses(hover_us()), 0.0)
        first = device.advance(500, 0.0).values
        device.execute(wire.StopDevice(), 0.0)
        device.advance(500, 0.0)
        device.execute(pulses(hover_us()), 0.0)
        both.append((first, device.advance(500, 0.0).values))
    assert np.array_equal(both[0][0], both[1][0], equal_nan=True)
    assert np.array_equal(both[0][1], both[1][1], equal_nan=True)
    assert not np.array_equal(both[0][0], both[0][1], equal_nan=True)


def test_blocks_of_any_length_give_the_same_samples():
    _, one = started()
    _, many = started()
    for device in (one, many):
        device.execute(pulses(hover_us()), 0.0)
    whole = one.advance(3000, 0.0).values
    parts = np.concatenate([many.advance(n, 0.0).values for n in [1, 7, 92, 900, 2000]])
    assert np.array_equal(whole, parts, equal_nan=True)


def test_an_angle_beyond_its_limit_stops_the_motors_and_the_catch_brings_the_beam_back():
    plant, device = started()
    assert device.execute(wire.SetLimit("theta_rad", np.radians(1.0)), 0.0).ok
    device.execute(pulses(hover_us()), 0.0)
    for _ in range(600):
        device.advance(5, 0.0)
    event = device.take_events()[0]
    assert event.kind == "limit"
    assert "theta_rad" in event.text
    assert not device.execute(pulses(hover_us()), 0.0).ok
    assert not plant.armed
    values = device.advance(1000, 0.0).values
    assert abs(column(values, "theta_rad")[-1]) < 1e-6
    assert (column(values, "pwm1_us") == 1000.0).all()
    assert np.nanmax(column(values[-100:], "rpm1")) < 60.0
    device.execute(wire.Clear(), 0.0)
    assert device.execute(pulses(hover_us()), 0.0).ok


def test_the_plate_is_moved_at_idle_alone_and_acts():
    plant, device = started(schedule="steps")
    assert device.execute(wire.SendPlate(0.24), 0.0).ok
    assert plant.plate_moving
    values = device.advance(2500, 0.0).values
    assert not plant.plate_moving
    assert [event.kind for event in device.take_events()] == ["arrived"]
    assert column(values, "plate_z_m")[-1] == pytest.approx(0.24)
    assert np.nanmax(-np.diff(column(values, "plate_z_m")[::5])) <= 0.1 * 0.02 + 2e-4
    device.execute(pulses(hover_us()), 0.0)
    seen = device.advance(400, 0.0).values
    # Ground effect under the front rotor lifts the nose before the integral term catches up.
    assert np.degrees(column(seen, "theta_rad")[100:]).mean() < -0.5
    assert not device.execute(wire.SendPlate(0.5), 0.0).ok


@pytest.fixture
def bench():
    return open_bench("sim:pquad?mode=pitch&seed=2&controller=observer+feedforward")


class Own:
    """A law of the user's own: the soft cascade without its integrals."""

    made = 0

    def __init__(self) -> None:
        Own.made += 1
        self.times: list[float] = []

    def step(
        self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float
    ) -> PitchCommand:
        self.times.append(measurement.time_s)
        rate = 2.9 * (reference.theta_rad - measurement.theta_rad)
        return PitchCommand(0.018 * 7.4 * (rate - measurement.rate_rad_s))


class FailsLater(Own):
    """Fail after one second."""

    def step(
        self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float
    ) -> PitchCommand:
        if measurement.time_s > 1.0:
            raise RuntimeError("no more")
        return super().step(measurement, reference, dt_s)


def with_own(own: type[Own]) -> tuple[PitchBenchPlant, Firmware]:
    address = SimAddress(rig="pquad", seed=3, controller="mine:Own")
    plant = pitch_plant(RIG, address, user_controller=own)
    return plant, Firmware(plant, pitch_hello(plant, 3))


def test_a_users_own_controller_runs_on_the_device():
    device = with_own(Own)[1]
    built_in = started()[1]
    for each in (device, built_in):
        each.execute(pulses(hover_us()), 0.0)
    own, soft = (each.advance(4000, 0.0).values for each in (device, built_in))
    assert device.hello.facts["controller"] == "mine:Own"
    # The same law where the built-in one has no integral part (S3), but for the torque's limit.
    theta, expected = column(own, "theta_rad"), column(soft, "theta_rad")
    assert np.degrees(np.abs(theta - expected).max()) < 0.01
    assert np.degrees(theta[3500:].mean()) == pytest.approx(-1.56, abs=0.1)
    assert np.isfinite(column(own, "torque_Nm")).all()


def test_every_arming_has_a_new_controller_whose_time_begins_anew():
    plant, device = with_own(Own)
    before = Own.made
    for _ in range(2):
        device.execute(pulses(hover_us()), 0.0)
        for n in (1, 30, 469):
            device.advance(n, 0.0)
        times = plant._controller.times  # type: ignore[attr-defined]
        np.testing.assert_allclose(times, np.arange(500) / 250.0, atol=1e-12)
        device.execute(wire.StopDevice(), 0.0)
        device.advance(20, 0.0)
    assert Own.made == before + 2


def test_a_controller_that_raises_stops_the_motors_and_says_where():
    plant, device = with_own(FailsLater)
    device.execute(pulses(hover_us()), 0.0)
    with pytest.raises(InputError, match=r"RuntimeError: no more at 1\.0.*test_pitch_plant\.py"):
        device.advance(1000, 0.0)
    event = device.take_events()[0]
    assert event.kind == "limit"
    assert "raised RuntimeError: no more" in event.text
    assert not plant.armed
    values = device.advance(500, 0.0).values
    assert (column(values, "pwm1_us") == 1000.0).all()
    assert not device.execute(pulses(hover_us()), 0.0).ok
