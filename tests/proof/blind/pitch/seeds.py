"""Seeds for development and for scoring, kept apart."""

from __future__ import annotations

import os

DEVELOPMENT_SEEDS = range(10_000)  # for writing and tuning; whatever was looked at came from here

SCORING_SEEDS = range(1_000_000, 2_000_000)
"""For the scorecard alone; nothing is ever chosen by looking at them."""

SCORING_SWITCH = "BENCHTOOL_BLIND_SCORING"
"""Environment variable that `make blind` sets to 1; without it scoring seeds are refused."""


def checked(seed: int) -> int:
    """Return a seed that may be used here and now, or say why not."""
    if seed in DEVELOPMENT_SEEDS:
        return seed
    if seed in SCORING_SEEDS:
        if os.environ.get(SCORING_SWITCH) == "1":
            return seed
        raise PermissionError(
            f"seed {seed} is kept for scoring; run `make blind`, or take a seed below "
            f"{DEVELOPMENT_SEEDS.stop}"
        )
    raise ValueError(
        f"seed {seed} is neither for development (0 to {DEVELOPMENT_SEEDS.stop - 1}) nor for "
        f"scoring ({SCORING_SEEDS.start} to {SCORING_SEEDS.stop - 1})"
    )
