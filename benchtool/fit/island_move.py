"""Several ensembles that never meet, advanced together in one vectorised emcee move.

Each island is an ensemble of its own: a walker is stretched (Goodman and Weare, Comm. App. Math.
Comp. Sci. 5, 2010, eq. 7) along the line to a walker of the other half of its own island. Running
all islands in one call costs one evaluation of the model for each half, not one for each island.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from emcee.moves import Move
from emcee.state import State

STRETCH = 2.0
"""Scale a of the stretch move (Goodman and Weare 2010, section 3; emcee's default too)."""


class IslandStretch(Move):  # type: ignore[misc]
    """Stretch the walkers of `islands` ensembles, stored one after the other."""

    def __init__(self, islands: int) -> None:
        self.islands = islands

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        """Return the next state and which walkers moved (islands * walkers,)."""
        random = model.random
        coords, log_prob = state.coords, state.log_prob
        total, n = coords.shape
        walkers = total // self.islands
        half = walkers // 2
        first = np.arange(self.islands)[:, None] * walkers
        order = random.rand(self.islands, walkers).argsort(axis=1) + first
        halves = (order[:, :half].ravel(), order[:, half:].ravel())
        partners = random.randint(half, size=(2, half * self.islands))
        partners += np.repeat(np.arange(self.islands) * half, half)
        stretch = ((STRETCH - 1.0) * random.rand(2, half * self.islands) + 1.0) ** 2 / STRETCH
        threshold = np.log(random.rand(2, half * self.islands)) - (n - 1.0) * np.log(stretch)
        accepted = np.zeros(total, bool)
        for side in (0, 1):
            moved, others = halves[side], halves[1 - side]
            anchor = coords[others[partners[side]]]
            proposal = anchor - (anchor - coords[moved]) * stretch[side][:, None]
            proposed = model.log_prob_fn(proposal)
            taken = proposed - log_prob[moved] > threshold[side]
            winners = moved[taken]
            coords[winners] = proposal[taken]
            log_prob[winners] = proposed[taken]
            accepted[winners] = True
        return State(coords, log_prob=log_prob), accepted
