"""Replayed logs: what was recorded, the simulated run beside it, and which of the two drove it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.run.read import read_pitch
from benchtool.data.run.recording_file import read_recording
from benchtool.explain.pitch.replay import ReplayInputs, find_controller, run_replay
from benchtool.explain.pitch.replay_track import MIN_LIMIT_RAD, pitch_track, tracking_error
from benchtool.physics.model_file import load_model
from benchtool.report.replay.page import errors_deg
from benchtool.report.report_file import detect_kind, page_text
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch
from tests.unit.commands.command_line import run as call
from tests.unit.data.flight_logs import Record, dataflash
from tests.unit.report.report_text import check_self_contained, facts_of, rows_of, words_of

MODEL = "pitch_pquad"
KNOWN = {"controller": "pid", "gains": "s3"}


@pytest.fixture(scope="module")
def flown():
    """Fly 12 s with a step of the reference and the plate under rotor 1 from 6 to 9 s."""
    model = load_model(MODEL).model
    control = build_pitch_controller("pid", load_gains("s3"))
    schedule = Schedule(
        name="short",
        title="a step, then the plate",
        duration_s=12.0,
        reference_deg=(Signal(shape="step", level=5.0, from_s=2.0, to_s=4.0),),
        plate=(PlateVisit(z_over_R=1.0, in_s=6.0, out_s=9.0, move_s=0.2),),
    )
    rig = model.rig
    sampled = schedule.sampled(control.control_rate_Hz, rig.propulsion.radius_m)
    run = simulate_pitch(PitchJob(PitchBench.from_model(model), control), sampled, seed=4)
    return run.recording(rig, {"model": MODEL, **KNOWN})


@pytest.fixture(scope="module")
def log(flown, tmp_path_factory):
    """Write the same flight as an ArduPilot log, import it with its window, and return that."""
    records: list[Record] = [("PARM", (0, b"SERVO1_FUNCTION", 33.0, 0.0))]
    records += [("PARM", (0, f"SERVO{k + 1}_FUNCTION".encode(), 33.0 + k, 0.0)) for k in (1, 2, 3)]
    t = np.round(1e6 * flown.column("time_s")).astype(int)
    # Logs count nose up, in hundredths of a degree.
    pitch = np.round(-100.0 * np.degrees(flown.column("theta_rad"))).astype(int)
    wanted = np.round(-100.0 * np.degrees(flown.column("theta_ref_rad"))).astype(int)
    pulses = np.array([flown.column(f"pwm{k}_us") for k in (1, 2, 3, 4)]).astype(int)
    for row, time_us in enumerate(t.tolist()):
        at = 1_000_000 + time_us
        records.append(("ATT", (at, 0, 0, int(wanted[row]), int(pitch[row]), 0, 0)))
        records.append(("RCOU", (at + 1, *pulses[:, row].tolist())))
        gyro = -flown.column("gyro_rad_s")[row]
        records.append(("IMU", (at + 2, 0, 0.0, float(gyro), 0.0)))
    folder = tmp_path_factory.mktemp("logs")
    (folder / "42.BIN").write_bytes(dataflash(records))
    out = folder / "flight-42.csv"
    assert call("import", str(folder / "42.BIN"), "--over", "6.1:9.1:1", "--out", str(out)) == 0
    return out


def test_a_track_holds_the_flight_on_an_even_clock(flown, log):
    track = pitch_track(read_recording(log))
    assert track.rate_Hz == pytest.approx(250.0, rel=1e-3)
    assert np.allclose(np.diff(track.time_s), 1.0 / track.rate_Hz)
    own = np.interp(track.time_s, flown.column("time_s"), flown.column("theta_rad"))
    assert np.abs(track.theta_rad - own)[:-1].max() < np.radians(0.02)
    assert track.pwm_us.shape == (4, len(track))
    ((first, last),) = track.visits
    assert track.time_s[first] == pytest.approx(6.1, abs=0.01)
    assert track.time_s[last] == pytest.approx(9.1, abs=0.01)
    assert track.rotors_over(first, last) == [1]


def test_logged_pulses_drive_the_plant_to_what_was_recorded(log):
    track = pitch_track(read_recording(log))
    run, warned = run_replay(track, ReplayInputs(model=MODEL, plate_z_m=0.12), {})
    assert run is not None
    assert run.driven_by == "pulses"
    assert warned == []
    recorded, simulated = errors_deg(track, run)
    apart = np.sqrt(np.nanmean((recorded - simulated) ** 2))
    # The flight swings by 6 degrees. The wake torque that kicked it is not known, and the rate at
    # the start of a window only to a hundredth of a radian per second: 0.2 to 0.4 degrees a window.
    assert np.ptp(recorded) > 5.0
    assert apart < 0.5
    without, _ = run_replay(track, ReplayInputs(model="pitch_pquad", plate_z_m=0.99), {})
    assert without is not None
    inside = track.max_coverage > 0.0
    far = errors_deg(track, without)[1]
    assert np.sqrt(np.nanmean((recorded - far)[inside] ** 2)) > 3.0 * np.sqrt(
        np.nanmean((recorded - simulated)[inside] ** 2)
    )


def test_a_known_controller_flies_the_same_reference_and_windows(flown):
    track = pitch_track(flown)
    run, _ = run_replay(track, ReplayInputs(model=MODEL), KNOWN)
    assert run is not None
    assert run.driven_by == "controller"
    assert "controller pid with gains s3" in run.description
    recorded, simulated = errors_deg(track, run)
    # Noise of its own; the reference and the plate are the same.
    assert np.sqrt(np.nanmean((recorded - simulated) ** 2)) < 0.5
    assert np.ptp(simulated[np.isfinite(simulated)]) > 5.0
    assert run.pwm_us.shape[0] == 4
    assert abs(np.median(run.pwm_us) - np.median(track.pwm_us)) < 3.0


def test_the_page_of_an_imported_log_has_its_numbers_repairs_and_hashes(log):
    assert detect_kind(log) == "recording"
    page = page_text([log], ReplayInputs(model=MODEL, rig="pquad", plate_z_m=0.12))
    check_self_contained(page)
    text, facts = words_of(page), facts_of(page)
    assert "open loop: plant driven by logged pulses" in text
    track = pitch_track(read_recording(log))
    run, _ = run_replay(track, ReplayInputs(model=MODEL, plate_z_m=0.12), {})
    recorded, simulated = errors_deg(track, run)
    inside = track.max_coverage > 0.0
    rows = rows_of(page, "Pitch minus reference")
    for cells, part in zip(rows, (inside, ~inside), strict=True):
        for shown, errors in ((cells[2], recorded), (cells[4], simulated)):
            own = np.sqrt(np.nanmean(errors[part] ** 2))
            assert float(shown) == pytest.approx(own, abs=0.006)
    assert facts[f"sha256 of {log.name}"] == file_hash(log)
    told = json.loads(log.with_name("flight-42.csv.json").read_text())
    assert facts["sha256"] == told["provenance"]["sha256"]
    findings = rows_of(page, "Findings of the import")
    assert [cells[3] for cells in findings] == [item["words"] for item in told["findings"]]


def test_what_is_missing_is_said_and_the_log_is_drawn_all_the_same(log):
    with pytest.raises(InputError, match=r"does not say which rig .* name it with --rig"):
        page_text([log], ReplayInputs(model=MODEL, plate_z_m=0.12))
    text = words_of(page_text([log], ReplayInputs(model=MODEL, rig="pquad")))
    assert "A simulated run needs the distance to the surface" in text
    with pytest.raises(InputError, match="4 rotors, but rig 'beam'"):
        page_text([log], ReplayInputs(model="pitch_beam", rig="beam", plate_z_m=0.12))
    with pytest.raises(InputError, match="the recording has: 1, 2, 3, 4"):
        page_text([log], ReplayInputs(model=MODEL, rig="pquad", motors=(1, 2, 3, 7)))
    with pytest.raises(InputError, match="give --gains"):
        page_text([log], ReplayInputs(model=MODEL, rig="pquad", controller="pid", plate_z_m=0.12))


def test_a_run_that_does_not_follow_is_not_shown_as_a_result(log):
    good = page_text([log], ReplayInputs(model=MODEL, rig="pquad", plate_z_m=0.12))
    assert "does not follow" not in words_of(good)
    assert "simulated RMS error, over a surface" in facts_of(good)
    page = page_text(
        [log], ReplayInputs(model=MODEL, rig="pquad", plate_z_m=0.12, motors=(3, 2, 1, 4))
    )
    facts = facts_of(page)
    assert facts["simulated run"] == "deviates from the log"
    assert not [name for name in facts if "RMS" in name and "simulated" in name]


def test_how_far_a_run_may_be_from_its_log(flown):
    track = pitch_track(flown)
    swing = np.nanstd(track.theta_rad)
    mean = np.full(len(track), np.nanmean(track.theta_rad))
    assert tracking_error(track, track.time_s, track.theta_rad, "pulses") == ""
    assert (
        tracking_error(track, track.time_s, mean + 0.5 * (track.theta_rad - mean), "pulses") == ""
    )
    away = 2.0 * mean - track.theta_rad  # the same swing the opposite way: two swings away
    assert swing > MIN_LIMIT_RAD
    assert "the error of a constant" in tracking_error(track, track.time_s, away, "pulses")
    farther = mean + 1.2 * (away - mean)
    assert "the opposite motion" in tracking_error(track, track.time_s, farther, "controller")
    # A log that stands still: noise alone parts a run from it.
    still = replace(track, theta_rad=np.zeros(len(track)))
    assert (
        tracking_error(still, track.time_s, np.full(len(track), 0.9 * MIN_LIMIT_RAD), "pulses")
        == ""
    )
    assert "42.0°" in tracking_error(
        still, track.time_s, np.full(len(track), np.radians(42.0)), "pulses"
    )
    # One that keeps near on the whole, and goes for a moment where the vehicle never was.
    jump = np.zeros(len(track))
    jump[100:103] = np.radians(12.0)
    never = replace(still, reference_rad=np.zeros(len(track)))
    assert "its range is 12°" in tracking_error(never, track.time_s, jump, "pulses")
    # A miss over the surface counts, however long the rest is.
    long = replace(track, over=np.where(track.time_s < 6.2, track.over, 0.0))
    bad = np.where(long.max_coverage > 0.0, track.theta_rad + np.radians(42.0), track.theta_rad)
    assert "42.0° RMS over the surface" in tracking_error(long, track.time_s, bad, "controller")


def test_gaps_stay_blank_and_nothing_is_simulated_across_them(flown):
    time_s = flown.column("time_s")
    kept = flown.select((time_s < 3.0) | (time_s > 5.5))
    track = pitch_track(kept)
    blank = (track.time_s > 3.1) & (track.time_s < 5.4)
    assert np.isnan(track.theta_rad[blank]).all()
    run, _ = run_replay(track, ReplayInputs(model=MODEL), {})
    assert run is not None
    assert np.isnan(run.theta_rad[blank]).all()
    assert np.isfinite(run.theta_rad[~blank]).any()
    assert np.isnan(run.theta_rad[blank]).all()


def test_a_log_of_speeds_only_and_one_of_shares_are_driven_too(flown):
    names = [name for name in flown.names if not name.startswith("pwm")]
    pairs = [(flown.channels[flown.index(name)], flown.column(name)) for name in names]
    speeds = Recording.from_columns(pairs)
    run, _ = run_replay(pitch_track(speeds), ReplayInputs(model=MODEL), {})
    assert run is not None
    shares = [
        (Channel(f"motor{k}_share", "1"), (flown.column(f"pwm{k}_us") - 1000.0) / 1000.0)
        for k in (1, 2, 3, 4)
    ]
    track = pitch_track(Recording.from_columns([*pairs, *shares]))
    assert np.allclose(track.pwm_us[0], flown.column("pwm1_us")[: len(track)], atol=1e-6)
    assert "shares" in " ".join(track.remarks)


def test_the_controller_is_taken_from_the_recording_only_where_benchtool_has_it():
    assert find_controller({}, ReplayInputs()) is None
    assert find_controller({"controller": "pid"}, ReplayInputs()) is None
    assert find_controller({"controller": "mine.py:Own", "gains": "s3"}, ReplayInputs()) is None
    found = find_controller({"controller": "observer", "gains": "s3"}, ReplayInputs())
    assert found is not None
    assert found.observer
    with pytest.raises(InputError, match="pdi"):
        find_controller({}, ReplayInputs(controller="pdi", gains="s3"))


def test_a_recorded_bench_is_replayed_by_the_controller_that_it_names(tmp_path, capsys):
    run = tmp_path / "hinge"
    words = ["sim:pquad?mode=pitch&seed=3", "--seconds", "12", "--yes", "--out", str(run)]
    assert call("record", *words) == 0
    assert call("fit", str(run), "--model", MODEL) == 2
    assert "this is a pitch run, which cannot be fitted" in capsys.readouterr().err
    page = page_text([run], ReplayInputs(model=MODEL))
    facts = facts_of(page)
    assert facts["sha256 of the run's data (points and samples)"] == data_hash(run)
    track = pitch_track(read_pitch(run))
    told = np.sqrt(np.nanmean(errors_deg(track, None)[0][track.max_coverage > 0.0] ** 2))
    assert facts["RMS pitch error, over a surface"] == f"{told:.2f}°"
