"""A C header with the thrust near a surface, for firmware: float, no heap, no globals.

The thrust factor of any law is written as polynomials of degree 7 over pieces of z_min/z, which is
0 far away and 1 at the least distance; pieces are halved until each holds the model.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.polynomial import chebyshev

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.export.vehicle import Number, Vehicle

DEGREE = 7
TOLERANCE = 1e-7
"""Relative error of a piece: float's own rounding adds a few times 6e-8."""

MAX_PIECES = 128
"""More are a law that no polynomial follows: 128 pieces are 4 kB of constants. A choice."""


def pieces(vehicle: Vehicle) -> tuple[Array, Array]:
    """Return ends (n + 1,) of the pieces in z_min/z, and their coefficients (n, DEGREE + 1).

    Coefficients are of powers of x, -1 to 1 over a piece.

    Raises:
        InputError: the law has more pieces than `MAX_PIECES`.
    """
    nearest_m = vehicle.nearest_z_m
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    check = np.linspace(-1.0, 1.0, 33)
    ends, found = [0.0], []
    left = [(0.0, 1.0)]
    while left:
        low, high = left.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)

        def factor(x: Array, middle: float = middle, half: float = half) -> Array:
            s = np.maximum(middle + half * x, 1e-9)
            return vehicle.factor(nearest_m / s)

        series = chebyshev.chebfit(nodes, factor(nodes), DEGREE)
        truth = factor(check)
        if np.abs(chebyshev.chebval(check, series) / truth - 1.0).max() < TOLERANCE:
            ends.append(high)
            found.append(chebyshev.cheb2poly(series))
            continue
        if len(found) + len(left) + 2 > MAX_PIECES:
            raise InputError(
                f"model {vehicle.model.name!r}: its law of thrust against distance has corners "
                f"that {MAX_PIECES} polynomials do not follow; export a model with a smooth law"
            )
        left += [(middle, high), (low, middle)]
    width = DEGREE + 1
    return np.array(ends), np.array([np.pad(one, (0, width - len(one))) for one in found])


def _floats(values: Iterable[float]) -> str:
    return ", ".join(_float(value) for value in values)


def _float(value: float) -> str:
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".en") else f"{text}.0f"


def c_header(vehicle: Vehicle) -> str:
    """Return the header; its names begin with the rig's."""
    ends, coefficients = pieces(vehicle)
    name, caps = vehicle.name.lower(), vehicle.name.upper()
    constants = {
        "THRUST_MAX_N": vehicle.thrust_max,
        "EXPO": vehicle.expo,
        "K_N_S2": vehicle.k,
        "TORQUE_PER_THRUST_M": vehicle.torque_per_thrust,
        "LAG_UP_S": vehicle.lag("up"),
        "LAG_DOWN_S": vehicle.lag("down"),
        "SPEED_MAX_RAD_S": vehicle.speed_max,
        "MASS_KG": vehicle.of_rig("body.mass_kg", "kg"),
        "Z_MIN_M": Number(vehicle.nearest_z_m, "m", "below it the model is not trusted"),
    }
    model = ", ".join(
        f"{key} = {item.value:.6g} ({vehicle.parameter(key).why})"
        for key, item in vehicle.model.parameters.items()
        if not key.startswith("noise.") and (key == "R_m" or key in vehicle.intervals)
    )
    defined = [
        line
        for key, number in constants.items()
        for line in (
            f"/* {_plain(number.note)} */",
            f"#define {caps}_{key} {_float(number.value)}",
        )
    ]
    rows = ",\n".join(f"        {{{_floats(row)}}}" for row in coefficients)
    return f"""\
#ifndef {caps}_THRUST_H
#define {caps}_THRUST_H

#include <math.h>
#include <stdbool.h>

{chr(10).join(defined)}

/* Thrust near a surface over thrust far away, level, all rotors over it, at equal rotor speed.
 * z_m: distance from the rotors to the surface. Outside the model's validity: 1, *valid false.
 * Model {_plain(vehicle.model.name)}: {_plain(model)} */
static inline float {name}_ground_factor(float z_m, bool *valid)
{{
    static const float ends[{len(ends)}] = {{{_floats(ends)}}};
    static const float powers[{len(coefficients)}][{DEGREE + 1}] = {{
{rows}
    }};
    *valid = z_m >= {caps}_Z_MIN_M;
    if (!*valid) {{
        return 1.0f;
    }}
    const float s = {caps}_Z_MIN_M / z_m;
    int i = {len(coefficients) - 1};
    while (i > 0 && s < ends[i]) {{
        i--;
    }}
    const float x = (2.0f * s - ends[i] - ends[i + 1]) / (ends[i + 1] - ends[i]);
    float factor = powers[i][{DEGREE}];
    for (int power = {DEGREE - 1}; power >= 0; power--) {{
        factor = factor * x + powers[i][power];
    }}
    return factor;
}}

/* Thrust of one rotor, N, at a throttle of 0 to 1 and nominal voltage. */
static inline float {name}_thrust(float throttle, float z_m, bool *valid)
{{
    const float share = throttle * ((1.0f - {caps}_EXPO) + {caps}_EXPO * throttle);
    return {caps}_THRUST_MAX_N * share * {name}_ground_factor(z_m, valid);
}}

/* Throttle, 0 to 1, at which one rotor gives a thrust of thrust_n: the feedforward near a surface.
 * More than full thrust: 1, *valid false. */
static inline float {name}_throttle(float thrust_n, float z_m, bool *valid)
{{
    const float factor = {name}_ground_factor(z_m, valid);
    const float share = thrust_n / ({caps}_THRUST_MAX_N * factor);
    if (!(share > 0.0f)) {{
        return 0.0f;
    }}
    if (share >= 1.0f) {{
        *valid = *valid && share == 1.0f;
        return 1.0f;
    }}
    const float linear = 1.0f - {caps}_EXPO;
    return 2.0f * share / (linear + sqrtf(linear * linear + 4.0f * {caps}_EXPO * share));
}}

#endif"""


def _plain(text: str) -> str:
    """Return text that a C comment can hold."""
    return text.replace("*/", "* /").replace("\n", " ")
