"""Count on outside families of sweeps how often `explain` finds what they depend on, and a law.

python -m tests.blind.score_found 210-215
"""

from __future__ import annotations

import sys

from tests.blind.score_sweep import verdict_on
from tests.blind.scored import share_of
from tests.blind.sweep.records import make_record

DEPENDS = {
    "recirculation": ("wash", "load over"),
    "flutter_step": ("rotor speed",),
    "stage_backlash": ("from where the plate came",),
    "cell_saturation": ("load on the cell",),
    "cell_creep": ("load over", "since the tare", "since the plate moved"),
    "stand_resonance": ("rotor speed",),
    "warming_blades": ("load over", "since the run began"),
    "bending_plate": ("near the plate", "next to the plate", "plate distance"),
}
"""What each family depends on, in words of an answer; any of them counts."""

CLOSED = 0.7
"""Share of the held-out gap that a law should close."""


def found_on(family: str, seed: int) -> tuple[bool, bool]:
    """Return whether the right variable was found, and a law that closes enough."""
    found = verdict_on(make_record(seed, family, excitation="rich"))[0].verdict.depends
    if found is None or not any(words in found.phrase for words in DEPENDS[family]):
        return False, False
    return True, found.law is not None and found.closed >= CLOSED


def main(seeds: str) -> None:
    """Print counts with Wilson intervals."""
    first, _, last = seeds.partition("-")
    for family in DEPENDS:
        found = [found_on(family, seed) for seed in range(int(first), int(last or first) + 1)]
        for words, one in zip(
            ("right variable", "law closes 70 %"), zip(*found, strict=True), strict=True
        ):
            print(f"{family}, {words}: {share_of(one)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
