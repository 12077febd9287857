"""Numbers of every model: baseline parameters, and tolerances of errors beyond its effects."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind

INERTIA_SD = 0.025  # relative standard error: 5 % at two standard errors; assumed


def baseline_parameters(rig: Rig) -> Parameters:
    """Return k, R_m, the pitch inertia and the noise parameters with the values of the rig."""
    k_N_s2, radius_m = rig.propulsion.thrust_coefficient_N_s2, rig.propulsion.radius_m
    inertia_kgm2 = rig.body.inertia_yy_kgm2
    from_parts = "assumed: computed from parts, 5 % for two standard errors"

    def positive(name: str, unit: str, value: float, description: str, **fields: Any) -> Parameter:
        return Parameter(name, unit, value, description=description, **{"lower": 0.0, **fields})

    def rig_source(key: str) -> str:
        return rig.sources.get(key, "")

    baseline = {
        "k": positive(
            "k", "N/(rad/s)2", k_N_s2,
            "thrust coefficient of one rotor out of ground effect (eq. 8)",
            source=rig_source("propulsion.thrust_coefficient_N_s2"),
        ),
        "R_m": positive(
            "R_m", "m", radius_m, "effective rotor radius in the image terms (eq. 2)",
            lower=0.1 * radius_m, upper=3.0 * radius_m, source=rig_source("propulsion.radius_m"),
        ),
        "inertia_kgm2": positive(
            "inertia_kgm2", "kg m2", inertia_kgm2, "moment of inertia about the pitch axis",
            prior=Prior("normal", inertia_kgm2, INERTIA_SD * inertia_kgm2, from_parts),
            source=rig_source("body.inertia_yy_kgm2"),
        ),
        "noise.scale": positive(
            "scale", "1", 1.0, "factor on the stated standard errors",
            source="1: standard errors as stated",
        ),
        "noise.sd_N": positive(
            "sd_N", "N", 0.0, "standard deviation added in quadrature to the stated errors",
            source="0: nothing added",
        ),
        "noise.place_m": positive(
            "place_m", "m", rig.position_sd_m(), "standard deviation of repeated plate positions",
            source=rig_source("plate.repeatability_m") or rig_source("plate.backlash_m"),
        ),
    }  # fmt: skip
    return Parameters(baseline.items())


_PITCH_ONLY = ("torque", "encoder_rad", "gyro")
_SWEEP_ONLY = ("speed_by_plate", "voltage")


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscrepancyTolerances:
    """Tolerated deviations from all laws and effects; table `[discrepancy]` of a model file."""

    thrust: float = 0.005  # relative error of thrust
    speed: float = 0.001  # relative error of rotor speed at a pulse width
    # The same, depending on the plate of a sweep: with an ESC that sets a voltage, the blades'
    # torque changes the speed by half a per cent at z/R 0.5 (blade-element momentum theory)
    speed_by_plate: float = 0.01
    voltage: float = 0.005  # relative error of a battery's voltage; discharge curves differ
    torque: float = 0.001  # error of the hinge torque over thrust times arm
    # Error of an encoder's reading; 0.2 degrees from data sheets of magnetic ones
    encoder_rad: float = 0.0035
    gyro: float = 0.01  # error of a gyro's reading over the standard deviation of its signal
    law: float = 0.1  # standard deviation of an effect's law over the contribution of the effect

    def relevant_on(self, bench: BenchKind) -> dict[str, float]:
        """Return the tolerances that apply to a kind of bench, by name."""
        excluded = {"sweep": _PITCH_ONLY, "pitch": _SWEEP_ONLY}[bench]
        names = (field.name for field in fields(self) if field.name not in excluded)
        return {name: getattr(self, name) for name in names}

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isfinite(value) and 0.0 < value <= 1.0):
                raise InputError(
                    f"discrepancy {field.name} = {value:g} is out of range; allowed: above 0, at "
                    f"most 1"
                )
