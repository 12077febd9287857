"""Write docs/reference/effects.md from the catalogue: python docs/reference/write_effects.py"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import BENCH_KINDS, BenchKind, Effect
from benchtool.physics.tolerances import default_tolerances

PAGE = Path(__file__).with_name("effects.md")

HEAD = """# Effects

Every physical effect that benchtool knows, made from the catalogue by
`docs/reference/write_effects.py`. `benchtool library effects NAME` prints the same. At its neutral
value an effect is exactly absent. An explanation names an effect only on the benches given here;
those that are no candidates exist for simulation only.

A change within its tolerance does not matter. A model file may state tolerances of its own. Where
it states none, they go with the vehicle: torques with m g L, forces with m g, the centre of gravity
with the arm, the plate's distance with the rotor radius. The tables give them for a pitch bench of
the rig `beam` and for a plate sweep of the rig `pquad`; `benchtool library effects NAME --rig RIG`
prints them for another.

## Laws of thrust against distance

A model has one of these effects: T_IGE/T_OGE of one rotor as a function G of z/R. It enters the sum
of eqs. (2) to (4) as 1 - 1/G, so that the images of neighbours, body lift and partial coverage
combine with each as they do with eq. (2). Laws that are finite at contact are valid down to it,
the others from z/R 0.5. "Seen" is what of a source was read: a public repository, not the original,
unless the paper is named. A rig says where its surface is (`[plate] surface`): below the rotors,
above or beside them. A model has a law of that surface; images in a surface below do not act beside
a law of another. Numbers whose source is unverified are free until a model file holds them. "One
law" names the law that a row is by another parameter.
"""

RIGS: dict[BenchKind, str] = {"pitch": "beam", "sweep": "pquad"}
"""Whose tolerances the page shows, by kind of bench."""


def page() -> str:
    """Return the page."""
    parts = [HEAD, *laws(), "", *(section(effect) for effect in EFFECTS.values())]
    return "\n".join(parts)


def laws() -> Iterator[str]:
    """Return the lines of the table of laws."""
    yield "| effect | surface | T ratio | basis | infinite at z/R | far | tested | seen | one law |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for effect in EFFECTS.values():
        if (law := effect.distance_law) is None:
            continue
        formula = f"`{effect.law.removeprefix('T ratio of one rotor ')}`"
        cells = [f"`{effect.name}`", law.surface, formula, law.basis, pole(effect), law.far]
        own = f"`{law.same_as}`" if law.same_as else "–"
        yield f"| {' | '.join([*cells, law.tested, law.seen, own])} |"


def pole(effect: Effect) -> str:
    """Return where a law is infinite at its usual numbers."""
    assert effect.distance_law is not None
    if effect.distance_law.singular is None:
        return "finite at contact"
    place = effect.distance_law.singular({item.name: item.value for item in effect.parameters})
    return f"{place:.3g}"


def section(effect: Effect) -> str:
    """Return one effect's part of the page."""
    lines = [
        f"## {effect.name}",
        "",
        f"{effect.title}. {effect.description}",
        "",
        f"- stage: `{effect.subsystem}`",
        f"- candidate: {benches(effect)}",
        f"- law: `{effect.law}`",
        f"- shows: {effect.shows}",
        f"- source: {effect.source}",
        *(f"- looks like `{other}`: {how}" for other, how in effect.confused_with.items()),
        "",
        "| parameter | unit | neutral | tolerance, pitch | tolerance, sweep | what |",
        "|---|---|---|---|---|---|",
    ]
    for item in effect.parameters:
        neutral = "–" if item.neutral is None else f"{item.neutral:.4g}"
        matters = " | ".join(tolerance(effect, item.name, bench) for bench in BENCH_KINDS)
        unit = "–" if item.unit == "1" else item.unit
        lines.append(f"| `{item.name}` | {unit} | {neutral} | {matters} | {item.description} |")
    return "\n".join([*lines, ""])


def benches(effect: Effect) -> str:
    """Return where an explanation may name the effect."""
    named = [f"{bench} bench" for bench in BENCH_KINDS if bench in effect.benches]
    return " and ".join(named) or "nowhere"


def tolerance(effect: Effect, name: str, bench: BenchKind) -> str:
    """Return one tolerance on the rig that the page takes for that kind of bench."""
    if effect.benches and bench not in effect.benches:
        return "–"
    known = default_tolerances(effect, load_rig_by_name(RIGS[bench]), bench)
    return f"{known[name]:.3g}" if name in known else "–"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
    print(PAGE)
