"""Packaged rigs and models, and the strict reading of a user's own."""

from benchtool.library.gain_file import Gains, gain_names, gains_named
from benchtool.library.model_file import (
    LoadedModel,
    columns_to_toml,
    load_model,
    model_names,
    model_to_toml,
    read_columns,
)
from benchtool.library.rig_file import RIG_FILE, rig_beside, rig_named, rig_names, rig_to_dict
from benchtool.library.schedule_file import schedule_named, schedule_names, schedule_to_toml

__all__ = [
    "RIG_FILE",
    "Gains",
    "LoadedModel",
    "columns_to_toml",
    "gain_names",
    "gains_named",
    "load_model",
    "model_names",
    "model_to_toml",
    "read_columns",
    "rig_beside",
    "rig_named",
    "rig_names",
    "rig_to_dict",
    "schedule_named",
    "schedule_names",
    "schedule_to_toml",
]
