"""Write docs/reference/quantities.md from the table: python docs/reference/write_quantities.py"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchtool.core.channel import error_channel_name
from benchtool.data.derived import DATA_SHEET_SD, LABELS, UNMEASURED_DENSITY_SD, UNMEASURED_K
from benchtool.data.quantities import QUANTITIES, Quantity

PAGE = Path(__file__).with_name("quantities.md")

HEAD = """# Quantities

What benchtool works out from what a bench measures, made from its table by
`docs/reference/write_quantities.py`. The report page of a sweep draws and lists them, and
`settings.csv` and every exported table of points or settings holds them, and so do the data frames
of [Python](python.md) and the page on which runs are
[compared](../how-to/fit.md#motors-and-propellers).

- Only what the bench allows appears: without a torque cell there is no C_P, without current no
  efficiency, without a blade's chord no Reynolds number. Chord and diameter come from a
  [propeller](../how-to/fit.md#propellers), the diameter of a run from its rig.
- Each states its origin: measured, from which channels, by the motor's data sheet (`[motor]` of
  the [rig](rig-file.md)), or as the file of another maker states it. A column that a stand wrote
  goes before our own computation of it.
- The torque of a stand with several rotors is a sum in which they cancel: nothing is worked out
  from it.
- What a repair of an import changes is worked out anew: the stand's own columns that follow from
  the repaired channel are left out, with a finding.

"""

STATED = (
    ("input", "standard uncertainty"),
    ("---", "---"),
    (
        "thrust, torque, voltage, current, rpm of a visit",
        "the standard error of its mean; noise and step of the rig's sensor where a run lacks it; "
        "of thrust also the wander of the zero since its tare",
    ),
    ("their scales", "`scale_sd` of the rig's sensor; of thrust the calibration's"),
    (
        "measured air",
        "uniform within 1 degC, 2 hPa and 20 % of humidity, as in the "
        "[uncertainty budget](../explanation/uncertainty.md)",
    ),
    (
        "air that nobody measured",
        f"standard air; {100 * UNMEASURED_DENSITY_SD:g} % of density, {UNMEASURED_K:g} K (guesses)",
    ),
    ("density that `import --air-density` states", "none"),
    ("diameter, chord", "`diameter_sd`, `chord_sd` of the propeller file"),
    (
        "Kv, resistance and no-load current of a data sheet",
        f"{100 * DATA_SHEET_SD:g} % each (a guess)",
    ),
)
ERROR_ROWS = "\n".join(f"| {name} | {sd} |" for name, sd in STATED)

ERRORS = f"""
## Standard errors

The column of an error has `se` before its unit: `{error_channel_name("efficiency_N_W")}`.
Every input is changed by its standard uncertainty in both directions and every result recomputed
(JCGM 100:2008, 5.1.3 note 2), so errors shared by two inputs are counted as correlated.

{ERROR_ROWS}

The report lists for each quantity what is its own at each row and what all rows share
({", ".join(LABELS.values())}, scales). An input of which nobody states an error leaves the result
without one: cells of samples and of most imported logs are empty.
"""


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD.rstrip(), "", *table()]) + "\n" + ERRORS


def table() -> Iterator[str]:
    """Give the lines of the table."""
    yield "| column | symbol | unit | quantity | formula | needs |"
    yield "|---|---|---|---|---|---|"
    for one in QUANTITIES:
        unit = "–" if one.unit == "1" else one.unit
        needs = ", ".join(f"`{name}`" for name in one.needs)
        row = (f"`{one.name}`", one.symbol, unit, one.title, f"`{one.formula}`", needs)
        yield f"| {' | '.join(row)} |"
    yield ""
    yield from (f"- {one.symbol}: {source(one)}." for one in QUANTITIES if one.source)


def source(one: Quantity) -> str:
    """Return the source of a quantity, with its name."""
    return f"{one.title}, {one.source}"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
    print(PAGE)
