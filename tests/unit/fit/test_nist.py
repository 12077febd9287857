"""Certified answers: NIST's nonlinear regression problems of lower and average difficulty."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchtool.core.parameter import Parameter
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem

FOLDER = Path(__file__).parents[2] / "data" / "nist"
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Certified:
    """One problem with what NIST certifies."""

    name: str
    starts: tuple[Array, Array]
    values: Array
    sds: Array
    residual_sum: float
    residual_sd: float
    dof: int
    y: Array
    x: Array


def read(name: str) -> Certified:
    """Read one file: starting and certified values, then the data from line 61 on."""
    lines = (FOLDER / f"{name}.dat").read_text("ascii").splitlines()
    rows = [re.match(r"\s*b\d+\s*=\s*(.*)", line) for line in lines[:60]]
    table = np.array([row.group(1).split() for row in rows if row], float)

    def stated(words: str) -> float:
        line = next(line for line in lines[:60] if line.startswith(words))
        return float(line.split(":")[1])

    data = np.array([line.split() for line in lines[60:] if line.strip()], float)
    return Certified(
        name=name,
        starts=(table[:, 0], table[:, 1]),
        values=table[:, 2],
        sds=table[:, 3],
        residual_sum=stated("Residual Sum of Squares"),
        residual_sd=stated("Residual Standard Deviation"),
        dof=int(stated("Degrees of Freedom")),
        y=np.log(data[:, 0]) if name == "Nelson" else data[:, 0],
        x=data[:, 1:].T,
    )


def _chwirut(b: Any, x: Array) -> Any:
    return np.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


def _lanczos(b: Any, x: Array) -> Any:
    return sum(b[i] * np.exp(-b[i + 1] * x[0]) for i in (0, 2, 4))


def _gauss(b: Any, x: Array) -> Any:
    peaks = sum(b[i] * np.exp(-((x[0] - b[i + 1]) ** 2) / b[i + 2] ** 2) for i in (2, 5))
    return b[0] * np.exp(-b[1] * x[0]) + peaks


def _rational(n: int, b: Any, x: Array) -> Any:
    above, below = (
        sum(factor * x[0] ** power for power, factor in enumerate(part))
        for part in (b[:n], [1.0, *b[n:]])
    )
    return above / below


def _enso(b: Any, x: Array) -> Any:
    w = 2 * np.pi * x[0]
    total = b[0] + b[1] * np.cos(w / 12) + b[2] * np.sin(w / 12)
    total = total + b[4] * np.cos(w / b[3]) + b[5] * np.sin(w / b[3])
    return total + b[7] * np.cos(w / b[6]) + b[8] * np.sin(w / b[6])


MODELS: dict[str, Callable[[Any, Array], Any]] = {
    "Misra1a": lambda b, x: b[0] * (1 - np.exp(-b[1] * x[0])),
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "Lanczos3": _lanczos,
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "DanWood": lambda b, x: b[0] * x[0] ** b[1],
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x[0] / 2) ** -2),
    "Kirby2": partial(_rational, 3),
    "Hahn1": partial(_rational, 4),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x[0] * b[3]) + b[2] * np.exp(-x[0] * b[4]),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Gauss3": _gauss,
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x[0]) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x[0] / (1 + b[1] * x[0]),
    "Roszman1": lambda b, x: b[0] - b[1] * x[0] - np.arctan(b[2] / (x[0] - b[3])) / np.pi,
    "ENSO": _enso,
}

# The residuals of Lanczos1 are of order 1e-13 on data of order 1: double precision leaves three
# digits of their sum, and so of everything proportional to it. Its values hold all six digits.
SD_DIGITS = {"Lanczos1": 2.5}


def nist_problem(certified: Certified, start: int) -> Problem:
    """State one problem from one of its two starting points, with the scatter unknown."""
    model = MODELS[certified.name]
    return function_problem(
        certified.name,
        {
            f"b{i}": Parameter(f"b{i}", "1", float(value), free=True)
            for i, value in enumerate(certified.starts[start], 1)
        },
        lambda b: model(b, certified.x),
        certified.y,
    )


def digits(found: float, certified: float) -> float:
    """Count the digits that agree, as NIST does (log relative error)."""
    return float(-np.log10(max(abs(found / certified - 1.0), 1e-16)))


@pytest.mark.parametrize("start", [0, 1], ids=["start 1", "start 2"])
@pytest.mark.parametrize("name", MODELS)
def test_certified_values_are_found_to_six_digits(name, start):
    certified = read(name)
    result = fit_least_squares(nist_problem(certified, start))
    assert result.outcome.status == "converged"
    assert result.facts["derivatives"] == "complex_step"
    for i, (value, sd) in enumerate(zip(certified.values, certified.sds, strict=True), 1):
        assert digits(result[f"b{i}"].value, value) >= 6.0, f"b{i}"
        assert digits(result[f"b{i}"].sd, sd) >= SD_DIGITS.get(name, 6.0), f"b{i}"
    assert digits(result.chi2, certified.residual_sum) >= SD_DIGITS.get(name, 8.0)
    assert digits(result["noise.scale"].value, certified.residual_sd) >= SD_DIGITS.get(name, 8.0)
    assert result.dof == certified.dof
