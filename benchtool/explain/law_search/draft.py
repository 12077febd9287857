"""A law as an ordinary effect file, for a person to read and to rename."""

from __future__ import annotations

from json import dumps
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchtool import __version__
from benchtool.explain.law_search.law import FoundDependence, Hook
from benchtool.physics.effects.effect import Subsystem

FOUND = "found_effect"  # name of a drafted effect and of its file
OWN = 0.1  # part of a law that does not matter either: no law is better known

HELD = 0.3
"""How far a shape may be moved, one standard deviation: of a place in widths, of others in parts of
the value. What levels that were not visited leave open is not left to the next fit."""


class DraftTarget(NamedTuple):
    """Result of a hook, and the stage of an effect with it."""

    returns: str
    subsystem: Subsystem


HOOKS: dict[Hook, DraftTarget] = {
    "factor": DraftTarget("a factor of the thrust", "rpm_to_thrust"),
    "thrust_reading": DraftTarget("the reading with the law added: N", "sensor"),
    "torque": DraftTarget("a torque about the hinge, positive nose down: N m", "hinge"),
    "gyro_reading": DraftTarget("the reading with the law added: rad/s", "sensor"),
}

_FORM = '''"""Drafted by benchtool explain {version}: read it, and name it after its cause.

{words}
"""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.effects.laws.shapes import {functions}


@expression
def {hook}(p: Any, i: int, flow: Flow{taken}) -> Quantity:
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
    tolerance = form.matters / float(np.abs(changes).max())
    tolerance = max(tolerance, OWN * abs(law.amplitude))
    bound = max(20.0 * abs(law.amplitude), 10.0 * tolerance)
    lines = [
        _number(
            "a", "1", law.amplitude, "size of the law", neutral=0.0, within=(-bound, bound),
            tolerance=tolerance,
        )
    ]  # fmt: skip
    for name, value, sd in zip(law.family.numbers, law.numbers, law.sds, strict=True):
        positive = name in ("width", "length")
        reach = HELD * law.values.get("width", 0.5) if name == "at" else HELD * abs(value)
        held = max(min(sd, reach), 1e-4)
        lines.append(
            _number(
                name, "1", value, "shape of the law",
                within=(0.1 * value, 10.0 * value) if positive else None,
                prior=f'Prior("normal", {value:.6g}, {held:.3g}, "benchtool explain")',
            )
        )  # fmt: skip
    code = form.code + variable.code
    if "p.reference" in code:
        lines.append(_number("reference", variable.unit, variable.reference, "reference"))
    if "p.radius_m" in code:
        lines.append(_number("radius_m", "m", dependence.radius_m, "radius R of the rotors"))
    if "p.typical" in code:
        lines.append(_number("typical", form.unit, float(form.weights[0]), "what a counts in"))
    numbers = ", ".join(f"p.{name}" for name in law.family.numbers)
    shape = f"{law.family.name}({variable.code}, {numbers})"
    assert form.hook
    hook = HOOKS[form.hook]
    used = {law.family.name} | ({"power"} if "power(" in form.code else set())
    described = f"Something that depends on {dependence.phrase}; nobody has said what it is."
    return _FORM.format(
        name=FOUND,
        version=__version__,
        words=fill(f"It {dependence.text}. {_with(dependence)}", 99),
        functions=", ".join(sorted(used)),
        hook=form.hook,
        taken=", reading: Quantity" if "reading" in form.hook else "",
        returns=hook.returns,
        code=form.code.format(f=shape),
        description=dumps(described),
        subsystem=hook.subsystem,
        bench=form.bench,
        formula=dumps(dependence.formula),
        numbers="\n".join(lines),
        shows=dumps(f"where this differs: {dependence.phrase}"),
    )


def _with(dependence: FoundDependence) -> str:
    law, variable = dependence.law, dependence.variable
    assert law is not None
    values = ", ".join(f"{name} = {value:.4g}" for name, value in law.values.items())
    if variable.unit == "1":
        return f"There {values}."
    return f"There {values}; the reference is {variable.reference:.4g} {variable.unit}."


def _number(
    name: str, unit: str, value: float, description: str, *, neutral: float | None = None,
    within: tuple[float, float] | None = None, tolerance: float | None = None, prior: str = "",
) -> str:  # fmt: skip
    """Return the line of a number in an effect file."""
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
