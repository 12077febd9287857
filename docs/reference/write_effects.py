"""Write docs/reference/effects.md from the catalogue: python docs/reference/write_effects.py"""

from __future__ import annotations

from pathlib import Path

from benchtool.effects.catalogue import EFFECTS
from benchtool.effects.effect import Effect

PAGE = Path(__file__).with_name("effects.md")

HEAD = """# Effects

Every physical effect that benchtool knows, made from the catalogue by
`docs/reference/write_effects.py`. `benchtool effects NAME` prints the same. At its neutral value an
effect is exactly absent. Effects that are no candidates exist for simulation only.
"""


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD, *(section(effect) for effect in EFFECTS.values())])


def section(effect: Effect) -> str:
    """Return one effect's part of the page."""
    lines = [
        f"## {effect.name}",
        "",
        f"{effect.title}. {effect.description}",
        "",
        f"- stage: `{effect.stage}`{'' if effect.candidate else '; no candidate'}",
        f"- law: `{effect.law}`",
        f"- shows: {effect.shows}",
        f"- source: {effect.source}",
        *(f"- looks like `{other}`: {how}" for other, how in effect.confused_with.items()),
        "",
        "| parameter | unit | neutral | tolerance | what |",
        "|---|---|---|---|---|",
    ]
    for item in effect.parameters:
        neutral = "–" if item.neutral is None else f"{item.neutral:.4g}"
        tolerance = "–" if item.tolerance is None else f"{item.tolerance:.4g}"
        unit = "–" if item.unit == "1" else item.unit
        lines.append(f"| `{item.name}` | {unit} | {neutral} | {tolerance} | {item.description} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
    print(PAGE)
