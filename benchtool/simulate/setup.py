"""Set-up of closed-loop simulations, common to hinged and free bodies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self

from benchtool.core.errors import InputError

Row = Mapping[str, float | str]
Point = Mapping[str, float]

CONTROL_HZ = (1.0, 1e5)  # range of control rates: up to 1000 times that of an autopilot; assumed


class Setup(ABC):
    """Set-up of a simulation by names and numbers."""

    measures: ClassVar[Mapping[str, str]]  # label with unit by column; the main measure first

    @property
    @abstractmethod
    def campaign_title(self) -> str:
        """Title of a campaign."""

    @abstractmethod
    def to_metadata(self) -> dict[str, str]:
        """Return the settings as text by name."""

    @abstractmethod
    def with_changes(self, values: Mapping[str, float]) -> Self:
        """Return the set-up with some numbers changed, by name."""

    @abstractmethod
    def check_point(self, point: Point, varied: Sequence[str], seeds: int, controller: str) -> None:
        """Raise for a point of a campaign that cannot be run."""

    @abstractmethod
    def build_run(self, controller: str, point: Point) -> Any:
        """Return a run at a point, for `measure_runs` with any seed."""

    @staticmethod
    @abstractmethod
    def measure_runs(
        runs: Iterator[tuple[Any, int]], seed: int, threads: int | None
    ) -> Iterator[Row]:
        """Yield the measures of pairs of run and seed number, counted from `seed`, in order."""


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError if a number is outside its range or NaN."""
    if not low <= value <= high:
        raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g}")
