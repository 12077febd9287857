"""benchtool reads the blind sweeps, and finds the stated truth again on a clean bench."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.points import point_columns
from benchtool.data.run.ratios import relative_speed_error
from benchtool.data.run.read import read_points
from benchtool.physics.catalogue import candidates
from benchtool.physics.conditions import Conditions
from benchtool.physics.model_file import load_model
from benchtool.physics.tolerances import model_tolerances
from tests.proof.blind.sweep.layouts import LAYOUTS
from tests.proof.blind.sweep.library import NAMED
from tests.proof.blind.sweep.records import HiddenSweep, make_record, write_record

EACH_LAYOUT = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=list(LAYOUTS))


@EACH_LAYOUT
def test_the_sheet_is_that_of_the_rig(layout):
    rig = load_rig_by_name(layout.rig)
    p = rig.propulsion
    assert layout.places_m == tuple((place.x_m, place.y_m) for place in rig.rotors)
    assert (layout.mass_kg, layout.radius_m) == (rig.body.mass_kg, p.radius_m)
    assert (layout.k_N_s2, layout.drag_Nm_s2) == (
        p.thrust_coefficient_N_s2,
        p.drag_coefficient_Nm_s2,
    )
    assert (layout.pwm_start_us, layout.gain_rad_s_us) == (p.pwm_start_us, p.speed_per_us_rad_s)
    assert (layout.nominal_V, layout.efficiency) == (p.voltage_nominal_V, p.efficiency)
    assert (layout.plate_m, layout.park_m) == (rig.plate.size_x_m, rig.plate.z_park_m)
    assert layout.full_scale_N == rig.limits.load_cell_rating_N


@EACH_LAYOUT
def test_tables_have_the_columns_of_a_run(layout, tmp_path):
    record = make_record(0, "none", excitation="rich", layout=layout.name)
    # That bench has no stage of its own to compare the plate with.
    stage = {"plate_stage_z_m", "plate_read_z_m"}
    columns = point_columns(layout.rotors)
    assert stage <= set(columns)
    # Nor does it count rejected samples, or state errors of voltage, current and torque.
    counted = {name for name in columns if name.endswith("_rejected")}
    left_out = {*stage, *counted, "suspect", "voltage_se_V", "current_se_A", "torque_se_Nm"}
    assert tuple(record.learn) == tuple(name for name in columns if name not in left_out)
    learn, check, _ = write_record(record, tmp_path)
    for path, table in ((learn, record.learn), (check, record.check)):
        visits = read_points(path)
        assert len(visits) == (table["kind"] != "tare").sum()
        tares = read_points(path, ["tare"])
        assert len(tares) == (table["kind"] == "tare").sum()
        assert np.isfinite(tares.column("thrust_N")).all()


@EACH_LAYOUT
def test_the_model_file_states_every_tolerance_and_believes_in_nothing(layout, tmp_path):
    record = make_record(0, "none", excitation="poor", layout=layout.name)
    model = load_model(write_record(record, tmp_path)[2]).model
    present = {effect.name for effect in model.present_effects}
    neighbours = {"neighbour_images"} if layout.rotors > 1 else set()
    assert present == {"rotor_images"} | neighbours
    assert {effect.name for effect in candidates("sweep")} == set(NAMED)
    stated = {
        f"{name}.{parameter}": value
        for name, effect in NAMED.items()
        if layout.name in effect.layouts
        for parameter, value in effect.tolerances(layout).items()
    }
    known = model_tolerances(model, "sweep")
    del known["rotor_images.own_strength"]  # no candidate: nobody hides eq. (2)
    assert known == pytest.approx(stated)


def found(record: HiddenSweep, folder: Path, name: str) -> tuple[dict[str, float], float]:
    """Return an effect's fitted parameters, and the root mean square residual over its errors."""
    learn, _, model_file = write_record(record, folder)
    model = load_model(model_file).model
    own = [f"{name}.{item}" for item in record.truth.effects[0].parameters]
    model = model.with_free("k", "R_m", *own)
    points = read_points(learn)
    conditions = Conditions.from_recording(points, model.rig)
    thrust = points.to_si("thrust_N")
    error = np.hypot(points.to_si("thrust_se_N"), thrust * relative_speed_error(points))
    names = list(model.parameters)
    index = [names.index(item) for item in ("k", "R_m", *own)]
    values = model.parameters.values_array()
    known = model_tolerances(model, "sweep")
    steps = np.array([0.01 * values[i] for i in index[:2]] + [known[item] for item in own])
    low, high = model.parameters.bounds()
    assert model.parameters.free_names == tuple(names[i] for i in index)
    lower, upper = (low - values[index]) / steps, (high - values[index]) / steps

    def misses(x: np.ndarray) -> np.ndarray:
        at = values.copy()
        at[index] += x * steps
        missed: np.ndarray = (model.thrust_N(conditions, at) - thrust) / error
        return missed

    start = np.clip([0.0, 0.0, *[0.3] * len(own)], lower + 1e-6, upper - 1e-6)
    fit = least_squares(misses, start, bounds=(lower, upper))
    at = values[index] + fit.x * steps
    return dict(zip(own, at[2:], strict=True)), float(np.sqrt(2.0 * fit.cost / len(thrust)))


@pytest.mark.parametrize("name", [name for name in NAMED if name != "battery_sag"])
def test_on_a_clean_bench_the_truth_is_found_again(name, tmp_path):
    """Two independent implementations of the same bench agree, to half a tolerance."""
    record = make_record(1, name, excitation="rich", dirt="clean")
    values, residual = found(record, tmp_path, name)
    assert residual < 1.25
    units = NAMED[name].tolerances(LAYOUTS[record.truth.layout])
    # Area factors between knots are ours, and each knot is seen at one or two places.
    allowed = 1.0 if name == "partial_coverage" else 0.5
    for parameter, true in record.truth.effects[0].parameters.items():
        assert abs(values[f"{name}.{parameter}"] - true) < allowed * units[parameter]
