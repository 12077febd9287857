"""Campaigns: one simulation over a grid or a random design of numbers, results to disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.design import Design

Row = Mapping[str, float | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """Say what one column of results is.

    Attributes:
        text: what is measured, with its unit, as an axis says it.
        share: whether every run gives 0 or 1, so that the mean is a share.
    """

    text: str
    share: bool = False


class Campaign(Protocol):
    """Simulate one thing at many points: what a design, a table and a map need to know of it.

    Every point sees the same noise: seed k of one point is seed k of any other.
    """

    @property
    def title(self) -> str:
        """What is simulated, in one line."""

    @property
    def metadata(self) -> Mapping[str, str]:
        """What was the same in all runs, for the table's file."""

    @property
    def fixed(self) -> Mapping[str, str]:
        """What a reader of a map must know of the numbers that are not varied."""

    @property
    def gain_sets(self) -> Sequence[str]:
        """Gain sets that are run at every point."""

    @property
    def controllers(self) -> Sequence[str]:
        """Controllers that are run with every gain set."""

    @property
    def measures(self) -> Mapping[str, Measure]:
        """What can be drawn, by column; the first is drawn unless another is asked for."""

    def check(self, design: Design) -> None:
        """Refuse a design that cannot be run, before the first run."""

    def rows(self, design: Design, threads: int | None = None) -> Iterator[Row]:
        """Yield one row per gain set, controller, point and seed, in that order, as they come.

        A row has the point's numbers, `gains`, `controller`, `seed`, and the measures.
        """


def measure_named(campaign: Campaign, name: str) -> str:
    """Return the name of a measure that the campaign has; its first for an empty name."""
    if name and name not in campaign.measures:
        raise UnknownChoice("measure", name, campaign.measures)
    return name or next(iter(campaign.measures))


def at_point(error: InputError, point: Mapping[str, float]) -> InputError:
    """Return an error that says at which point of a design it came."""
    where = ", ".join(f"{name} = {value:g}" for name, value in point.items())
    return InputError(f"{error} (at {where})")


def write_campaign(
    rows: Iterable[Row], path: Path, metadata: Mapping[str, str], tell: Callable[[int], None]
) -> int:
    """Write rows to a Parquet file as they come and return how many; `tell` hears each count."""
    from benchtool.data.run.campaign import CampaignWriter

    count = 0
    with CampaignWriter(path, metadata) as writer:
        for row in rows:
            writer.add(row)
            count += 1
            tell(count)
    return count
