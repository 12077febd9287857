"""What the process for simulations does: inputs in, what the page shows, saves or downloads out."""

from __future__ import annotations

from dataclasses import fields
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from benchtool.core.inputs import changed, words
from benchtool.data.atomic import written_whole
from benchtool.data.run.recording_file import beside
from benchtool.report.palette import BLUE, GREEN, GREY, VERMILION
from benchtool.report.preview import ChartLine, DrawnMotion, Role, SimulationPreview
from benchtool.report.side_view import side_view_svg
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import setup_of as flight_setup_of
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import setup_of as pitch_setup_of

Shown = dict[str, Any]
"""What goes to the browser: plain values and arrays of 32 bits."""

LOOKS: dict[Role, dict[str, Any]] = {
    "shown": {"name": "with the surface", "color": VERMILION, "width": 2.2, "dash": "solid"},
    "away": {"name": "out of ground effect", "color": BLUE, "width": 1.6, "dash": "solid"},
    "wanted": {"name": "commanded", "color": GREY, "width": 1.4, "dash": "dashed"},
    "goal": {"name": "goal", "color": GREEN, "width": 1.4, "dash": "dotted"},
}
"""Lines of the charts, as the figures of pitch have them."""

STEPS = 3
"""About how many steps an axis has; a choice."""

LEAST = 0.1
"""Least width of an axis, in its unit: what moves less lies still. A choice."""


DECIMALS = {"up_m": 4, "along_m": 4, "added": 4, "values": 4}
"""Of what moves and of curves; 3 for what is not listed."""


def shown(preview: SimulationPreview) -> Shown:
    """Return what the browser is sent."""
    return {
        "lanes": [
            {
                "label": run.label,
                "said": run.outcome,
                "svg": side_view_svg(run.scene),
                "motion": _short(run.motion),
                "panels": [[_short(line) for line in lines] for lines in run.charts.values()],
                "over": [list(span) for span in run.over],
            }
            for run in preview.runs
        ],
        "panels": [
            {"label": label, "range": _range([run.charts[label] for run in preview.runs])}
            for label in preview.runs[0].charts
        ],
        "looks": LOOKS,
        "end_s": float(np.ceil(max(run.motion.time_s[-1] for run in preview.runs))),
        "lines": list(preview.lines),
        "warnings": list(preview.warnings),
    }


def _short(drawn: DrawnMotion | ChartLine) -> Shown:
    """Return the arrays with few characters a number; a browser's screen has no more digits."""
    found: Shown = {}
    for part in fields(drawn):
        value, decimals = getattr(drawn, part.name), DECIMALS.get(part.name, 3)
        if isinstance(value, np.ndarray):
            rows = np.round(value, decimals).astype(np.float32)
            found[part.name] = list(rows) if rows.ndim > 1 else rows
        else:
            found[part.name] = value
    return found


def _range(runs: list[tuple[ChartLine, ...]]) -> tuple[float, float, float]:
    """Return the ends of an axis on which every lane's curves lie, and the step of its marks."""
    every = np.concatenate([curve.values for lines in runs for curve in lines])
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 0.0)
    wide = max(high - low, LEAST)
    rough = wide / STEPS
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(power * next(mark for mark in (1.0, 2.0, 5.0, 10.0) if mark >= rough / power))
    decimals = max(0, int(-np.floor(np.log10(step))))
    first, last = np.floor(low / step), np.ceil(high / step)
    first, last = (first, last) if last > first else (first - 1.0, last + 1.0)
    return round(float(first) * step, decimals), round(float(last) * step, decimals), step


Simulation = PitchInputs | FlightInputs


def command_words(inputs: Simulation) -> list[str]:
    """Return the words behind `benchtool` that simulate the same."""
    kind = "pitch" if isinstance(inputs, PitchInputs) else "flight"
    return ["simulate", kind, *words(type(inputs), changed(inputs))]


def simulated(inputs: Simulation, quick: bool) -> Shown:
    """Return what the browser is sent of a simulation."""
    from benchtool.report.flight_preview import flight_preview
    from benchtool.report.pitch_preview import pitch_preview

    seed, gains = inputs.study.seed, inputs.study.gain_set()
    if isinstance(inputs, PitchInputs):
        return shown(pitch_preview(pitch_setup_of(inputs, gains), seed, quick=quick))
    setup = flight_setup_of(inputs, gains)
    return shown(flight_preview(setup, _controls(inputs), seed, quick=quick))


def write(inputs: Simulation, folder: Path) -> list[Path]:
    """Simulate, and write what the command writes with --out."""
    from benchtool.results import flight_result, pitch_result

    if isinstance(inputs, PitchInputs):
        return pitch_result(inputs).save(folder)
    return flight_result(inputs, _controls(inputs)).save(folder)


def _controls(inputs: FlightInputs) -> list[str]:
    return [known for known in FLIGHT_CONTROLLERS if known in inputs.controllers]


def zipped(inputs: Simulation) -> bytes:
    """Return what the command writes with --out, as one zip file."""
    packed = BytesIO()
    with TemporaryDirectory() as place, ZipFile(packed, "w", ZIP_DEFLATED) as archive:
        folder = Path(place) / "simulation"
        write(inputs, folder)
        for path in sorted(folder.iterdir()):
            archive.write(path, path.name)
    return packed.getvalue()


def write_into(inputs: Simulation, out: Path) -> list[str]:
    """Write what the command writes with --out, in one step; return its recordings' file names.

    Raises:
        WouldOverwrite: something of that name exists.
    """
    with written_whole(out) as part:
        written = write(inputs, part)
    return [path.name for path in written if beside(out / path.name).is_file()]
