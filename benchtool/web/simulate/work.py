"""What the process for simulations does: an ask in, what the page shows, saves or keeps out."""

from __future__ import annotations

import shutil
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile

from benchtool.errors import WouldOverwrite
from benchtool.store.recording_file import beside
from benchtool.web.fits.work import unfinished
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


def kept(ask: Ask, out: Path) -> list[str]:
    """Write what the command writes with --out, in one step; return its recordings' file names.

    Raises:
        WouldOverwrite: something of that name exists.
    """
    aside = unfinished(out)
    shutil.rmtree(aside, ignore_errors=True)
    written = ask.write(aside)
    if out.exists():
        raise WouldOverwrite(str(out))
    aside.rename(out)
    return [path.name for path in written if beside(out / path.name).is_file()]
