"""Runs on disk and tables from elsewhere."""

from benchtool.core.column_source import ColumnSource
from benchtool.store.columns import KINDS, PHASES, VALID_KINDS, channel_called, code_of, word_of
from benchtool.store.digest import data_hash
from benchtool.store.events import Event, read_events
from benchtool.store.frame import frame
from benchtool.store.pitch import read_pitch
from benchtool.store.points import Point
from benchtool.store.read import is_run, read_points, read_samples, sample_names
from benchtool.store.recording_file import read_recording, write_recording
from benchtool.store.run import Run, free_run_path, read_settings
from benchtool.store.run_rig import rig_of_data, run_rig
from benchtool.store.run_writer import RunWriter
from benchtool.store.settings import aggregate
from benchtool.store.table import Where, read_table

__all__ = [
    "KINDS",
    "PHASES",
    "VALID_KINDS",
    "ColumnSource",
    "Event",
    "Point",
    "Run",
    "RunWriter",
    "Where",
    "aggregate",
    "channel_called",
    "code_of",
    "data_hash",
    "frame",
    "free_run_path",
    "is_run",
    "read_events",
    "read_pitch",
    "read_points",
    "read_recording",
    "read_samples",
    "read_settings",
    "read_table",
    "rig_of_data",
    "run_rig",
    "sample_names",
    "word_of",
    "write_recording",
]
