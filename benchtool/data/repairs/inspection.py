"""Doubt what a recording holds, as it is after what the user told: zero, sign, dead, speeds."""

from __future__ import annotations

import re

import numpy as np

from benchtool.data.repairs.at_rest import dead_channels, rest_doubts
from benchtool.data.repairs.finding import Finding
from benchtool.data.repairs.imported import Imported
from benchtool.data.repairs.pole_count import speed_doubts


def inspect_stand(read: Imported) -> Imported:
    """Return the import of a stand's log with what could not be mended doubted."""
    recording = read.recording
    told = {name for name, source in read.sources.items() if source.startswith("constant ")}
    dead = [item for item in dead_channels(recording) if item.channel not in told]
    found = [*rest_doubts(recording), *dead, *speed_doubts(recording)]
    if len(recording) == 1:
        words = "one row is no measurement series; nothing can be held against it"
        found.append(Finding("doubt", "single row", words, count=1))
    if "rpm1" not in recording and not any(item.what == "rpm" for item in read.findings):
        found.append(Finding("lacks", "rpm", "no speed stands in the file"))
    return read.with_findings(found)


def inspect_log(read: Imported) -> Imported:
    """Return the import of a flight log with its channels doubted."""
    recording = read.recording
    turned = [
        name
        for name in recording.names
        if re.fullmatch(r"rpm\d+", name) and np.any(np.nan_to_num(recording.column(name)) < 0.0)
    ]
    found = dead_channels(recording)
    if turned:
        words = "negative speeds, as ESCs tell the sense of rotation, are left as they are"
        found.insert(0, Finding("doubt", "sign", words, ", ".join(turned)))
    return read.with_findings(found)
