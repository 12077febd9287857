"""Evidence that is linear in four knobs and known; effect c looks nearly like b."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.explain.engine.knob import Knob

Array = np.ndarray


def knob(name: str, effect: str, *, held: bool = False) -> Knob:
    return Knob(
        name=name, unit="1", effect=effect, start=0.0, scale=1.0, lower=-50.0, upper=50.0, held=held
    )


KNOBS = (knob("a.x", "a"), knob("b.x", "b"), knob("c.x", "c"), knob("inertia", "", held=True))


@dataclass
class Linear:
    """Residuals that are linear in four knobs; c looks nearly like b."""

    truth: Array
    seed: int
    knobs: tuple[Knob, ...] = KNOBS

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.design = rng.standard_normal((400, 4))
        self.design[:, 2] = 0.995 * self.design[:, 1] + 0.1 * self.design[:, 2]
        self.noise = rng.standard_normal(400)

    def residuals(self, turned: Array) -> Array:
        """Return data minus prediction."""
        data = self.design @ self.truth + self.noise
        rows: Array = data[:, None] - self.design @ turned.T
        return rows


def quiet(what: str, share: float) -> None:
    assert 0.0 <= share <= 1.0
    assert what
