"""Count on outside families how often `explain` finds what they depend on, and a law.

python -m tests.proof.blind.score_found pitch 210-215
"""

from __future__ import annotations

import sys

from benchtool.core.errors import InputError
from benchtool.explain.result import Explanation
from tests.proof.blind import score_pitch, score_sweep
from tests.proof.blind.pitch import records as pitch
from tests.proof.blind.scored import share_of
from tests.proof.blind.sweep import records as sweep

DEPENDS = {  # what each family depends on, in words of an answer; any of them counts
    "sweep": {
        "recirculation": ("wash", "load over"),
        "flutter_step": ("rotor speed",),
        "stage_backlash": ("from where the plate came",),
        "cell_saturation": ("load on the cell",),
        "cell_creep": ("load over", "since the tare", "since the plate moved"),
        "stand_resonance": ("rotor speed",),
        "warming_blades": ("load over", "since the run began"),
        "bending_plate": ("near the plate", "next to the plate", "plate distance"),
    },
    "pitch": {
        "stribeck_hysteresis": ("the rate",),
        "arm_flexure": ("speed changes", "the rate"),
        "encoder_backlash": ("the rate", "encoder's reading"),
        "esc_steps": ("rotor speed", "thrust of all rotors"),
        "thrust_lean": ("speed changes",),
        "shifting_load": ("since the run began",),
        "rubber_bumper": ("the angle",),
        "drag_vane": ("the rate",),
        "fading_rotor": ("since the run began",),
        "flutter_band": ("rotor speed",),
        "jet_from_plate": ("plate distance",),
    },
}

LAWLESS = ("arm_flexure", "encoder_backlash", "esc_steps", "thrust_lean")
"""Families of which no effect file can hold a law: memory, an encoder, what no hook sees."""

CLOSED = 0.7  # share of the held-out gap that a law should close


def _explained(bench: str, family: str, seed: int) -> Explanation:
    if bench == "sweep":
        record = sweep.make_record(seed, family, excitation="rich")
        return score_sweep.verdict_on(record)[0]
    measured = pitch.make_record(seed, family, excitation="rich")
    return score_pitch.verdict_on(measured)[0]


def found_on(bench: str, family: str, seed: int) -> tuple[bool, bool]:
    """Return whether the right variable was found, and a law that closes enough."""
    try:
        found = _explained(bench, family, seed).depends
    except InputError:  # a record that no verdict can stand on
        return False, False
    if found is None or not any(words in found.phrase for words in DEPENDS[bench][family]):
        return False, False
    return True, found.law is not None and found.closed >= CLOSED


def main(bench: str, seeds: str, *families: str) -> None:
    """Print counts with Wilson intervals."""
    first, _, last = seeds.partition("-")
    for family in families or DEPENDS[bench]:
        found = [
            found_on(bench, family, seed) for seed in range(int(first), int(last or first) + 1)
        ]
        for words, one in zip(
            ("right variable", "law closes 70 %"), zip(*found, strict=True), strict=True
        ):
            print(f"{family}, {words}: {share_of(one)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
