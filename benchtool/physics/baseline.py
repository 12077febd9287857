"""Parameters that every model has: one rotor's thrust and radius, the inertia, the noise."""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.rig import Rig

INERTIA_KNOWN = 0.025  # default standard error over value: "known to 5 %" at two of them; assumed


def baseline_parameters(rig: Rig) -> Parameters:
    """Return k, R_m, the pitch inertia and the noise parameters at the rig's own values."""
    k_N_s2, radius_m = rig.propulsion.thrust_coefficient_N_s2, rig.propulsion.radius_m
    inertia_kgm2 = rig.body.inertia_yy_kgm2
    from_parts = "assumed: worked out from parts, 5 % for two standard errors"

    def positive(name: str, unit: str, value: float, description: str, **facts: Any) -> Parameter:
        return Parameter(name, unit, value, description=description, **{"lower": 0.0, **facts})

    def of_rig(key: str) -> str:
        return rig.sources.get(key, "")

    baseline = {
        "k": positive(
            "k", "N/(rad/s)2", k_N_s2,
            "thrust coefficient of one rotor out of ground effect (eq. 8)",
            source=of_rig("propulsion.thrust_coefficient_N_s2"),
        ),
        "R_m": positive(
            "R_m", "m", radius_m, "effective rotor radius in the image terms (eq. 2)",
            lower=0.1 * radius_m, upper=3.0 * radius_m, source=of_rig("propulsion.radius_m"),
        ),
        "inertia_kgm2": positive(
            "inertia_kgm2", "kg m2", inertia_kgm2, "moment of inertia about the pitch axis",
            prior=Prior("normal", inertia_kgm2, INERTIA_KNOWN * inertia_kgm2, from_parts),
            source=of_rig("body.inertia_yy_kgm2"),
        ),
        "noise.scale": positive(
            "scale", "1", 1.0, "factor on the stated standard errors",
            source="1: the errors are taken as stated",
        ),
        "noise.sd_N": positive(
            "sd_N", "N", 0.0, "scatter added in quadrature to the stated errors",
            source="0: nothing is added",
        ),
        "noise.place_m": positive(
            "place_m", "m", rig.place_sd_m(), "scatter of the plate's place from stay to stay",
            source=of_rig("plate.repeatability_m") or of_rig("plate.backlash_m"),
        ),
    }  # fmt: skip
    return Parameters(baseline.items())
