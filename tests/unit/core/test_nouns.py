"""Units, recordings and parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.recording import Recording
from benchtool.core.units import UNITS, from_si, to_si


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        (1000.0, "gf", 9.80665),
        (1.0, "lbf", 4.4482216),
        (60.0, "rpm", 2.0 * np.pi),
        (180.0, "deg", np.pi),
        (13.0, "in", 0.3302),
        (25.0, "degC", 298.15),
        (1.0, "kgf", 9.80665),
        (1500.0, "pwm_us", 1500.0),
        (3.0, "mm", 0.003),
    ],
)
def test_known_conversions(value, unit, si):
    assert to_si(value, unit) == pytest.approx(si, rel=1e-7)


@given(st.floats(-1e6, 1e6), st.sampled_from(sorted(UNITS)))
def test_every_unit_converts_back(value, unit):
    assert from_si(to_si(value, unit), unit) == pytest.approx(value, rel=1e-9, abs=1e-6)


def test_an_unknown_unit_is_refused():
    with pytest.raises(UnknownChoice, match="unit 'furlong'"):
        Channel("x", "furlong")


def test_a_recording_gives_columns_and_refuses_unknown_ones():
    recording = Recording.from_columns(
        [
            (Channel("rpm1", "rpm"), np.array([60.0, 120.0, 180.0])),
            (Channel("thrust_N", "N"), np.array([1.0, np.nan, 3.0])),
        ]
    )
    assert recording.to_si("rpm1") == pytest.approx([2 * np.pi, 4 * np.pi, 6 * np.pi])
    assert len(recording.select(recording.column("rpm1") > 100.0)) == 2
    assert "thrust_N" in recording
    with pytest.raises(UnknownChoice, match="channel 'thrust'; did you mean 'thrust_N'"):
        recording.column("thrust")
    with pytest.raises(InputError, match="duplicate channel"):
        recording.with_column(Channel("rpm1", "rpm"), np.zeros(3))
    with pytest.raises(InputError, match="2 channels needs a table"):
        Recording(recording.channels, np.zeros((3, 5)))


def test_parameters_pack_and_unpack_the_free_ones():
    parameters = Parameters(
        (
            ("a", Parameter("a", "m", 1.0, free=True, upper=5.0)),
            ("e.b", Parameter("b", "1", 2.0)),
            ("e.c", Parameter("c", "N", 3.0, free=True)),
        )
    )
    assert parameters.free_names == ("a", "e.c")
    moved = parameters.with_values(np.array([4.0, 6.0]))
    assert moved.values_array() == pytest.approx([4.0, 2.0, 6.0])
    assert moved.bounds()[1] == pytest.approx([5.0, np.inf])
    with pytest.raises(InputError, match="outside its bounds"):
        parameters.with_values(np.array([7.0, 6.0]))
    with pytest.raises(UnknownChoice, match=r"'e.d'"):
        parameters.with_replaced("e.d", Parameter("d", "1", 0.0))


def test_a_prior_without_width_is_refused():
    with pytest.raises(InputError, match="sd above 0"):
        Prior("normal", 1.0, 0.0)
