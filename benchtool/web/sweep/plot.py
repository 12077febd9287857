"""T_IGE/T_OGE over plate distance, points as they are measured, and the model's band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import ui

from benchtool.report.palette import BLUE, GREY, LOOKS, VERMILION
from benchtool.web.sweep.work import Curve, Points
from benchtool.web.theme import LIGHT_INK

_STAMP = {
    "text": "<b>SIMULATED</b>", "xref": "paper", "yref": "paper", "x": 0.01, "y": 0.01,
    "showarrow": False, "font": {"color": VERMILION, "size": 13},
    "bordercolor": VERMILION, "borderwidth": 1, "borderpad": 3,
}  # fmt: skip
"""Says on the figure that no motor turned, as every figure of the project does."""

_EMPTY = {
    "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False, "font": {"size": 15},
}  # fmt: skip
"""Stands in a plot that has nothing to show."""

_ROLES = {"eq. (2)": "formula", "eq. (3)": "quad"}


class RatioPlot:
    """Show the ratios of one run over a model.

    Args:
        empty: stands there while there is nothing to draw.
    """

    def __init__(self, empty: str) -> None:
        self._points, self._empty = Points(), empty
        self._curves: tuple[Curve, ...] = ()
        self._plot = ui.plotly(self._figure(dark=False)).classes("w-full ratio-plot")
        self._why = ui.label().classes("soft")

    def show(self, points: Points, curves: Sequence[Curve], *, empty: str, dark: bool) -> None:
        """Draw what is known now."""
        self._points, self._curves, self._empty = points, tuple(curves), empty
        self._plot.update_figure(self._figure(dark=dark))
        self._why.set_text(points.why)
        self._why.set_visibility(bool(points.why))

    def _figure(self, *, dark: bool) -> dict[str, Any]:
        ink = LIGHT_INK if dark else LOOKS["measurement"].color
        traces: list[dict[str, Any]] = []
        for curve in self._curves:
            traces += _curve_traces(curve, ink)
        x, y, error = (
            (list(column) for column in zip(*self._points.rows, strict=True))
            if (self._points.rows)
            else ([], [], [])
        )
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": "measured", "x": x, "y": y,
                "error_y": {"type": "data", "array": error, "color": ink, "thickness": 1.2},
                "marker": {"color": ink, "size": 7, "symbol": "circle-open"},
            }
        )  # fmt: skip
        empty = not self._points.rows and not self._curves
        axis = {
            "gridcolor": GREY + "44",
            "zeroline": False,
            "linecolor": GREY,
            "visible": not empty,
        }
        notes = (
            [_STAMP]
            if self._points.simulated
            else [{**_EMPTY, "text": self._empty}]
            if empty
            else []
        )
        return {
            "data": traces,
            "layout": {
                "height": 420,
                "margin": {"l": 60, "r": 16, "t": 12, "b": 46},
                "paper_bgcolor": "rgba(0,0,0,0)",
                "plot_bgcolor": "rgba(0,0,0,0)",
                "font": {"color": ink, "family": "Roboto, sans-serif", "size": 13},
                "xaxis": {**axis, "title": {"text": "z / R"}},
                "yaxis": {**axis, "title": {"text": "T<sub>IGE</sub> / T<sub>OGE</sub>"}},
                "legend": {"x": 0.98, "xanchor": "right", "y": 0.98},
                "uirevision": "same",
                "annotations": notes,
            },
            "config": {"displayModeBar": False, "responsive": True},
        }


def _curve_traces(curve: Curve, ink: str) -> list[dict[str, Any]]:
    columns = [list(column) for column in zip(*curve.rows, strict=True)]
    role = next((role for start, role in _ROLES.items() if curve.label.startswith(start)), None)
    if role is not None:
        color = {"formula": ink, "quad": LOOKS["quad"].color}[role]
        line = {"color": color, "dash": "dash", "width": 1.5}
        return [_line(curve.label, columns[0], columns[1], line)]
    traces = []
    if len(columns) == 4:
        edge = {"width": 0, "color": VERMILION}
        low = _line("lower", columns[0], columns[2], edge)
        high = _line(f"{curve.label}, 95 %", columns[0], columns[3], edge)
        traces = [
            {**low, "showlegend": False, "hoverinfo": "skip"},
            {**high, "fill": "tonexty", "fillcolor": VERMILION + "33"},
        ]
    line = {"color": VERMILION if traces else BLUE, "width": 2}
    return [*traces, _line(curve.label, columns[0], columns[1], line)]


def _line(name: str, x: list[float], y: list[float], line: dict[str, Any]) -> dict[str, Any]:
    return {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": line}
