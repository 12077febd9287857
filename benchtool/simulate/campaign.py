"""Campaign: one simulation at many points of a design."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeVar

from benchtool.core.errors import InputError
from benchtool.simulate.design import Design

Row = Mapping[str, float | str]
Point = Mapping[str, float]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """One simulation at many points.

    All points have the same noise: seed k of one point is seed k of any other.

    Attributes:
        metadata: common to all runs, for the table file.
        setups: simulation setups by gain set; each is run at every point.
        measures: label with unit by column; the main measure first.
        probe: probe(setup, point, design) raises for a point that cannot be run.
        case: case(setup, controller, point) -> the case, run with every seed.
        run: run(pairs of case and seed number, first seed, threads) -> the measures of each pair,
            in order.
    """

    title: str
    metadata: Mapping[str, str]
    setups: Mapping[str, Any]
    controllers: tuple[str, ...]
    measures: Mapping[str, str]
    probe: Callable[[Any, Point, Design], None]
    case: Callable[[Any, str, Point], Any]
    run: Callable[[Iterator[tuple[Any, int]], int, int | None], Iterator[Row]]

    def check(self, design: Design) -> None:
        """Raise if a point of the design cannot be run, before the first run."""
        for setup in self.setups.values():
            for point in design.probes():
                self.probe(setup, point, design)

    def rows(
        self, design: Design, threads: int | None = None, start: int = 0, stop: int | None = None
    ) -> Iterator[Row]:
        """Yield one row per gain set, controller, point and seed, in that order.

        A row contains the values of the point, `gains`, `controller`, `seed` and the measures.

        Args:
            threads: number of parallel runs; None means all cores.
            start, stop: range of rows.
        """
        labels: deque[Row] = deque()

        def cases() -> Iterator[tuple[Any, int]]:
            groups = product(self.setups.items(), self.controllers, design.points())
            for index, ((gains, setup), controller, point) in enumerate(groups):
                first_row = index * design.seeds
                numbers = range(max(start - first_row, 0), design.seeds)
                if stop is not None:
                    numbers = numbers[: max(stop - max(first_row, start), 0)]
                if not numbers:
                    continue
                case = self.case(setup, controller, point)
                for number in numbers:
                    seed = {"seed": float(design.seed + number)}
                    labels.append({**point, "gains": gains, "controller": controller, **seed})
                    yield case, number

        for measures in self.run(cases(), design.seed, threads):
            yield {**labels.popleft(), **measures}


def at_point(error: InputError, point: Point) -> InputError:
    """Return an error with the point of the design in its message."""
    values = ", ".join(f"{name} = {value:g}" for name, value in point.items())
    return InputError(f"{error} (at {values})")
