"""Vehicles for simulators: Gazebo, MuJoCo and rotorpy.

Axes are forward, left, up, as in the rigs. What the bench does not measure (drag of the air along
the rotor, rolling moment, flapping) is 0, and its comment says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.sax.saxutils import escape

from benchtool.export.vehicle import Number, Vehicle

NOT_MEASURED = "not measured; 0 leaves it out"

ROTOR_MASS_SHARE = 1e-3
"""Mass of a rotor's link over the vehicle's: Gazebo needs one, and the rig states none. A choice
that leaves mass and inertia within 0.1 % a rotor; the body's mass is reduced by it."""


def _comment(name: str, number: Number) -> str:
    # A double hyphen would end the comment of XML.
    return f"<!-- {escape(f'{name} {number.note}').replace('--', '- -')} -->"


def _masses(vehicle: Vehicle) -> dict[str, Number]:
    found = {"mass": vehicle.of_rig("body.mass_kg", "kg")}
    for axis in ("xx", "yy", "zz"):
        found[f"i{axis}"] = vehicle.of_rig(f"body.inertia_{axis}_kgm2", "kg m^2")
    return found


def sdf(vehicle: Vehicle) -> str:
    """Return an SDF 1.9 model with one MulticopterMotorModel per rotor, for Gazebo Sim."""
    rig, masses = vehicle.rig, _masses(vehicle)
    rotor_kg = ROTOR_MASS_SHARE * masses["mass"].value
    body_kg = masses["mass"].value - rig.n_rotors * rotor_kg
    radius_m = rig.propulsion.radius_m
    lines = [
        '<?xml version="1.0"?>',
        '<sdf version="1.9">',
        f'  <model name="{vehicle.name}">',
        '    <link name="base_link">',
        "      <inertial>",
        *(f"        {_comment(name, number)}" for name, number in masses.items()),
        f"        <!-- less {rig.n_rotors} rotors of {rotor_kg:.3g} kg, a choice -->",
        f"        <mass>{body_kg:.9g}</mass>",
        "        <inertia>",
        *(f"          <i{axis}>{masses[f'i{axis}'].value:.9g}</i{axis}>"
          for axis in ("xx", "yy", "zz")),
        "          <ixy>0</ixy><ixz>0</ixz><iyz>0</iyz>",
        "        </inertia>",
        "      </inertial>",
        "    </link>",
    ]  # fmt: skip
    thin, flat = 0.25 * rotor_kg * radius_m**2, 0.5 * rotor_kg * radius_m**2
    for i, rotor in enumerate(rig.rotors):
        lines += [
            f'    <link name="rotor_{i}">',
            f"      <pose>{rotor.x_m:.9g} {rotor.y_m:.9g} 0 0 0 0</pose>",
            "      <inertial>",
            f"        <mass>{rotor_kg:.9g}</mass>",
            f"        <inertia><ixx>{thin:.9g}</ixx><iyy>{thin:.9g}</iyy><izz>{flat:.9g}</izz>"
            "<ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia>",
            "      </inertial>",
            "    </link>",
            f'    <joint name="rotor_{i}_joint" type="revolute">',
            "      <parent>base_link</parent>",
            f"      <child>rotor_{i}</child>",
            "      <axis><xyz>0 0 1</xyz>"
            "<limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>",
            "    </joint>",
        ]
    for i in range(rig.n_rotors):
        lines += [f"    {line}" for line in _motor_plugin(vehicle, i)]
    return "\n".join([*lines, "  </model>", "</sdf>"])


def _motor_plugin(vehicle: Vehicle, i: int) -> Iterator[str]:
    yield (
        '<plugin filename="gz-sim-multicopter-motor-model-system" '
        'name="gz::sim::systems::MulticopterMotorModel">'
    )
    words = {
        "robotNamespace": vehicle.name,
        "jointName": f"rotor_{i}_joint",
        "linkName": f"rotor_{i}",
        "turningDirection": "ccw" if vehicle.rig.rotors[i].spin > 0 else "cw",
        "commandSubTopic": "command/motor_speed",
        "actuator_number": str(i),
        "motorType": "velocity",
    }
    for name, word in words.items():
        yield f"  <{name}>{word}</{name}>"
    numbers = {
        "motorConstant": vehicle.k,
        "momentConstant": vehicle.torque_per_thrust,
        "maxRotVelocity": vehicle.speed_max,
        "timeConstantUp": vehicle.lag("up"),
        "timeConstantDown": vehicle.lag("down"),
        "rotorDragCoefficient": Number(0.0, "kg/rad", NOT_MEASURED),
        "rollingMomentCoefficient": Number(0.0, "kg m/rad", NOT_MEASURED),
        "rotorVelocitySlowdownSim": Number(1.0, "1", "joints turn as fast as rotors"),
    }
    for name, number in numbers.items():
        yield f"  {_comment(name, number)}"
        yield f"  <{name}>{number.value:.9g}</{name}>"
    yield "</plugin>"


def mujoco(vehicle: Vehicle) -> str:
    """Return an MJCF model: a free body with one thrust actuator per rotor.

    An actuator's control is its share of full thrust, 0 to 1, which follows with a first-order lag;
    share = (1 - e) u + e u^2 for a throttle u. MuJoCo has one time constant: that of rising thrust.
    """
    rig, masses = vehicle.rig, _masses(vehicle)
    lag, ratio, full = vehicle.lag("up"), vehicle.torque_per_thrust, vehicle.thrust_max
    inertia = " ".join(f"{masses[f'i{axis}'].value:.9g}" for axis in ("xx", "yy", "zz"))
    comments = {
        **masses,
        "gainprm: thrust of a full share,": full,
        "gear: torque over thrust,": ratio,
        "dynprm: lag of thrust,": lag,
        f"control of throttle u: (1 - e) u + e u^2, e = {vehicle.expo.value:.9g};": vehicle.expo,
    }
    lines = [
        f'<mujoco model="{vehicle.name}">',
        *(f"  {_comment(name, number)}" for name, number in comments.items()),
        '  <option timestep="0.001" integrator="RK4" gravity="0 0 -9.80665"/>',
        "  <worldbody>",
        f'    <body name="{vehicle.name}" pos="0 0 1">',
        "      <freejoint/>",
        f'      <inertial pos="0 0 0" mass="{masses["mass"].value:.9g}" diaginertia="{inertia}"/>',
        *(f'      <site name="rotor_{i}" pos="{rotor.x_m:.9g} {rotor.y_m:.9g} 0"/>'
          for i, rotor in enumerate(rig.rotors)),
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
    ]  # fmt: skip
    # A lag of 0 has no filter in MuJoCo.
    dynamics = f'dyntype="filterexact" dynprm="{lag.value:.9g}" ' if lag.value > 0.0 else ""
    for i, rotor in enumerate(rig.rotors):
        yaw_m = -rotor.spin * ratio.value
        lines.append(
            f'    <general name="rotor_{i}" site="rotor_{i}" gear="0 0 1 0 0 {yaw_m:.9g}" '
            f'{dynamics}gainprm="{full.value:.9g}" ctrllimited="true" ctrlrange="0 1"/>'
        )
    return "\n".join([*lines, "  </actuator>", "</mujoco>"])


def rotorpy(vehicle: Vehicle) -> str:
    """Return a Python module with `quad_params`, as rotorpy's vehicles are; the gains are not."""
    rig, masses = vehicle.rig, _masses(vehicle)
    c = vehicle.of_rig("propulsion.drag_coefficient_Nm_s2", "N m/(rad/s)^2")
    zero = NOT_MEASURED
    numbers: dict[str, Number] = {
        "mass": masses["mass"],
        **{f"I{axis}": masses[f"i{axis}"] for axis in ("xx", "yy", "zz")},
        **{f"I{axis}": Number(0.0, "kg m^2", "the rig states none") for axis in ("xy", "yz", "xz")},
        **{f"c_D{axis}": Number(0.0, "N/(m/s)^2", zero) for axis in "xyz"},
        "k_eta": vehicle.k,
        "k_m": c,
        "k_d": Number(0.0, "kg/rad", zero),
        "k_z": Number(0.0, "kg/rad", zero),
        "k_h": Number(0.0, "kg/m", zero),
        "k_flap": Number(0.0, "kg m/rad", zero),
        "tau_m": vehicle.lag("up"),
        "rotor_speed_min": Number(0.0, "rad/s", "standing still"),
        "rotor_speed_max": vehicle.speed_max,
        "motor_noise_std": Number(0.0, "rad/s", zero),
    }
    places = [
        f'        "r{i}": np.array([{rotor.x_m:.9g}, {rotor.y_m:.9g}, 0.0]),'
        for i, rotor in enumerate(rig.rotors, 1)
    ]
    turns = ", ".join(f"{-rotor.spin}" for rotor in rig.rotors)
    return "\n".join([
        "import numpy as np",
        "",
        "quad_params = {",
        *_entries(numbers.items()),
        f'    "num_rotors": {rig.n_rotors},',
        '    "rotor_pos": {',
        *places,
        "    },",
        "    # 1: the rotor turns the body counter-clockwise, and turns clockwise itself",
        f'    "rotor_directions": np.array([{turns}]),',
        '    "rI": np.zeros(3),',
        "    # Gains of rotorpy's own attitude loops are no property of the vehicle: tune them.",
        '    "k_w": 1.0, "k_v": 10.0, "kp_att": 544.0, "kd_att": 46.64,',
        "}",
    ])  # fmt: skip


def _entries(numbers: Iterable[tuple[str, Number]]) -> Iterator[str]:
    for name, number in numbers:
        yield f"    # {number.note}"
        yield f'    "{name}": {number.value:.9g},'
