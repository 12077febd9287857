"""Files of other makers and flight logs, read into recordings with every repair told."""

from benchtool.importers.finding import Finding
from benchtool.importers.formats import import_bytes, import_file, import_files
from benchtool.importers.imported import Imported, Tally, Window
from benchtool.importers.options import Options
from benchtool.importers.over_surface import window_told

__all__ = [
    "Finding",
    "Imported",
    "Options",
    "Tally",
    "Window",
    "import_bytes",
    "import_file",
    "import_files",
    "window_told",
]
