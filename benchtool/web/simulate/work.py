"""What the process for simulations does: an ask in, what the page shows or saves out."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile

from benchtool.web.simulate.flight_ask import FlightAsk
from benchtool.web.simulate.pitch_ask import PitchAsk
from benchtool.web.simulate.shown import Shown, shown

Ask = PitchAsk | FlightAsk


def simulated(ask: Ask, quick: bool) -> Shown:
    """Return what the browser is sent of a simulation."""
    return shown(ask.preview(quick))


def zipped(ask: Ask) -> bytes:
    """Return what the command writes with --out, as one zip file."""
    packed = BytesIO()
    with TemporaryDirectory() as kept, ZipFile(packed, "w", ZIP_DEFLATED) as archive:
        folder = Path(kept) / "simulation"
        ask.write(folder)
        for path in sorted(folder.iterdir()):
            archive.write(path, path.name)
    return packed.getvalue()
