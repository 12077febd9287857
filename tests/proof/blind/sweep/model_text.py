"""The model file of a bench: what its owner believes, and what does not matter to them."""

from __future__ import annotations

from collections.abc import Collection

from tests.proof.blind.sweep.layouts import Layout
from tests.proof.blind.sweep.library import NAMED, shares


def model_text(layout: Layout, hidden: Collection[str]) -> str:
    """Return the model as TOML.

    A quadrotor's owner knows that rotors have neighbours, unless it is just that which is hidden.
    Every effect of the library stands in it at its neutral value, for its tolerance.
    """
    lines = [
        "[model]",
        f'name = "hidden_{layout.name}"',
        f'rig = "{layout.rig}"',
        'description = "A bench in which something may be hidden."',
        "",
        "[parameters]",
        f'k = {{ value = {layout.k_N_s2}, free = true, source = "rig" }}',
        f'R_m = {{ value = {layout.radius_m}, free = true, source = "rig" }}',
    ]
    # Eq. (2) is what every owner knows; the library hides what comes on top of it.
    lines += ["", "[effects.rotor_images]", 'own_strength = { value = 1.0, source = "eq. (2)" }']
    for name, effect in NAMED.items():
        if layout.name not in effect.layouts:
            continue
        lines += ["", f"[effects.{name}]"]
        values = {effect.parameter: effect.neutral} if effect.parameter else shares(1.0)
        if name == "neighbour_images" and name not in hidden:
            values = {effect.parameter: 1.0}
        for parameter, tolerance in effect.tolerances(layout).items():
            lines.append(
                f"{parameter} = {{ value = {values[parameter]!r}, tolerance = {tolerance!r}, "
                f'source = "as built" }}'
            )
    return "\n".join([*lines, ""])
