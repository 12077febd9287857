"""Figure files with reproducible bytes; files are overwritten only on request."""

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

# No dates and versions: the bytes depend only on the data and the library.
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

# Rasterised parts of a vector file (sampler traces) need less resolution than a whole png.
_RASTER_DPI = {"svg": 110, "png": 160, "pdf": 160}


def figure_bytes(figure: Figure, file_format: Format = "svg") -> bytes:
    """Return the contents of a figure file."""
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
    """Return axes as JSON: boxes (fractions of the figure from left and top), limits, labels."""
    boxes = []
    for axes in figure.axes:
        scales = (axes.get_xscale(), axes.get_yscale())
        if not axes.axison or not set(scales) <= {"linear", "log"}:
            continue
        position = axes.get_position()
        # Of several stacked axes only the lowest may have an x label.
        siblings = (axes, *axes.get_shared_x_axes().get_siblings(axes))
        label = next((sibling.get_xlabel() for sibling in siblings if sibling.get_xlabel()), "")
        boxes.append(
            {
                "box": [
                    round(edge, 4)
                    for edge in (position.x0, 1 - position.y1, position.x1, 1 - position.y0)
                ],
                "x": [*axes.get_xlim(), scales[0]],
                "y": [*axes.get_ylim(), scales[1]],
                "labels": [_plain(label), _plain(axes.get_ylabel())],
            }
        )
    return json.dumps(boxes)


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
    """Raise WouldOverwrite if one of the files exists."""
    for path in paths:
        if path.exists():
            raise WouldOverwrite(str(path))


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically; create its folder."""
    make_folder(path.parent)
    replace_bytes(path, content)
