"""Parameters of every model: thrust coefficient, rotor radius, inertia and noise."""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.rig import Rig

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
