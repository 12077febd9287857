"""Units and signs that contradict each other are refused before anything is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import iirpeak, lfilter

from benchtool.core.errors import InputError
from benchtool.explain.pitch.log import pitch_log
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import changed, recorded, without


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_beam").model


@pytest.fixture(scope="module")
def good(model):
    return recorded(model, 5, seconds=12.0)


def test_a_good_recording_is_taken_with_and_without_its_gyro(model, good):
    assert pitch_log(good, model.rig).remarks == ()
    assert len(pitch_log(without(good, "gyro_rad_s"), model.rig).logged) == 3000


def test_degrees_are_told_from_radians(model, good):
    wrong = changed(good, theta_rad=np.degrees(good.column("theta_rad")))
    with pytest.raises(InputError, match="state the column's unit"):
        pitch_log(wrong, model.rig)


@pytest.mark.parametrize("factor", [-1.0, 57.3])
def test_rates_that_are_not_those_of_the_angle_are_refused(model, good, factor):
    wrong = changed(good, gyro_rad_s=factor * good.column("gyro_rad_s"))
    with pytest.raises(InputError, match="times the change of theta_rad"):
        pitch_log(wrong, model.rig)
    # An experiment that was simulated to be compared is taken as it is.
    assert pitch_log(wrong, model.rig, checked=False).remarks == ()


def test_a_beam_that_turns_against_its_thrust_is_refused(model, good):
    turned = changed(
        good, theta_rad=-good.column("theta_rad"), gyro_rad_s=-good.column("gyro_rad_s")
    )
    with pytest.raises(InputError, match="turns against its thrust"):
        pitch_log(turned, model.rig)
    swapped = changed(
        good,
        **{f"pwm{a}_us": good.column(f"pwm{b}_us") for a, b in ((1, 2), (2, 1))},
        **{f"rpm{a}": good.column(f"rpm{b}") for a, b in ((1, 2), (2, 1))},
    )
    with pytest.raises(InputError, match="swap the columns of the rotors"):
        pitch_log(swapped, model.rig)


@pytest.fixture(scope="module")
def flown():
    model = load_model("pitch_pquad").model
    return model, recorded(model, 5, seconds=12.0, inertia=model.rig.body.inertia_yy_kgm2)


@pytest.mark.parametrize("order", [(3, 1, 4, 2), (4, 2, 1, 3), (2, 1, 3, 4), (1, 3, 2, 4)])
def test_rotors_in_the_order_of_outputs_are_refused(flown, order):
    model, good = flown
    moved = {
        f"{what}{to}{unit}": good.column(f"{what}{number}{unit}")
        for to, number in enumerate(order, 1)
        for what, unit in (("pwm", "_us"), ("rpm", ""))
    }
    with pytest.raises(InputError, match=r"pwm\d_us and pwm\d_us; expected: front and rear"):
        pitch_log(changed(good, **moved), model.rig)


def test_a_gyro_on_a_compliant_part_is_a_finding_with_its_frequency(model, good):
    """The part adds a resonance at 12 Hz to the rate; slow motion agrees."""
    rate_Hz = (len(good) - 1) / float(np.ptp(good.column("time_s")))
    resonance = iirpeak(12.0, 8.0, fs=rate_Hz)
    gyro = good.column("gyro_rad_s")
    soft = changed(good, gyro_rad_s=gyro + 6.0 * lfilter(*resonance, gyro))
    (remark,) = pitch_log(soft, model.rig).remarks
    frequency_Hz = float(remark.partition(" at ")[2].split()[0])
    assert 9.0 < frequency_Hz < 13.0
