"""Evidence that is linear in four parameters and known; effect c looks nearly like b."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.explain.engine.parameters import ScaledParameter

Array = np.ndarray


def parameter(name: str, effect: str, *, held: bool = False) -> ScaledParameter:
    return ScaledParameter(
        name=name, unit="1", effect=effect, start=0.0, scale=1.0, lower=-50.0, upper=50.0, held=held
    )


PARAMETERS = (
    parameter("a.x", "a"),
    parameter("b.x", "b"),
    parameter("c.x", "c"),
    parameter("inertia", "", held=True),
)


@dataclass
class Linear:
    """Residuals that are linear in four parameters; c looks nearly like b."""

    truth: Array
    seed: int
    parameters: tuple[ScaledParameter, ...] = PARAMETERS

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.design = rng.standard_normal((400, 4))
        self.design[:, 2] = 0.995 * self.design[:, 1] + 0.1 * self.design[:, 2]
        self.noise = rng.standard_normal(400)

    def residuals(self, scaled: Array) -> Array:
        """Return data minus prediction."""
        data = self.design @ self.truth + self.noise
        rows: Array = data[:, None] - self.design @ scaled.T
        return rows


def quiet(what: str, share: float) -> None:
    assert 0.0 <= share <= 1.0
    assert what
