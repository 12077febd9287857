"""The beam on its hinge, as a MuJoCo model: masses, hinge, gravity and the rotors' pull.

Hub and rotors are point masses. The beam lies along x, rotor 1 at +L; a positive angle lifts it
(the hinge turns about -y). Thrust acts at each rotor along the beam's own z.
"""

from __future__ import annotations

import math

import mujoco

from tests.blind.pitch.plant import Plant
from tests.blind.pitch.sheet import SHEET, Sheet

STEP_S = 0.001
SPECK_KGM2 = 1e-9
"""Own inertia of a point mass: MuJoCo wants one above zero."""

# An impedance near one: dry friction then creeps at less than 1e-4 rad/s below its limit.
HOLD = 'solimpfriction="0.99 0.99 0.001"'

FLEX = """<joint name="flex" type="hinge" axis="0 -1 0" stiffness="{stiffness!r}"
               damping="{damping!r}"/>"""

MODEL = """
<mujoco model="pitch bench">
  <option timestep="{step!r}" integrator="Euler" gravity="0 0 -{g!r}">
    <flag contact="disable" sensor="disable"/>
  </option>
  <worldbody>
    <body name="hub">
      <joint name="hinge" type="hinge" axis="0 -1 0" damping="{damping!r}"
             stiffness="{stiffness!r}" frictionloss="{frictionloss!r}" {hold}/>
      <inertial pos="{x!r} 0 {z!r}" mass="{mass!r}" diaginertia="{own!r} {own!r} {own!r}"/>
      <body name="arms">
        {flex}
        <body name="rotor1" pos="{arm!r} 0 0">
          <inertial pos="0 0 0" mass="{rotor!r}" diaginertia="{speck!r} {speck!r} {speck!r}"/>
          <site name="rotor1"/>
        </body>
        <body name="rotor2" pos="-{arm!r} 0 0">
          <inertial pos="0 0 0" mass="{rotor!r}" diaginertia="{speck!r} {speck!r} {speck!r}"/>
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
    share = plant.flex_hub_share if plant.flexible else 0.0
    rotor = 0.5 * plant.inertia_kgm2 * (1.0 - share) / sheet.L**2
    rotor -= SPECK_KGM2 / sheet.L**2
    hub = sheet.m - 2.0 * rotor
    x, z = (sheet.m * offset / hub for offset in (plant.cog_x_m, -plant.cog_below_m))
    swung = hub * (x * x + z * z)
    if share == 0.0:
        # The hub's own eccentricity is a part of the inertia; the rotors give way for it.
        rotor -= 0.5 * (swung + SPECK_KGM2) / sheet.L**2
        own = SPECK_KGM2
    else:
        own = share * plant.inertia_kgm2 - swung
    return MODEL.format(
        step=STEP_S,
        g=sheet.g,
        damping=plant.damping_Nms,
        stiffness=plant.stiffness_Nm_per_rad,
        frictionloss=plant.friction_Nm if plant.friction_law == "constraint" else 0.0,
        hold=HOLD,
        x=x,
        z=z,
        mass=sheet.m - 2.0 * rotor,
        own=own,
        arm=sheet.L,
        rotor=rotor,
        speck=SPECK_KGM2,
        flex=FLEX.format(stiffness=plant.flex_Nm_per_rad, damping=plant.flex_damping_Nms)
        if plant.flexible
        else "",
    )


def compiled(plant: Plant) -> mujoco.MjModel:
    """Return the compiled model; a spring weaker than gravity (negative) is allowed."""
    return mujoco.MjModel.from_xml_string(model_text(plant))


def flex_frequency_Hz(plant: Plant) -> float:
    """Return the frequency at which hub and arms swing against each other."""
    hub = plant.flex_hub_share * plant.inertia_kgm2
    arms = plant.inertia_kgm2 - hub
    return math.sqrt(plant.flex_Nm_per_rad * (1.0 / hub + 1.0 / arms)) / (2.0 * math.pi)
