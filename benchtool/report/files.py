"""Figures to files: the same figure gives the same bytes, and nothing is overwritten unasked."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

from matplotlib.figure import Figure as Figure

from benchtool.core.errors import UnknownChoice, WouldOverwrite
from benchtool.data.atomic import make_folder, replace_bytes
from benchtool.report.style import look

Format = Literal["svg", "png", "pdf"]

# Neither dates nor versions: the bytes depend on the data and the library alone.
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

# What is rasterised inside a vector file (the traces of a sampler) needs less than a whole png.
_RASTER_DPI = {"svg": 110, "png": 160, "pdf": 160}


def figure_bytes(figure: Figure, file_format: Format = "svg") -> bytes:
    """Return the figure as the contents of a file of that format."""
    if file_format not in _METADATA:
        raise UnknownChoice("figure format", file_format, _METADATA)
    buffer = BytesIO()
    with look():
        figure.savefig(
            buffer,
            format=file_format,
            metadata=_METADATA[file_format],
            dpi=_RASTER_DPI[file_format],
        )
    return buffer.getvalue()


def figure_axes(figure: Figure) -> str:
    """Return boxes (shares of the figure from left and top), limits and labels of axes as JSON."""
    found = []
    for axes in figure.axes:
        scales = (axes.get_xscale(), axes.get_yscale())
        if not axes.axison or not set(scales) <= {"linear", "log"}:
            continue
        place = axes.get_position()
        # Only the lowest of several axes may have the label below them.
        siblings = (axes, *axes.get_shared_x_axes().get_siblings(axes))
        label = next((one.get_xlabel() for one in siblings if one.get_xlabel()), "")
        found.append(
            {
                "box": [round(at, 4) for at in (place.x0, 1 - place.y1, place.x1, 1 - place.y0)],
                "x": [*axes.get_xlim(), scales[0]],
                "y": [*axes.get_ylim(), scales[1]],
                "labels": [_plain(label), _plain(axes.get_ylabel())],
            }
        )
    return json.dumps(found)


def _plain(label: str) -> str:
    return re.sub(r"\\\w+|[${}]", "", label)


def save_figure(
    figure: Figure, stem: Path, formats: Sequence[Format] = ("svg", "png"), *, replace: bool = False
) -> tuple[Path, ...]:
    """Write `stem`.svg, `stem`.png, ... and return their paths; overwrite only with `replace`."""
    contents = {
        stem.with_name(f"{stem.name}.{name}"): figure_bytes(figure, name) for name in formats
    }
    if not replace:
        check_not_existing(contents)
    for path, content in contents.items():
        write_whole(path, content)
    return tuple(contents)


def check_not_existing(paths: Sequence[Path] | dict[Path, bytes]) -> None:
    """Refuse to go on when one of the files exists already."""
    for path in paths:
        if path.exists():
            raise WouldOverwrite(str(path))


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a reader finds the old contents or the new, never half."""
    make_folder(path.parent)
    replace_bytes(path, content)
