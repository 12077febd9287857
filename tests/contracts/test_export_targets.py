"""Targets of one export give one thrust, each by its own formula from its own file."""

from __future__ import annotations

import re
import runpy
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import benchtool as bt
from benchtool.data.propeller_file import load_propeller
from benchtool.export.targets import TARGETS
from benchtool.export.vehicle import Vehicle, build_vehicle
from tests.unit.commands.command_line import run

LOGS = (
    *(f"rcbenchmark_1520/{name}.csv" for name in (
        "a1_11", "a1_7", "b4_11", "b4_7", "c4_11", "d2_11", "e4_11", "g1_7", "h7_11", "i8_11",
        "k3_7",
    )),
    "rcbenchmark_1580/StepsTest20230624_2023-06-24_190243.csv",
    "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv",
    "rcbenchmark_1580/StepsTest_2020-06-16_214537.csv",
    "rcbenchmark_1580/xNova-SR-ramp.csv",
    "rcbenchmark_1580/xNova-SR-steps-up.csv",
    "rcbenchmark_1780/Run_0_Polar_2021-10-15_151643.csv",
)  # fmt: skip
"""Logs of motors that a thrust curve is fitted to."""

THROTTLES = np.linspace(0.1, 1.0, 10)
DEMANDS = np.linspace(0.0, 1.0, 11)


@dataclass(frozen=True)
class Exported:
    """Files of all targets, by target, and the vehicle that they were written from."""

    texts: Mapping[str, str]
    files: Mapping[str, Path]
    vehicle: Vehicle

    def thrust_N(self, throttle: np.ndarray) -> np.ndarray:
        """Return the thrust of the C header, far from any surface."""
        text, name = self.texts["c"], self.vehicle.name.upper()
        full, expo = (
            float(re.findall(rf"#define {name}_{key} (\S+)f$", text, re.MULTILINE)[0])
            for key in ("THRUST_MAX_N", "EXPO")
        )
        return full * throttle * ((1.0 - expo) + expo * throttle)

    def line(self, target: str, pattern: str) -> float:
        """Return the number that a pattern finds in a target's file."""
        return float(re.findall(pattern, self.texts[target], re.MULTILINE)[0])


@pytest.fixture(scope="module", params=["simulated", *LOGS])
def exported(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    propeller = None
    if request.param == "simulated":
        log = folder / "steps"
        bt.sweep("sim:pquad?truth=virtual_pquad", plan="steps", out=log, yes=True)
    else:
        log = request.getfixturevalue("reference_data") / request.param
        propeller = load_propeller("5x4")
        if "xNova" in request.param:  # pulls on its load cell
            turned = folder / "turned.csv"
            assert run("import", log, "--flip", "thrust_N", "--out", turned) == 0
            log = turned
    vehicle = build_vehicle(log, propeller=propeller)
    (first, *rest) = bt.export(log, "all", folder / "all", propeller="5x4" if propeller else None)
    files = dict(zip(TARGETS, (first, *rest), strict=True))
    texts = {name: path.read_text("utf-8") for name, path in files.items()}
    return Exported(texts, files, vehicle)


def test_simulators_have_one_thrust_at_every_throttle(exported):
    thrust = exported.thrust_N(THROTTLES)
    full = thrust[-1]
    # MuJoCo: gain times control; its comment says how the control goes with the throttle.
    gain = exported.line("mujoco", r'gainprm="([^"]+)"')
    e = exported.line("mujoco", r"control of throttle u: \(1 - e\) u \+ e u\^2, e = ([^;]+);")
    assert gain * ((1.0 - e) * THROTTLES + e * THROTTLES**2) == pytest.approx(thrust, rel=1e-6)
    # Gazebo and rotorpy: k w^2 up to a largest speed.
    root = ET.parse(exported.files["sdf"]).getroot()
    (plugin, *_) = root.findall("model/plugin")
    parameters = runpy.run_path(str(exported.files["rotorpy"]))["quad_params"]
    motor = exported.vehicle.motor
    assert motor is not None
    for k, top in (
        (float(plugin.findtext("motorConstant", "")), float(plugin.findtext("maxRotVelocity", ""))),
        (parameters["k_eta"], parameters["rotor_speed_max"]),
    ):
        assert k * top**2 == pytest.approx(full, rel=1e-6)
        # Speeds of the fitted law by interpolation; without measured speeds k w^2 is the law.
        grid = np.linspace(0.0, 1.5 * top, 100_001)
        law_N = k * grid**2 if motor.law is None else motor.thrust_at_speed_N(grid)
        own_speed = np.interp(thrust, law_N, grid)
        assert own_speed[-1] == pytest.approx(top, rel=1e-5)
        off = 100.0 * np.abs(k * own_speed**2 - thrust) / full
        for target in ("sdf", "rotorpy"):
            errors = re.findall(r"k w\^2 within (\S+) % of full thrust", exported.texts[target])
            stated = float(errors[0]) if errors else 0.0
            # Two digits are stated, and the largest is between ten throttles.
            assert 0.7 * stated - 1e-4 <= off.max() <= 1.06 * stated + 1e-4


def test_the_quadratic_law_of_a_header_reaches_full_thrust(exported):
    name = exported.vehicle.name.upper()
    k, top = (
        exported.line("c", rf"#define {name}_{key} (\S+)f$")
        for key in ("K_N_S2", "SPEED_MAX_RAD_S")
    )
    assert k * top**2 == pytest.approx(exported.thrust_N(np.ones(1))[0], rel=1e-6)


def test_rotors_of_px4_have_the_thrust_of_full_command(exported):
    stated = re.findall(r"\tCA_ROTOR\d+_CT\t(\S+)", exported.texts["px4"])
    assert len(stated) == (
        exported.vehicle.rig.n_rotors if exported.vehicle.rig.n_rotors > 1 else 0
    )
    for value in stated:
        assert float(value) == pytest.approx(exported.thrust_N(np.ones(1))[0], rel=1e-6)


def expo_law(expo: float) -> np.ndarray:
    """Return what ArduPilot and PX4 command between idle and full for demands."""
    if expo == 0.0:
        return DEMANDS
    return ((expo - 1.0) + np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * DEMANDS)) / (2.0 * expo)


def ardupilot(exported: Exported) -> np.ndarray:
    """Return pulses at demands: us."""
    low, high, start, end, expo = (
        exported.line("ardupilot", rf"^MOT_{key},(.+)$")
        for key in ("PWM_MIN", "PWM_MAX", "SPIN_MIN", "SPIN_MAX", "THST_EXPO")
    )
    return low + (high - low) * (start + (end - start) * expo_law(expo))


def px4(exported: Exported) -> np.ndarray:
    """Return pulses at demands: us."""
    low, high, expo = (
        exported.line("px4", rf"\t{key}\t(\S+)\t")
        for key in ("PWM_MAIN_MIN1", "PWM_MAIN_MAX1", "THR_MDL_FAC")
    )
    return low + (high - low) * expo_law(expo)


def betaflight(exported: Exported) -> np.ndarray:
    """Return pulses at demands: us."""
    low, high = (exported.line("betaflight", rf"{key} (\d+) us") for key in ("from", "to"))
    e = 0.01 * exported.line("betaflight", r"^set thrust_linear = (\d+)$")
    return low + (high - low) * DEMANDS * (
        1.0 + e * (1.0 - DEMANDS) * (1.0 + e * (1.0 - 2.0 * DEMANDS))
    )


@pytest.mark.parametrize("target", [ardupilot, px4, betaflight])
def test_thrust_goes_with_the_demand_of_an_autopilot(exported, target):
    """Between idle and full: a gain of standard deviation s is off its line by s/2 at most."""
    start_us, motor = exported.vehicle.rig.propulsion.pwm_start_us, exported.vehicle.motor
    assert motor is not None
    throttle = (target(exported) - start_us) / (motor.full.pulse_us - start_us)
    thrust = exported.thrust_N(throttle)
    full = exported.thrust_N(np.ones(1))[0]
    # Whole microseconds of PX4's and Betaflight's pulses are 0.1 % of the range.
    assert thrust[-1] == pytest.approx(full, rel=2e-3)
    straight = thrust[0] + (thrust[-1] - thrust[0]) * DEMANDS
    text = exported.texts[target.__name__]
    sd = 0.01 * float(re.findall(r"from idle to full: sd (\S+) %", text)[-1])
    assert np.abs(thrust - straight).max() <= (0.53 * sd + 0.002) * full
