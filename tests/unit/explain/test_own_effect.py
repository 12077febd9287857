"""An effect of the user's own is tried beside those that ship; on a sweep nothing is compiled."""

from __future__ import annotations

from pathlib import Path

from benchtool.explain.engine.explain import explain
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.physics.catalogue import own_effects
from benchtool.physics.model_file import load_model
from tests.unit.explain.test_sweep_subject import halves

MINE = """
from benchtool.physics.effects.effect import Effect, Hooks, expression, number


@expression
def factor(p, i, flow):
    return 1.0 + p.c * (flow.speed_rad_s[i] / 500.0 - 1.0)


EFFECT = Effect(
    name="soft_blades",
    title="Soft blades",
    description="Blades that untwist under load.",
    subsystem="rpm_to_thrust",
    law="T = k w^2 (1 + c (w / 500 - 1))",
    parameters=(
        number("c", "1", 0.0, "slope", neutral=0.0, within=(-0.5, 0.5), tolerance=0.03),
    ),
    hooks=Hooks(factor=factor),
    shows="several throttle levels",
    source="a guess",
    confused_with={"thrust_exponent": "nothing but the blades' own stiffness separates them"},
    benches=frozenset({"sweep"}),
)
"""


def test_it_is_weighed_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(MINE, encoding="utf-8")
    own = own_effects(str(path), print)
    learn, check = halves("single_rotor")
    subject = SweepSubject(load_model("single").model, [learn], [check], own)
    verdict = explain(subject, draws=20, propose=False).verdict
    assert verdict.tolerances["soft_blades.c"] == 0.03
    assert "soft_blades" in verdict.probabilities
    assert "soft_blades.c" in verdict.parameters
    assert "soft_blades" not in verdict.names
