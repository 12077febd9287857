"""The rig that data are held against: their own, or the one that the user names; never assumed."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.data.atomic import data_hash
from benchtool.data.run.run_rig import differences, load_rig_for_data, with_blades_of
from benchtool.physics.model_file import model_names


def rig_for_data(data: Sequence[str], model: str, named: str | None = None) -> Rig | None:
    """Return the rig of data: their own, else the one named; None for that of a user's model file.

    A shipped model fits any rig, so the one in its file says nothing about the data. A rig that is
    named may add blades and motors to one that does not say what they are.

    Raises:
        InputError: data of two rigs, of another rig than the one named, or of none that is known.
    """
    own = load_rig_for_data(data)
    if named is not None:
        given = load_rig_by_name(named)
        if own is not None and (different := differences(own, given)):
            raise InputError(
                f"--rig {named} is not the rig that the data were recorded on ({different[0]}), "
                f"and theirs is taken; leave --rig out"
            )
        return given if own is None else with_blades_of(own, given)
    if own is None and data and model in model_names():
        for path in data:
            data_hash(path)  # what is no file is reported as that
        raise InputError(
            f"{data[0]} does not say which rig it was measured on, and model {model!r} fits any: "
            f"name it with --rig, a shipped one ({', '.join(rig_names())}) or the TOML file of "
            f"your own"
        )
    return own
