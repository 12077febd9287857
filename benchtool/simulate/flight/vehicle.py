"""A vehicle for the flight simulator, from a rig and its ground-effect model."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.physics.body_lift import BodyDistance, centre_distances_m
from benchtool.physics.mixer import mixer_matrix
from benchtool.physics.model import OWN_IMAGES, Model
from benchtool.physics.wake_rules import wake_rule
from benchtool.simulate.flight.ground import RULES, Discs
from benchtool.simulate.flight.law import Airframe
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2

FLYING_EFFECTS = ("rotor_images", "neighbour_images", "body_lift")
"""Effects of a model that the flight simulator has; others belong to a bench."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightVehicle:
    """Describe a vehicle in the air.

    Attributes:
        rig: rotors, propulsion, body.
        K_b: body lift coefficient (eq. 4); 0 leaves the body out.
        neighbours: strength of the neighbours' images; 1 as in eq. (3).
        body_distance: which b of eq. (4).
        wake_rule: how partly covered discs share the body term.
        lag_s: time constant of the motors' speed; the notes' table has none.
        drag_N_s_m: force per velocity against the air; 0 leaves wind without effect.
        turned_deg: layout turned to the left: 45 makes a plus layout a cross.
        inertia_scale: true over known inertia; the controller keeps the known one.
        undercarriage_m: how far hub and legs reach below the rotors, taken as deep everywhere under
            the discs; 0 leaves them out, as no rig file has them.
    """

    rig: Rig
    K_b: float = 2.0
    neighbours: float = 1.0
    body_distance: BodyDistance = "half_diagonal"
    wake_rule: str = "notes"
    lag_s: float = 0.0
    drag_N_s_m: float = 0.0
    turned_deg: float = 0.0
    inertia_scale: float = 1.0
    undercarriage_m: float = 0.0

    def __post_init__(self) -> None:
        wake_rule(self.wake_rule)
        for name, value, low, high in (
            ("K_b", self.K_b, 0.0, 50.0),
            ("neighbours", self.neighbours, 0.0, 10.0),
            ("lag_s", self.lag_s, 0.0, 10.0),
            ("drag_N_s_m", self.drag_N_s_m, 0.0, 1e3),
            ("turned_deg", self.turned_deg, -360.0, 360.0),
            ("inertia_scale", self.inertia_scale, 0.01, 100.0),
            ("undercarriage_m", self.undercarriage_m, 0.0, 10.0),
        ):
            if not low <= value <= high:
                raise InputError(f"{name} is {value:g}; give {low:g} to {high:g}")

    @classmethod
    def of_model(cls, model: Model) -> FlightVehicle:
        """Return the vehicle of a model's rig, with the model's ground effect."""
        parameters = model.parameters
        present = {effect.name for effect in model.present_effects}
        if others := sorted(present - set(FLYING_EFFECTS)):
            raise InputError(
                f"model {model.name!r} has the effect {others[0]!r}, which only a bench has; "
                f"leave it out of a model for flight (known: {', '.join(FLYING_EFFECTS)})"
            )
        full = f"{OWN_IMAGES}.own_strength"
        if full not in parameters or parameters[full].value != 1.0:
            raise InputError(
                f"model {model.name!r} has no eq. (2) of full strength, which a flight has; fly "
                f"a model with {full} = 1"
            )
        return cls(
            rig=model.rig,
            K_b=parameters["body_lift.K_b"].value if "body_lift" in present else 0.0,
            neighbours=(
                parameters["neighbour_images.strength"].value
                if "neighbour_images" in present
                else 0.0
            ),
            body_distance=model.body_distance,
            wake_rule=model.wake_rule,
        )

    @property
    def hover_thrust_N(self) -> float:
        """Thrust of one rotor in hover far from everything: N."""
        return self.rig.body.mass_kg * GRAVITY_M_S2 / self.rig.n_rotors

    @property
    def reach_m(self) -> float:
        """How far from the centre the discs reach: m."""
        places = self.rig.disc_positions_m
        return float(np.hypot(places[:, 0], places[:, 1]).max() + self.rig.propulsion.radius_m)

    def _turned(self, x: Array, y: Array) -> tuple[Array, Array]:
        if not self.turned_deg:
            return x, y
        c, s = cos(radians(self.turned_deg)), sin(radians(self.turned_deg))
        return c * x - s * y, s * x + c * y

    def discs(self) -> Discs:
        """Return what the aerodynamics need."""
        places = self.rig.disc_positions_m
        x, y = self._turned(places[:, 0].copy(), places[:, 1].copy())
        radius = self.rig.propulsion.radius_m
        arms = centre_distances_m(x, y, self.body_distance)
        return Discs(
            np.ascontiguousarray(np.vstack([x, y, arms, self.rig.disc_distances_m])),
            radius,
            radius,
            float(self.neighbours),
            float(self.K_b),
            RULES.index(self.wake_rule),
            float(self.undercarriage_m),
        )

    def airframe(self, *, as_known: bool = False) -> Airframe:
        """Return what the motion needs; `as_known` gives it as the controller knows it."""
        body, propulsion = self.rig.body, self.rig.propulsion
        x, y = self._turned(
            np.array([rotor.x_m for rotor in self.rig.rotors], float),
            np.array([rotor.y_m for rotor in self.rig.rotors], float),
        )
        spin = np.array([rotor.spin for rotor in self.rig.rotors], float)
        k, c = propulsion.thrust_coefficient_N_s2, propulsion.drag_coefficient_Nm_s2
        matrix = mixer_matrix(x, y, spin, k, c)
        largest = np.abs(matrix).max(axis=1, keepdims=True)
        if not largest.all() or np.linalg.matrix_rank(matrix / largest) < 4:
            raise InputError(
                f"the rotors of rig {self.rig.name!r} ({self.rig.n_rotors}) cannot make thrust and "
                f"three torques independently; fly a rig with four rotors or more"
            )
        scale = 1.0 if as_known else self.inertia_scale
        speed = propulsion.speed_per_us_rad_s * (propulsion.pwm_max_us - propulsion.pwm_start_us)
        shares = k * np.linalg.pinv(matrix)
        disc = self.rig.disc_of_rotor.astype(float)
        return Airframe(
            np.ascontiguousarray(np.column_stack([x, y, spin, disc, shares])),
            body.mass_kg,
            scale * body.inertia_xx_kgm2,
            scale * body.inertia_yy_kgm2,
            scale * body.inertia_zz_kgm2,
            k,
            c,
            speed,
            float(self.lag_s),
            float(self.drag_N_s_m),
            GRAVITY_M_S2,
        )
