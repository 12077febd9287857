"""The beam on its hinge, as a MuJoCo model: masses, hinge, gravity and the rotors' pull.

Hub and rotors are point masses. The beam lies along x, rotor 1 at +L; a positive angle lifts it
(the hinge turns about -y). Thrust acts at each rotor along the beam's own z.
"""

from __future__ import annotations

import math

import mujoco

from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.sheet import SHEET, Sheet

STEP_S = 0.001
SPECK_KGM2 = 1e-9  # own inertia of a point mass: MuJoCo wants one above zero

# An impedance near one: dry friction then creeps at less than 1e-4 rad/s below its limit. MuJoCo's
# own time constant of 20 ms would have it answer to the rate some 10 ms ahead, and so push a beam
# that slows down quickly; two steps are the least that it allows.
HOLD = 'solreffriction="0.002 1" solimpfriction="0.99 0.99 0.001"'

FLEX = """<joint name="flex" type="hinge" axis="0 -1 0" stiffness="{flex}"
               damping="{flex_damping}"/>"""

MODEL = """
<mujoco model="pitch bench">
  <option timestep="{step}" integrator="Euler" gravity="0 0 -{g}">
    <flag contact="disable" sensor="disable"/>
  </option>
  <worldbody>
    <body name="hub">
      <joint name="hinge" type="hinge" axis="0 -1 0" damping="{damping}"
             stiffness="{stiffness}" frictionloss="{frictionloss}" HOLD/>
      <inertial pos="{x} 0 {z}" mass="{mass}" diaginertia="{own} {own} {own}"/>
      <body name="arms">
        FLEX
        <body name="rotor1" pos="{arm} 0 0">
          <inertial pos="0 0 0" mass="{rotor}" diaginertia="{speck} {speck} {speck}"/>
          <site name="rotor1"/>
        </body>
        <body name="rotor2" pos="-{arm} 0 0">
          <inertial pos="0 0 0" mass="{rotor}" diaginertia="{speck} {speck} {speck}"/>
          <site name="rotor2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor site="rotor1" gear="0 0 1 0 0 0"/>
    <motor site="rotor2" gear="0 0 1 0 0 0"/>
  </actuator>
</mujoco>
"""


def model_text(plant: Plant, sheet: Sheet = SHEET) -> str:
    """Write the bench for MuJoCo: masses placed so that inertia and centre of gravity are true."""
    rotor, x, z, own = _masses(plant, sheet)
    numbers = {
        "step": STEP_S,
        "g": sheet.g,
        "damping": plant.damping_Nms,
        "stiffness": plant.stiffness_Nm_per_rad,
        "frictionloss": plant.friction_Nm if plant.friction_law == "constraint" else 0.0,
        "x": x,
        "z": z,
        "mass": sheet.m - 2.0 * rotor,
        "own": own,
        "arm": sheet.L,
        "rotor": rotor,
        "speck": SPECK_KGM2,
        "flex": plant.flex_Nm_per_rad,
        "flex_damping": plant.flex_damping_Nms,
    }
    flex = FLEX if plant.flexible else ""
    text = MODEL.replace("FLEX", flex).replace("HOLD", HOLD)
    return text.format(**{name: f"{value:.17g}" for name, value in numbers.items()})


def _masses(plant: Plant, sheet: Sheet) -> tuple[float, float, float, float]:
    """Return a rotor's mass, the hub's place (x, z) and its own inertia.

    A stiff beam's hub is a point, and the rotors carry the inertia; a hub that swings against its
    arms has its share of it.
    """
    if plant.flexible:
        arms = (1.0 - plant.flex_hub_share) * plant.inertia_kgm2
        rotor = (0.5 * arms - SPECK_KGM2) / sheet.L**2
        hub = sheet.m - 2.0 * rotor
        x, z = (sheet.m * offset / hub for offset in (plant.cog_x_m, -plant.cog_below_m))
        return rotor, x, z, plant.flex_hub_share * plant.inertia_kgm2 - hub * (x * x + z * z)
    rotor, x, z = 0.5 * plant.inertia_kgm2 / sheet.L**2, 0.0, 0.0
    # The hub's place depends on its mass, and its swing on both: a few rounds settle it.
    for _ in range(20):
        hub = sheet.m - 2.0 * rotor
        x, z = (sheet.m * offset / hub for offset in (plant.cog_x_m, -plant.cog_below_m))
        swung = hub * (x * x + z * z) + 3.0 * SPECK_KGM2
        rotor = 0.5 * (plant.inertia_kgm2 - swung) / sheet.L**2
    return rotor, x, z, SPECK_KGM2


def compiled(plant: Plant) -> mujoco.MjModel:
    """Return the compiled model; a spring weaker than gravity (negative) is allowed."""
    return mujoco.MjModel.from_xml_string(model_text(plant))


def flex_frequency_Hz(plant: Plant) -> float:
    """Return the frequency at which hub and arms swing against each other."""
    hub = plant.flex_hub_share * plant.inertia_kgm2
    arms = plant.inertia_kgm2 - hub
    return math.sqrt(plant.flex_Nm_per_rad * (1.0 / hub + 1.0 / arms)) / (2.0 * math.pi)
