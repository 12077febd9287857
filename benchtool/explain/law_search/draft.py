"""Effect file of a found law, to be checked and renamed by the user."""

from __future__ import annotations

from json import dumps
from textwrap import fill

import numpy as np

from benchtool import __version__
from benchtool.explain.law_search.law import FoundDependence, Hook
from benchtool.physics.effects.effect import Subsystem

DRAFT_NAME = "found_effect"  # name of a drafted effect and of its file
LAW_TOLERANCE = 0.1  # min tolerance as a share of the law: no law is known better
MAX_SHAPE_SD = 0.3  # of the prior: of a position in widths, of others in shares of the value


HOOKS: dict[Hook, tuple[str, Subsystem]] = {  # what a hook returns, and the stage of its effect
    "factor": ("a factor of the thrust", "rpm_to_thrust"),
    "thrust_reading": ("the reading with the law added: N", "sensor"),
    "torque": ("a torque about the hinge, positive nose down: N m", "hinge"),
    "gyro_reading": ("the reading with the law added: rad/s", "sensor"),
}

_FORM = '''"""Drafted by benchtool explain {version}: check it, and name it after its cause.

{text}
"""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.effects.laws.shapes import {functions}


@expression
def {hook}(p: Any, i: int, flow: Flow{argument}) -> Quantity:
    """Return {returns}."""
    return {code}


EFFECT = Effect(
    name="{name}",
    title="Found effect",
    description={description},
    subsystem="{subsystem}",
    order=90,
    law={formula},
    parameters=(
{numbers}
    ),
    hooks=Hooks({hook}={hook}),
    shows={shows},
    source="benchtool explain {version}: fitted, not derived",
    confused_with={{}},
    benches=frozenset({{"{bench}"}}),
    acts_in_flight=False,
)
'''


def draft_effect(dependence: FoundDependence) -> str:
    """Return the text of an effect file for a dependence with a law."""
    law, variable, form = dependence.law, dependence.variable, dependence.form
    assert law is not None
    changes = form.weights * law.family(variable.values, law.numbers)
    tolerance = form.tolerance / float(np.abs(changes).max())
    tolerance = max(tolerance, LAW_TOLERANCE * abs(law.amplitude))
    bound = max(20.0 * abs(law.amplitude), 10.0 * tolerance)
    limits = (-bound, bound)
    size = _number("a", "1", law.amplitude, "size of the law", 0.0, limits, tolerance)
    lines = [size]
    for name, value, sd in zip(law.family.numbers, law.numbers, law.sds, strict=True):
        within = (0.1 * value, 10.0 * value) if name in ("width", "length") else None
        scale = law.values.get("width", 0.5) if name == "at" else abs(value)
        prior_sd = max(min(sd, MAX_SHAPE_SD * scale), 1e-4)
        prior = f'Prior("normal", {value:.6g}, {prior_sd:.3g}, "benchtool explain")'
        lines.append(_number(name, "1", value, "shape of the law", within=within, prior=prior))
    code = form.code + variable.code
    if "p.reference" in code:
        lines.append(_number("reference", variable.unit, variable.reference, "reference"))
    if "p.radius_m" in code:
        lines.append(_number("radius_m", "m", dependence.radius_m, "radius R of the rotors"))
    if "p.typical" in code:
        lines.append(_number("typical", form.unit, float(form.weights[0]), "unit of a"))
    numbers = ", ".join(f"p.{name}" for name in law.family.numbers)
    shape = f"{law.family.name}({variable.code}, {numbers})"
    assert form.hook
    returns, subsystem = HOOKS[form.hook]
    values = ", ".join(f"{name} = {value:.4g}" for name, value in law.values.items())
    if variable.unit != "1":
        values += f"; reference: {variable.reference:.4g} {variable.unit}"
    functions = {law.family.name} | ({"power"} if "power(" in form.code else set())
    description = f"Effect that depends on {dependence.phrase}; its cause is unknown."
    return _FORM.format(
        name=DRAFT_NAME,
        version=__version__,
        text=fill(f"It {dependence.text}. Values: {values}.", 99),
        functions=", ".join(sorted(functions)),
        hook=form.hook,
        argument=", reading: Quantity" if "reading" in form.hook else "",
        returns=returns,
        code=form.code.format(f=shape),
        description=dumps(description),
        subsystem=subsystem,
        bench=form.bench,
        formula=dumps(dependence.formula),
        numbers="\n".join(lines),
        shows=dumps(f"where this differs: {dependence.phrase}"),
    )


def _number(
    name: str, unit: str, value: float, description: str, neutral: float | None = None,
    within: tuple[float, float] | None = None, tolerance: float | None = None, prior: str = "",
) -> str:  # fmt: skip
    """Return the source text of a parameter in an effect file."""
    parts = [dumps(name), dumps(unit), f"{value:.6g}", dumps(description)]
    if neutral is not None:
        parts.append(f"neutral={neutral:g}")
    if within is not None:
        parts.append(f"within=({within[0]:.6g}, {within[1]:.6g})")
    if tolerance is not None:
        parts.append(f"tolerance={tolerance:.3g}")
    if prior:
        parts.append(f"prior={prior}")
    parts.append('source="benchtool explain"')
    lines = "".join(f"            {part},\n" for part in parts)
    return f"        number(\n{lines}        ),"
