"""Go over a stand's recording after it is read: time, spikes, zero, sign, dead channels, speeds."""

from __future__ import annotations

from benchtool.importers.at_rest import dead_channels, rest_doubts
from benchtool.importers.finding import Finding
from benchtool.importers.imported import Imported
from benchtool.importers.pole_count import speed_doubts
from benchtool.importers.spikes import mend_spikes
from benchtool.importers.time_order import mend_time


def inspect_stand(read: Imported) -> Imported:
    """Return the import of a stand's log with what could be mended mended and the rest doubted."""
    read = mend_spikes(mend_time(read))
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
