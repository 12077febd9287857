"""Every quantity against a hand computation, its error against the closed formula."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from math import hypot, isnan, pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.air import relative_density_sd
from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.rig import Motor, Propeller, Sensor
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.derived import (
    DATA_SHEET_SD,
    UNMEASURED_DENSITY_SD,
    QuantityValues,
    derive_quantities,
    measurement_context,
)
from benchtool.data.quantities import QUANTITIES
from benchtool.data.run.points import average_settings, settings_quantities
from benchtool.data.run.read import read_points

ROOT = Path(__file__).parents[3]

RPM, THRUST_N, TORQUE_NM, VOLTAGE_V, CURRENT_A = 6000.0, 8.0, 0.12, 14.8, 7.0
DIAMETER_M, CHORD_M = 0.254, 0.0258
PROPELLER = Propeller(name="10x7", diameter_m=DIAMETER_M, blades=2, chord_m=CHORD_M)
RHO = 1.16
AIR = {
    "temperature_degC": 25.0, "pressure_Pa": 1e5, "humidity": 0.5, "density_kg_m3": RHO,
    "measured": True,
}  # fmt: skip

BY_HAND = {
    "power_W": 103.6,  # 14.8 * 7
    "mechanical_power_W": 75.39822,  # 0.12 * 628.31853
    "efficiency_N_W": 0.0772201,  # 8/103.6
    "efficiency_gf_W": 7.874259,  # 0.0772201/0.00980665
    "motor_efficiency": 0.727782,  # 75.39822/103.6
    "propeller_efficiency_N_W": 0.1061033,  # 8/75.39822
    "ct": 0.165690,  # 8/(1.16 * 100^2 * 0.254^4): 8/48.28285
    "cp": 0.0614801,  # 75.39822/(1.16 * 100^3 * 0.254^5): 75.39822/1226.384
    "figure_of_merit": 0.875287,  # 0.7978846 * 0.165690^1.5/0.0614801
    "tip_mach": 0.230527,  # 79.79645/sqrt(1.4 * 287.05287 * 298.15): 79.79645/346.1484
    "reynolds_75": 97489.5,  # 0.87 * 79.79645 * 0.0258/1.837234e-5
}


def table(**columns: float | list[float]) -> Recording:
    """Return a recording of these columns."""
    return Recording.from_columns(
        [(Channel(name, unit_from_name(name)), np.atleast_1d(v)) for name, v in columns.items()]
    )


ROW = {
    "thrust_N": THRUST_N, "torque_Nm": TORQUE_NM, "voltage_V": VOLTAGE_V, "current_A": CURRENT_A,
    "rpm1": RPM,
}  # fmt: skip
ERRORS = {
    "thrust_se_N": 0.02, "torque_se_Nm": 6e-4, "voltage_se_V": 0.01, "current_se_A": 0.03,
    "rpm1_se": 4.0,
}  # fmt: skip


def derive(recording: Recording, **inputs: object) -> dict[str, QuantityValues]:
    """Return the derived quantities by name."""
    facts = measurement_context(PROPELLER, AIR) if not inputs else measurement_context(**inputs)  # type: ignore[arg-type]
    return {item.name: item for item in derive_quantities(recording, facts)}


@pytest.mark.parametrize("name", BY_HAND)
def test_a_quantity_is_what_a_hand_computes(name):
    assert derive(table(**ROW))[name].value[0] == pytest.approx(BY_HAND[name], rel=2e-5)


def test_every_quantity_of_the_table_is_checked_by_hand():
    assert {item.name for item in QUANTITIES} == {*BY_HAND, "torque_Nm"}


def test_torque_of_a_data_sheet_is_the_winding_current_over_kv():
    motor = Motor(Kv_rpm_V=900.0, resistance_ohm=0.1, no_load_current_A=0.6)
    row = {key: value for key, value in ROW.items() if key != "torque_Nm"}
    rig = replace(load_rig_by_name("pquad_single"), motor=motor, sensors={})
    got = derive(table(**row), propeller=PROPELLER, air=AIR, rig=rig)
    # (6.66667 + 0.1 I) I = 103.6 W has I = 13.00359 A;
    # (13.00359 - 0.6) A * 0.01061033 V s = 0.131606 N m.
    assert got["torque_Nm"].value[0] == pytest.approx(0.131606, rel=1e-5)
    assert got["mechanical_power_W"].value[0] == pytest.approx(0.131606 * RPM * pi / 30.0, rel=1e-5)
    assert "data sheet" in got["cp"].origin
    assert "data sheet" not in got["ct"].origin
    kv = next(item for item in got["torque_Nm"].error_sources if item.name == "Kv of the motor")
    assert kv.sd == DATA_SHEET_SD * 900.0
    assert "data sheet" in kv.origin


def test_own_errors_are_those_of_the_closed_formulae():
    got = derive(table(**ROW, **ERRORS))
    t, q, n = 0.02 / THRUST_N, 6e-4 / TORQUE_NM, 4.0 / RPM
    power = hypot(0.01 / VOLTAGE_V, 0.03 / CURRENT_A)
    relative = {
        "power_W": power, "mechanical_power_W": hypot(q, n), "efficiency_N_W": hypot(t, power),
        "motor_efficiency": hypot(q, n, power), "propeller_efficiency_N_W": hypot(t, q, n),
        "ct": hypot(t, 2 * n), "cp": hypot(q, 2 * n), "tip_mach": n, "reynolds_75": n,
        # C_T^1.5/C_P = T^1.5/(Q n^3/n^2...): n^-3 from C_T^1.5 and n^2 from C_P leave n^-1.
        "figure_of_merit": hypot(1.5 * t, q, n),
    }  # fmt: skip
    for name, expected in relative.items():
        item = got[name]
        assert item.standard_error[0] / item.value[0] == pytest.approx(expected, rel=1e-3), name


def test_shared_errors_of_air_and_geometry_are_counted_once_in_each():
    loose = Propeller(name="loose", diameter_m=DIAMETER_M, chord_m=CHORD_M, diameter_sd=0.004)
    got = derive(table(**ROW, **ERRORS), propeller=loose, air=None)

    def shares(name: str) -> dict[str, float]:
        item = got[name]
        return {s.name: abs(float(s.columns[0, 0])) / item.value[0] for s in item.error_sources}

    d, rho = 0.004, UNMEASURED_DENSITY_SD
    assert shares("ct") == pytest.approx({"diameter": 4 * d, "air density": rho}, rel=2e-3)
    assert shares("cp") == pytest.approx({"diameter": 5 * d, "air density": rho}, rel=2e-3)
    # C_T^1.5/C_P: D^-6 D^5 and rho^-1.5 rho.
    assert shares("figure_of_merit") == pytest.approx(
        {"diameter": d, "air density": rho / 2}, rel=3e-3
    )
    assert shares("power_W") == {}
    total = got["ct"].total_error[0] / got["ct"].value[0]
    random_u = got["ct"].standard_error[0] / got["ct"].value[0]
    assert total == pytest.approx(hypot(random_u, 4 * d, rho), rel=2e-3)


def test_an_error_that_nobody_states_is_nan_and_no_small_number():
    inputs = {key: value for key, value in ERRORS.items() if key != "current_se_A"}
    got = derive(table(**ROW, **inputs))
    assert isnan(got["power_W"].total_error[0])
    assert isnan(got["efficiency_N_W"].total_error[0])
    assert np.isfinite(got["ct"].total_error[0])


def test_of_several_rotors_squares_and_cubes_are_summed_and_torque_is_left_out():
    row = {**ROW, "rpm1": 6000.0, "rpm2": 3000.0}
    got = derive(table(**row))
    by_hand = THRUST_N / (RHO * (100.0**2 + 50.0**2) * DIAMETER_M**4)
    assert got["ct"].value[0] == pytest.approx(by_hand)
    assert got["tip_mach"].value[0] == pytest.approx(BY_HAND["tip_mach"], rel=2e-4)
    assert not {"torque_Nm", "cp", "mechanical_power_W"} & set(got)


def test_a_rotor_at_rest_has_no_coefficient_and_nothing_warns():
    got = derive(table(**{key: [value, 0.0] for key, value in ROW.items()}))
    assert np.isfinite(got["ct"].value[0])
    assert isnan(got["ct"].value[1])
    assert isnan(got["efficiency_N_W"].value[1])


def test_means_of_visits_take_the_scatter_where_it_is_larger():
    columns = {key: [value] * 4 for key, value in {**ROW, **ERRORS}.items()}
    columns["thrust_N"] = [8.0, 8.4, 8.0, 8.002]
    ct = derive(table(**columns))["ct"]
    means = ct.averaged(np.array([1.0, 1.0, 2.0, 2.0]))
    assert means.value == pytest.approx([ct.value[:2].mean(), ct.value[2:].mean()])
    assert means.standard_error[0] == pytest.approx(ct.value[:2].std(ddof=1) / sqrt(2.0))
    assert means.standard_error[1] == pytest.approx(hypot(*ct.standard_error[2:]) / 2.0)
    share = ct.error_sources[0].columns[0, 0]
    assert means.error_sources[0].columns[1, 0] == pytest.approx(share, rel=2e-3)


def edited_run(folder: Path, **changes: dict[str, object]) -> Path:
    """Return a copy of the shipped run of a quadrotor with other facts."""
    run = folder / "run"
    shutil.copytree(ROOT / "datasets" / "quad" / "run", run)
    facts = json.loads((run / "metadata.json").read_text())
    for table, values in changes.items():
        facts[table] = {**(facts[table] or {}), **values}
    (run / "metadata.json").write_text(json.dumps(facts))
    return run


def test_a_run_takes_diameter_air_and_chord_from_its_facts(tmp_path):
    geometry = {"name": "9.4x5", "diameter_m": 0.24, "chord_m": 0.02}
    run = edited_run(tmp_path, rig={"propeller": geometry}, air={"measured": True})
    points = read_points(run, ["measure", "reference"])
    got = {item.name: item for item in settings_quantities(run, points)}
    settings = average_settings(points)
    assert len(got["ct"].value) == len(settings)
    n2 = sum((settings.column(f"rpm{rotor}") / 60.0) ** 2 for rotor in range(1, 5))
    by_hand = settings.column("thrust_N") / (1.225521289 * n2 * 0.24**4)
    assert got["ct"].value == pytest.approx(by_hand, rel=2e-4)  # a mean of quotients
    assert "reynolds_75" in got
    assert "cp" not in got  # four rotors
    density = next(item for item in got["ct"].error_sources if item.name == "air density")
    assert density.origin == "measured air"
    assert density.sd == pytest.approx(1.2255 * relative_density_sd(15.0, 101325.0, 0.0), rel=1e-4)


def test_a_calibration_takes_the_place_of_the_rig_s_scale():
    cal = {"id": "cal-1", "relative_sd": 0.004}
    rig = replace(load_rig_by_name("pquad_single"), sensors={"thrust_N": Sensor(scale_sd=0.05)})
    for calibration, sd in ((None, 0.05), (cal, cal["relative_sd"])):
        got = measurement_context(PROPELLER, AIR, rig=rig, calibration=calibration)
        quantities = derive_quantities(table(**ROW, **ERRORS), got)
        ct = next(item for item in quantities if item.name == "ct")
        scale = next(item for item in ct.error_sources if item.name == "thrust scale")
        assert abs(scale.columns[0, 0]) / ct.value[0] == pytest.approx(sd)


def test_the_wander_of_the_zero_since_its_tare_is_in_the_error_of_thrust():
    cell = {"thrust_N": Sensor(walk=0.004)}
    rig = replace(load_rig_by_name("pquad_single"), sensors=cell)
    row = {**ROW, **ERRORS, "elapsed_s": 100.0}
    context = measurement_context(PROPELLER, AIR, rig=rig)
    ct = next(item for item in derive_quantities(table(**row), context) if item.name == "ct")
    thrust = hypot(0.02, 0.004 * 10.0)  # a random walk of 4 mN after 1 s has 40 mN after 100 s
    expected = hypot(thrust / THRUST_N, 2.0 * 4.0 / RPM)
    assert ct.standard_error[0] / ct.value[0] == pytest.approx(expected, rel=1e-3)
