"""Write example records to a folder, one of each family.

`python -m tests.proof.blind.pitch.write_examples FOLDER`.

The truth goes to `truth.json` in the same folder: these are for looking at, not for scoring.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from tests.proof.blind.pitch.records import families, make_record, write_record


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments, write the records."""
    parser = argparse.ArgumentParser(description="Write one example record of each family.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--excitation", choices=("rich", "poor"), default="rich")
    parser.add_argument("--strength", choices=("full", "weak"), default="full")
    parser.add_argument("--dirt", choices=("dirty", "clean"), default="dirty")
    parser.add_argument("--minutes", choices=(0.5, 1.0, 2.0), type=float, default=0.5)
    parser.add_argument("--family", action="append", help="only this one; can be given again")
    given = parser.parse_args(arguments)
    try:
        write(given)
    except (ValueError, PermissionError) as error:
        parser.error(str(error))


def write(given: argparse.Namespace) -> None:
    """Write each family's record, and the truth of all of them."""
    truths = {}
    for family in given.family or families():
        record = make_record(
            given.seed,
            family,
            excitation=given.excitation,
            strength=given.strength,
            dirt=given.dirt,
            blocks=round(2 * given.minutes),
        )
        name = family.replace("+", "_and_")
        learn, _ = write_record(record, given.folder, name)
        truths[name] = record.truth.keys()
        print(learn)
    text = json.dumps(truths, indent=1)
    (given.folder / "truth.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
