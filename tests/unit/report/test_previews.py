"""What a page shows of a simulation is what the command's own functions give."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sqrt

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.report.flight.flight import fly_each, table_lines
from benchtool.report.flight.pitch_study import pitch_study
from benchtool.report.flight.pitch_study import table_lines as pitch_lines
from benchtool.report.flight_preview import flight_preview
from benchtool.report.pitch_preview import PITCH_LABEL, pitch_preview
from benchtool.report.preview import FRAMES, QUICK_FRAMES, frames
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.setup import PitchSetup, changed, pitch_setup


def short_pitch(**names: str) -> PitchSetup:
    setup = pitch_setup(controllers=("pid", "observer"), **names)
    return replace(setup, schedule=setup.schedule.lasting(13.0))


def flight(case: str, **numbers: float) -> FlightSetup:
    vehicle = FlightVehicle.of_rig(rig_named("pquad"))
    return FlightSetup(
        case=case, vehicle=vehicle, gains=gains_named("s3"), duration_s=13.0, **numbers
    )


def test_the_pitch_preview_has_the_numbers_of_the_study() -> None:
    setup = short_pitch()
    preview, study = pitch_preview(setup, 3), pitch_study(setup, 3)
    assert preview.lines == tuple(pitch_lines(study))
    assert [run.label for run in preview.runs] == ["pid", "observer"]
    run = preview.runs[0]
    assert [line.role for line in run.charts[PITCH_LABEL]] == ["away", "shown"]
    theta_deg = np.degrees(study.runs[0].column("true_theta_rad"))
    assert run.motion.pitch_deg.min() == pytest.approx(theta_deg.min(), abs=0.02)
    assert run.over == ((pytest.approx(10.0, abs=0.02), pytest.approx(13.0, abs=0.02)),)
    assert run.outcome.startswith("peak -1.")


def test_the_covered_rotor_alone_gains_thrust_and_only_while_the_plate_is_there() -> None:
    motion = pitch_preview(changed(short_pitch(), {"plate.z_over_R": 1.0}), 1).runs[0].motion
    there = motion.time_s > 10.6
    assert np.all(np.abs(motion.added[:, motion.time_s < 10.0]) < 1e-12)
    # Eq. (2) for the front rotor, whose height follows from the pitch.
    theta_rad = np.radians(motion.pitch_deg[there])
    height_m = 0.12 - 0.225 * np.sin(theta_rad)
    factor = 1.0 / (1.0 - np.cos(theta_rad) * (0.12 / (4.0 * height_m)) ** 2)
    assert motion.added[0, there] / motion.own[0, there] == pytest.approx(factor - 1.0, rel=1e-6)
    assert np.all(np.abs(motion.added[1:, there]) < 1e-12)


def test_the_plate_slides_in_from_outside() -> None:
    motion = pitch_preview(short_pitch(), 1).runs[0].motion
    shift_m = motion.shift_m[0]
    assert shift_m[0] > 10.0
    assert shift_m[-1] == 0.0
    assert np.all(np.diff(shift_m) <= 0.0)


def test_a_quick_preview_has_the_same_lines_but_no_table() -> None:
    quick, whole = (pitch_preview(short_pitch(), 1, quick=each) for each in (True, False))
    assert quick.lines == ()
    assert [line.role for line in quick.runs[0].charts[PITCH_LABEL]] == ["shown"]
    few, many = (each.runs[1].motion for each in (quick, whole))
    assert len(few.time_s) < len(many.time_s)
    _, at, where = np.intersect1d(few.time_s, many.time_s, return_indices=True)
    assert len(at) > 50
    assert np.array_equal(few.pitch_deg[at], many.pitch_deg[where])


def test_the_flight_preview_has_the_numbers_of_the_flights() -> None:
    setup = flight("edge", speed_m_s=1.0)
    preview = flight_preview(setup, ["pid", "observer"], 1)
    flights = fly_each(setup.flown("pid", 1), ["pid", "observer"])
    assert preview.lines == tuple(table_lines(flights))
    motion = preview.runs[0].motion
    flown = flights[1].flight
    assert motion.along_m[-1] == pytest.approx(flown["x_m"][-1], abs=0.05)
    assert motion.added[0].max() > 0.005


@pytest.mark.parametrize("case", ["over", "corner", "gust"])
def test_a_quick_flight_differs_from_the_whole_by_less_than_a_screen_shows(case: str) -> None:
    setup = replace(flight(case), duration_s=30.0)
    quick, whole = (
        flight_preview(setup, ["pid", "feedforward"], 1, quick=each) for each in (True, False)
    )
    for rough, fine in zip(quick.runs, whole.runs, strict=True):
        assert rough.outcome == fine.outcome
        few, many = rough.motion, fine.motion
        _, at, where = np.intersect1d(few.time_s, many.time_s, return_indices=True)
        assert len(at) > 50
        assert np.abs(few.along_m[at] - many.along_m[where]).max() < 1e-3
        assert np.abs(few.pitch_deg[at] - many.pitch_deg[where]).max() < 0.03


def test_a_quick_flight_takes_no_step_that_its_motors_cannot_follow() -> None:
    setup = flight("edge")
    slow = replace(setup, vehicle=setup.vehicle.with_numbers(lag_s=0.003))
    quick, whole = (flight_preview(slow, ["pid"], 1, quick=each) for each in (True, False))
    few, many = (each.runs[0].motion for each in (quick, whole))
    _, at, where = np.intersect1d(few.time_s, many.time_s, return_indices=True)
    assert len(at) > 50
    assert np.abs(few.along_m[at] - many.along_m[where]).max() < 1e-3


@pytest.mark.parametrize(
    ("case", "near_m", "far_m"),
    [
        ("edge", 3.0, 5.0),
        ("oblique", 3.0 / cos(radians(35.0)), 5.0 / cos(radians(35.0))),
        ("corner", 2.0 * sqrt(2.0), None),
    ],
)
def test_the_picture_is_cut_along_the_heading(
    case: str, near_m: float, far_m: float | None
) -> None:
    (surface,) = flight_preview(flight(case), ["pid"], 1, quick=True).runs[0].scene.surfaces
    along = [s for s, _ in surface.outline_m]
    assert min(along) == pytest.approx(near_m)
    assert far_m is None or max(along) == pytest.approx(far_m)


def test_a_ramp_rises_and_a_plate_comes() -> None:
    ramp = flight_preview(flight("ramp"), ["pid"], 1, quick=True).runs[0].scene.surfaces[0]
    assert ramp.outline_m[:2] == ((2.0, pytest.approx(-0.3)), (3.0, pytest.approx(0.0)))
    plate = flight_preview(flight("plate"), ["pid"], 1, quick=True).runs[0]
    assert plate.scene.surfaces[0].moves
    assert plate.motion.shift_m[0][[0, -1]] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("rows", [1, QUICK_FRAMES, FRAMES, FRAMES + 1, 12345])
def test_frames_are_few_and_begin_at_the_first_row(rows: int, quick: bool) -> None:
    kept = np.arange(rows)[frames(rows, quick)]
    assert kept[0] == 0
    assert len(kept) <= (QUICK_FRAMES if quick else FRAMES)
