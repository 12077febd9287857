"""The pitch bench as a page shows it: the beam over its plate, pitch against time."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.physics.conditions import Conditions
from benchtool.report.flight.pitch_study import (
    PitchStudy,
    pitch_study,
    table_lines,
    visit_numbers,
    warnings_of,
)
from benchtool.report.panels import spans
from benchtool.report.preview import (
    ChartLine,
    ControllerRun,
    DrawnMotion,
    SimulationPreview,
    frames,
)
from benchtool.report.side_view import Scene, Surface
from benchtool.simulate.pitch.result import PitchRun
from benchtool.simulate.pitch.setup import PitchSetup

PITCH_LABEL = "pitch [deg], nose down +"

WAY_RADII = 3.0
"""How far a plate slides in the picture, in rotor radii; the simulation has only its share."""

PARKED_M = 100.0
"""Where a parked plate is drawn: out of sight."""


def pitch_preview(setup: PitchSetup, seed: int, *, quick: bool = False) -> SimulationPreview:
    """Simulate every controller and return what a page shows.

    A quick preview has no runs without a plate, no table and few frames: half the time.
    """
    study = pitch_study(setup, seed, with_away=not quick)
    away: tuple[PitchRun | None, ...] = study.away or (None,) * len(study.runs)
    runs = tuple(
        _controller_run(study, run, far) for run, far in zip(study.runs, away, strict=True)
    )
    return SimulationPreview(
        runs=runs,
        lines=() if quick else tuple(table_lines(study)),
        warnings=() if quick else tuple(warnings_of(study)),
    )


def _controller_run(study: PitchStudy, run: PitchRun, away: PitchRun | None) -> ControllerRun:
    shown = frames(len(run.log), quick=away is None)
    time_s, reference_rad = run.time_s[shown], run.column("reference_rad")[shown]
    lines = [ChartLine(role="shown", time_s=time_s, values=_pitch_deg(run, shown))]
    if away is not None:
        lines.insert(0, ChartLine(role="away", time_s=time_s, values=_pitch_deg(away, shown)))
    if np.ptp(reference_rad) > 0.0:
        lines.insert(0, ChartLine(role="wanted", time_s=time_s, values=np.degrees(reference_rad)))
    return ControllerRun(
        label=run.controller,
        outcome=outcome_of(study, run),
        scene=_scene(study.setup),
        motion=_motion(study.setup, run, shown),
        charts={PITCH_LABEL: tuple(lines)},
        over=tuple(spans(run.time_s, run.column("plate_share") > 0.0)),
    )


def outcome_of(study: PitchStudy, run: PitchRun) -> str:
    """Say in a few words what a run came to."""
    schedule = study.setup.schedule
    visits = [visit for visit in schedule.plate if visit.in_s < schedule.duration_s]
    if not visits:
        error = run.column("true_theta_rad") - run.column("reference_rad")
        return f"RMS error {np.degrees(np.sqrt(np.mean(error**2))):.2f} deg"
    numbers = visit_numbers(run, visits[0], schedule.duration_s)
    text = (
        f"peak {np.degrees(numbers.peak_rad):.2f} deg, "
        f"stays at {np.degrees(numbers.residual_rad):.2f} deg"
    )
    return text if len(visits) == 1 else f"first plate: {text}"


def _pitch_deg(run: PitchRun, shown: slice) -> Array:
    degrees: Array = np.degrees(run.column("true_theta_rad")[shown])
    return degrees


def _motion(setup: PitchSetup, run: PitchRun, shown: slice) -> DrawnMotion:
    model, bench = setup.bench.model, setup.bench
    rig = model.rig
    share, theta_rad = run.column("plate_share")[shown], run.column("true_theta_rad")[shown]
    speed_rad_s = run.speed_rad_s[rig.disc_of_rotor][:, shown]
    here = Conditions.of(
        rig,
        speed_rad_s=speed_rad_s,
        plate_z_m=run.column("plate_z_m")[shown] / np.cos(theta_rad),  # along the rotor axis
        plate_tilt_rad=theta_rad,
        coverage=np.outer(bench.covered, share),
    )
    values = model.parameters.values_array()
    near, far = (
        np.array(
            [
                np.broadcast_to(factor, share.shape)
                for factor in model.disc_factors(model.flow(each, values), values)
            ]
        )[rig.disc_of_rotor]
        for each in (here, here.out_of_ground_effect())
    )
    alone = model.parameters["k"].value * speed_rad_s**2 / bench.hover_N
    still = np.zeros_like(share)
    return DrawnMotion(
        time_s=run.time_s[shown],
        along_m=still,
        up_m=still,
        pitch_deg=np.degrees(theta_rad),
        own=alone * far,
        added=alone * (near - far),
        shift_m=_shifts_m(setup, run.column("plate_z_m")[shown], share),
    )


def _scene(setup: PitchSetup) -> Scene:
    rig, radius_m = setup.bench.model.rig, setup.bench.model.rig.propulsion.radius_m
    arm_m = max(abs(rotor.x_m) for rotor in rig.rotors)
    centre_m, wide_m, thick_m = _plate_at_m(setup), 1.15 * radius_m, 0.08 * radius_m
    plates = [
        Surface(
            outline_m=(
                (centre_m - wide_m, -z_m),
                (centre_m + wide_m, -z_m),
                (centre_m + wide_m, -z_m - thick_m),
                (centre_m - wide_m, -z_m - thick_m),
            ),
            name=f"z/R = {z_m / radius_m:.3g}",
            moves=True,
        )
        for z_m in _distances_m(setup)
    ]
    return Scene(
        title=f"{rig.name} on its hinge, seen from its right side",
        rotors_m=tuple((rotor.x_m, rotor.y_m) for rotor in rig.rotors),
        radius_m=radius_m,
        surfaces=tuple(plates),
        hinged=True,
        width_m=2.0 * (arm_m + 1.8 * radius_m),
        top_m=0.35 * arm_m + 4.5 * radius_m,
        bottom_m=-max((*_distances_m(setup), 1.5 * radius_m)) - 1.0 * radius_m,
    )


def _distances_m(setup: PitchSetup) -> list[float]:
    """Return the plate's distances in the schedule, each once."""
    radius_m = setup.bench.model.rig.propulsion.radius_m
    return [radius_m * ratio for ratio in dict.fromkeys(v.z_over_R for v in setup.schedule.plate)]


def _plate_at_m(setup: PitchSetup) -> float:
    """Return where the plate lies along the beam: below the disc that it covers most."""
    disc = int(np.argmax(setup.bench.covered))
    return float(setup.bench.model.rig.disc_positions_m[disc, 0])


def _shifts_m(setup: PitchSetup, plate_z_m: Array, share: Array) -> Array:
    """Return how far each plate is out (n_plates, m): it comes from outside, along the beam."""
    outward = 1.0 if _plate_at_m(setup) >= 0.0 else -1.0
    way_m = WAY_RADII * setup.bench.model.rig.propulsion.radius_m
    out = np.full((len(_distances_m(setup)), len(share)), outward * PARKED_M)
    for row, z_m in zip(out, _distances_m(setup), strict=True):
        here = (share > 0.0) & np.isclose(plate_z_m, z_m)
        row[here] = outward * way_m * (1.0 - share[here])
    return out
