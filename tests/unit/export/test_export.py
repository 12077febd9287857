"""Exports, each read by the real thing or its parser where one can be had, or worked out again."""

from __future__ import annotations

import ctypes
import re
import runpy
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from pymavlink.mavparm import MAVParmDict

import benchtool as bt
from benchtool.core.errors import InputError, WouldOverwrite
from benchtool.export.targets import DEFAULT_IDLE_SHARE, TARGETS
from benchtool.export.vehicle import Vehicle, build_vehicle
from tests.unit.commands.command_line import run

THROTTLES = np.linspace(0.05, 1.0, 20)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Export a quadrotor fitted to data that come with benchtool, a motor test of one rotor."""
    folder = tmp_path_factory.mktemp("export")
    bench = "sim:pquad_single?truth=virtual_pquad_single"
    runs = [bt.sweep(bench, plan=name, out=folder / name, yes=True) for name in MOTOR_TEST]
    assert (
        run("fit", "datasets/quad/run", "--model", "quad_body_lift", "--out", folder / "fit") == 0
    )
    bt.export(folder / "fit", "all", folder / "all", motor=runs)
    return folder


MOTOR_TEST = ("steps", "response")


@pytest.fixture(scope="module")
def vehicle(exported):
    return build_vehicle(exported / "fit", tuple(exported / name for name in MOTOR_TEST))


def test_mujoco_gives_the_thrust_of_twenty_throttles(exported, vehicle):
    model = mujoco.MjModel.from_xml_path(str(exported / "all" / "pquad.xml"))
    assert model.body_mass.sum() == pytest.approx(vehicle.rig.body.mass_kg)
    for throttle in THROTTLES:
        data = mujoco.MjData(model)
        data.ctrl[:] = vehicle.thrust_N(throttle) / vehicle.thrust_max.value
        for _ in range(800):  # 16 time constants of the lag
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        each = data.qfrc_actuator[2] / 4
        # The body's own z: it has not turned, for its rotors are alike.
        assert each == pytest.approx(float(vehicle.thrust_N(throttle)), rel=0.01)


def test_mujoco_turns_the_body_against_a_rotor(exported, vehicle):
    model = mujoco.MjModel.from_xml_path(str(exported / "all" / "pquad.xml"))
    for i, rotor in enumerate(vehicle.rig.rotors):
        data = mujoco.MjData(model)
        data.act[i] = 1.0
        mujoco.mj_forward(model, data)
        thrust = vehicle.thrust_max.value
        c = vehicle.rig.propulsion.drag_coefficient_Nm_s2
        torque = (
            rotor.y_m * thrust,
            -rotor.x_m * thrust,
            -rotor.spin * c * thrust / vehicle.k.value,
        )
        assert data.qfrc_actuator[3:] == pytest.approx(torque, rel=1e-6)


def test_rotorpy_gives_the_thrust_of_twenty_throttles(exported, vehicle):
    from rotorpy.vehicles.multirotor import Multirotor

    parameters = runpy.run_path(str(exported / "all" / "pquad_params.py"))["quad_params"]
    body = Multirotor(parameters, control_abstraction="cmd_motor_speeds")
    state: dict[str, Any] = {
        "x": np.zeros(3), "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3), "wind": np.zeros(3),
    }  # fmt: skip
    for throttle in THROTTLES:
        wanted = float(vehicle.thrust_N(throttle))
        state["rotor_speeds"] = np.full(4, np.sqrt(wanted / vehicle.k.value))
        rates = body.statedot(state, {"cmd_motor_speeds": state["rotor_speeds"]}, 0.01)
        each = parameters["mass"] * (rates["vdot"][2] + 9.81) / 4
        assert each == pytest.approx(wanted, rel=0.01)
        assert rates["wdot"] == pytest.approx(np.zeros(3), abs=1e-9)
    faster = state["rotor_speeds"].copy()
    faster[0] += 10.0
    rates = body.statedot(state | {"rotor_speeds": faster}, {"cmd_motor_speeds": faster}, 0.01)
    assert rates["wdot"][2] * vehicle.rig.rotors[0].spin < 0.0  # the body turns the other way


DEMANDS = np.linspace(0.0, 1.0, 1001)


def gain_sd(thrust_N: np.ndarray) -> float:
    """Return the scatter of dT/d(demand) over its mean: the criterion of ArduPilot's tool."""
    gain = np.diff(thrust_N)
    return float(gain.std() / gain.mean())


def ardupilot_pulse_us(parameters: Any, expo: float) -> np.ndarray:
    """Return what thrust_to_actuator and output_to_pwm of ArduPilot make of demands."""
    ratio = DEMANDS
    if expo != 0.0:
        root = np.sqrt((1.0 - expo) * (1.0 - expo) + 4.0 * expo * DEMANDS)
        ratio = np.clip(((expo - 1.0) + root) / (2.0 * expo), 0.0, 1.0)
    spin_min, spin_max = parameters["MOT_SPIN_MIN"], parameters["MOT_SPIN_MAX"]
    actuator = spin_min + (spin_max - spin_min) * ratio
    least, most = parameters["MOT_PWM_MIN"], parameters["MOT_PWM_MAX"]
    return np.asarray(least + (most - least) * actuator)


def thrust_at(pulse_us: np.ndarray, vehicle: Vehicle) -> np.ndarray:
    start_us = vehicle.rig.propulsion.pwm_start_us
    assert vehicle.motor is not None
    return vehicle.thrust_N((pulse_us - start_us) / (vehicle.motor.full.pulse_us - start_us))


def test_ardupilot_reads_its_parameters(exported, vehicle):
    found = MAVParmDict()
    assert found.load(str(exported / "all" / "pquad.param"), use_excludes=False)
    assert found["MOT_PWM_MIN"] == 1000.0
    assert found["MOT_PWM_MAX"] == 1950.0
    assert vehicle.motor is not None
    full_us = float(vehicle.motor.points.pulse_us.max())  # 1950 us is too far beyond it
    assert found["MOT_SPIN_MAX"] == pytest.approx((full_us - 1000.0) / 950.0, rel=1e-4)
    idle_us = 1050.0 + DEFAULT_IDLE_SHARE * (full_us - 1050.0)
    assert found["MOT_SPIN_MIN"] == pytest.approx((idle_us - 1000.0) / 950.0, rel=1e-4)
    assert found["MOT_BAT_VOLT_MAX"] == pytest.approx(11.1)
    hover = 1.4 * 9.80665 / 4 / vehicle.thrust_max.value
    assert found["MOT_THST_HOVER"] == pytest.approx(hover, rel=1e-4)
    # ArduPilot's tool: the expo of the least scatter, from -1 to 1 in its steps.
    tried = np.round(np.arange(-1.0, 1.0025, 0.005), 3)
    scatter = [gain_sd(thrust_at(ardupilot_pulse_us(found, expo), vehicle)) for expo in tried]
    by_tool = float(tried[int(np.argmin(scatter))])
    assert found["MOT_THST_EXPO"] == pytest.approx(by_tool, abs=1e-6)
    assert gain_sd(thrust_at(ardupilot_pulse_us(found, by_tool), vehicle)) < 0.002


def with_expo(vehicle: Vehicle, expo: float) -> Vehicle:
    motor = vehicle.motor
    assert motor is not None
    estimates = [replace(one, value=expo) if one.name == "expo" else one for one in motor.estimates]
    return replace(vehicle, motor=replace(motor, estimates=tuple(estimates)))


def written_expo(vehicle: Vehicle) -> tuple[str, float]:
    """Return the comment of MOT_THST_EXPO and its value."""
    head, _, rest = TARGETS["ardupilot"].text(vehicle).partition("\nMOT_THST_EXPO,")
    return head.rpartition("\n")[2], float(rest.partition("\n")[0])


@pytest.mark.parametrize("expo", [0.2, 0.59, 0.9])
def test_a_parabola_is_inverted_exactly(vehicle, expo):
    """Over throttles from idle it is a parabola again, whose e has a closed form."""
    span = 1.0 - DEFAULT_IDLE_SHARE
    exact = expo * span / (1.0 - expo + 2.0 * expo * DEFAULT_IDLE_SHARE + expo * span)
    assert written_expo(with_expo(vehicle, expo))[1] == pytest.approx(exact, abs=0.0026)


def test_px4_takes_the_file_of_a_ground_station(exported, vehicle):
    rows = [
        line.split("\t")
        for line in (exported / "all" / "pquad.params").read_text("utf-8").splitlines()
        if not line.startswith("#")
    ]
    assert all(row[:2] == ["1", "1"] and len(row) == 5 for row in rows)
    assert all(len(row[2]) <= 16 for row in rows)  # PARAM_VALUE.param_id
    found = {row[2]: float(row[3]) for row in rows}
    kinds = {row[2]: row[4] for row in rows}
    assert kinds["CA_ROTOR_COUNT"] == kinds["PWM_MAIN_MIN1"] == "6"
    assert kinds["THR_MDL_FAC"] == "9"
    for i, rotor in enumerate(vehicle.rig.rotors):
        # Forward and right; a positive moment is a rotor that turns counter-clockwise.
        assert (found[f"CA_ROTOR{i}_PX"], found[f"CA_ROTOR{i}_PY"]) == (rotor.x_m, -rotor.y_m)
        moment = rotor.spin * 1.6e-7 / vehicle.k.value
        assert found[f"CA_ROTOR{i}_KM"] == pytest.approx(moment)
    # FunctionMotors::updateValues, and the range of the output.
    factor, (least, most) = found["THR_MDL_FAC"], (found["PWM_MAIN_MIN1"], found["PWM_MAIN_MAX1"])

    def thrust(factor: float) -> np.ndarray:
        half = (1.0 - factor) / (2.0 * factor)
        command = -half + np.sqrt(half * half + DEMANDS / factor)
        return thrust_at(least + command * (most - least), vehicle)

    assert gain_sd(thrust(factor)) < min(gain_sd(thrust(factor + step)) for step in (-0.01, 0.01))
    assert gain_sd(thrust(factor)) < 0.01  # whole microseconds of the range


def test_betaflight_makes_thrust_linear(exported, vehicle):
    text = (exported / "all" / "pquad.cli.txt").read_text("utf-8")
    before, now = map(int, re.findall(r"^(?:# )?set thrust_linear = (\d+)$", text, re.MULTILINE))

    def of_2026_6(percent: int) -> np.ndarray:
        e, inv = 0.01 * percent, 1.0 - DEMANDS
        return np.asarray(DEMANDS * (1.0 + e * inv * (1.0 + e * (inv - DEMANDS))))

    def of_4_3(percent: int) -> np.ndarray:
        return np.asarray(DEMANDS * (1.0 + 0.01 * percent * (1.0 - DEMANDS) ** 2))

    # The cubic halves the scatter at best: it does nothing at full demand.
    for percent, law, share in ((before, of_4_3, 0.5), (now, of_2026_6, 0.4)):

        def scatter(percent: int, law: Callable[[int], np.ndarray] = law) -> float:
            return gain_sd(
                vehicle.thrust_N(DEFAULT_IDLE_SHARE + (1.0 - DEFAULT_IDLE_SHARE) * law(percent))
            )

        assert scatter(percent) == min(map(scatter, range(151)))
        assert scatter(percent) < share * scatter(0)
    assert now < before
    # The later curve is a series of ArduPilot's in small expos: 100 of one are 1 of the other.
    mild = with_expo(vehicle, 0.4)
    written = float(re.findall(r"\nset thrust_linear = (.+)", TARGETS["betaflight"].text(mild))[0])
    assert written == pytest.approx(100.0 * written_expo(mild)[1], abs=2.0)
    assert text.index("4.3 to 2025.12") < text.index("2026.6 and later")
    assert text.endswith("save\n")


@pytest.fixture(scope="module")
def compiled(exported):
    if shutil.which("gcc") is None:
        pytest.skip("no C compiler: install gcc")
    folder = exported / "all"
    names = ("ground_factor", "thrust", "throttle")
    calls = "\n".join(
        f"float {name}({head}float z, bool *valid) {{ return pquad_{name}({tail}z, valid); }}"
        for name, head, tail in zip(
            names, ("", "float a, ", "float a, "), ("", "a, ", "a, "), strict=True
        )
    )
    prototypes = "\n".join(
        f"float {name}({head}float z, bool *valid);"
        for name, head in zip(names, ("", "float a, ", "float a, "), strict=True)
    )
    source = folder / "caller.c"
    source.write_text(f'#include "pquad.h"\n{prototypes}\n{calls}\n', "utf-8")
    library = folder / "caller.so"
    subprocess.run(
        ["gcc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wconversion",
         "-Werror", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"],
        check=True,
    )  # fmt: skip
    loaded = ctypes.CDLL(str(library))
    for name in names:
        getattr(loaded, name).restype = ctypes.c_float
    return loaded


def call(function: Any, *values: float) -> tuple[float, bool]:
    valid = ctypes.c_bool()
    found = function(*(ctypes.c_float(value) for value in values), ctypes.byref(valid))
    return float(found), valid.value


def test_the_header_holds_the_model(compiled, vehicle):
    z = np.float32(np.geomspace(vehicle.nearest_z_m * 1.0001, 30.0, 2000)).astype(float)
    found = [call(compiled.ground_factor, each) for each in z]
    assert all(valid for _, valid in found)
    off = np.array([one for one, _ in found]) / vehicle.factor(z) - 1.0
    assert np.abs(off).max() < 1e-6
    assert call(compiled.ground_factor, vehicle.nearest_z_m * 0.99) == (1.0, False)
    assert call(compiled.ground_factor, float("nan")) == (1.0, False)
    assert call(compiled.ground_factor, float("inf"))[0] == pytest.approx(1.0, abs=1e-6)


def test_the_header_finds_the_throttle_of_a_thrust(compiled, vehicle):
    for throttle in THROTTLES:
        thrust, valid = call(compiled.thrust, throttle, 0.2)
        assert valid
        wanted = vehicle.thrust_N(throttle) * vehicle.factor(np.array([0.2]))[0]
        assert thrust == pytest.approx(float(wanted), rel=1e-5)
        assert call(compiled.throttle, thrust, 0.2)[0] == pytest.approx(throttle, rel=1e-5)
    assert call(compiled.throttle, 1e3, 0.2) == (1.0, False)
    assert call(compiled.throttle, -1.0, 0.2) == (0.0, True)


@pytest.mark.parametrize("target", TARGETS)
def test_numbers_have_their_interval_or_source(exported, target):
    name = TARGETS[target].file.format(name="pquad")
    text = (exported / "all" / name).read_text("utf-8")
    assert "SIMULATED" in text
    assert "95 %:" in text
    assert "motor test steps, response" in text


def test_the_motor_command_names_the_export(exported, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(exported)
    assert run("motor", "steps", "response") == 0
    command = capsys.readouterr().out.splitlines()[-1].partition(": benchtool ")[2]
    assert command == "export steps --motor response --to all"
    assert run(*command.split(), "--out", tmp_path / "all") == 0
    assert len(list((tmp_path / "all").iterdir())) == len(TARGETS)


def test_a_fit_that_its_data_rejected_is_not_exported(exported, tmp_path):
    folder = tmp_path / "fit"
    shutil.copytree(exported / "fit", folder)
    model = folder / "model.toml"
    with model.open("a", encoding="utf-8") as file:
        file.write('\n[provenance]\nrejected = "chi2/dof 9"\n')
    with pytest.raises(InputError, match="rejected by its data"):
        bt.export(folder, "c", tmp_path / "x.h")


def test_nothing_is_overwritten(exported):
    for to, out in (("all", "all"), ("c", "all/pquad.h")):
        with pytest.raises(WouldOverwrite, match="choose another name with --out, or delete it"):
            bt.export("single", to, exported / out)


def test_a_motor_test_of_other_pulses_is_refused(exported, tmp_path, monkeypatch):
    rig = (Path(bt.__file__).parent / "library/rigs/pquad_single.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(rig.replace("1950.0", "1900.0"), "utf-8")
    (tmp_path / "model.toml").write_text('[model]\nname = "mine"\nrig = "mine.toml"\n', "utf-8")
    with pytest.raises(InputError, match="name the run instead"):
        bt.export(tmp_path / "model.toml", "c", tmp_path / "x.h", motor=exported / "steps")
