"""Rig of a table that describes no rig: its rotor radius only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomli_w

from benchtool.data.columns import speed_columns
from benchtool.data.formats.formats import import_file


def build_radius_rig(first: str, radius_m: float | None, *, is_stand: bool) -> str:
    """Return the text of a rig file that contains the rotor radius only.

    Without `radius_m` it is from the diameter in the test stand table; without one, return "". A
    test stand table also gives the number of rotors.
    """
    source, n_rotors = "given as the rotor radius of a table", 1
    if is_stand:
        table = import_file(first)
        n_rotors = max(1, len(speed_columns(table.recording.names, "rpm")))
        if radius_m is None and table.propeller is not None:
            radius_m = 0.5 * float(f"{table.propeller.diameter_m:.6g}")
            source = "the file's own diameter"
    if radius_m is None:
        return ""
    data: dict[str, Any] = {"name": Path(first).stem}
    if n_rotors > 1:
        # Positions have no effect without a plate; with one, a full rig file is needed.
        no_source = {"source": "not known, and without a plate of no effect"}
        data["rotors"] = [
            {"name": f"rotor {i + 1}"}
            | {key: {"value": value} | no_source
               for key, value in (("spin", 1 - 2 * (i % 2)), ("x_m", 0.0), ("y_m", 0.0))}
            for i in range(n_rotors)
        ]  # fmt: skip
    data["propulsion"] = {"source": source, "radius_m": radius_m}
    return tomli_w.dumps(data)
