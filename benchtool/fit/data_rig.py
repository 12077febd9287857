"""Rig of the data: recorded with them or named by the user, never assumed."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.data.atomic import data_hash
from benchtool.data.run.read import fill_missing_parts, find_differences, load_rig_for_data
from benchtool.physics.model_file import model_names


def rig_for_data(data: Sequence[str], model: str, named: str | None = None) -> Rig | None:
    """Return the recorded rig, else the named one; None means the rig of a user's model file.

    A library model fits any rig, so the rig in its file is not evidence about the data. A named rig
    can add blade and motor data that the recorded rig lacks.

    Raises:
        InputError: data of two rigs, of another rig than the named one, or of an unknown rig.
    """
    recorded_rig = load_rig_for_data(data)
    if named is not None:
        named_rig = load_rig_by_name(named)
        if recorded_rig is not None and (mismatches := find_differences(recorded_rig, named_rig)):
            raise InputError(
                f"--rig {named} is not the rig that the data were recorded on ({mismatches[0]}); "
                f"omit --rig"
            )
        return named_rig if recorded_rig is None else fill_missing_parts(recorded_rig, named_rig)
    if recorded_rig is None and data and model in model_names():
        for path in data:
            data_hash(path)  # raises for a missing file
        raise InputError(
            f"{data[0]} does not say which rig it was measured on, and model {model!r} fits any "
            f"rig; name it with --rig: a library rig ({', '.join(rig_names())}) or your TOML file"
        )
    return recorded_rig
