"""The scorecard: counts over records, held against what was set out to be reached.

It knows nothing of benches: pitch and sweep hand in the same form (`scored.py`). Nothing is chosen
by looking at it; it only counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan, log

import numpy as np

from tests.proof.blind.scored import GAP_REACHED, Scored, Share, share_of

BINS = 10
LEAST_PROBABILITY = 1e-6
"""A logarithmic score counts nothing as less likely; one certain error would hide all else."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Hold one figure of the scorecard.

    Attributes:
        reached: whether the aim is; None where there is none or nothing was counted.
    """

    what: str  # is counted
    found: str  # in words
    aim: str = ""  # in words; "" where none was set
    reached: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """Hold one bin of stated probabilities: how many, their mean, and how often they were right."""

    count: int
    stated: float
    right: float


def calibration(records: Sequence[Scored], bins: int = BINS) -> tuple[Bin, ...]:
    """Return stated probability against frequency, in bins of equal count."""
    stated = sorted(one.stated for one in records)
    parts = np.array_split(np.arange(len(stated)), min(bins, max(len(stated), 1)))
    return tuple(
        Bin(
            count=len(part),
            stated=float(np.mean([stated[i][0] for i in part])),
            right=float(np.mean([stated[i][1] for i in part])),
        )
        for part in parts
        if len(part)
    )


def calibration_error(bins: Iterable[Bin]) -> float:
    """Return the expected calibration error: mean distance of stated from right, by count."""
    kept = list(bins)
    total = sum(one.count for one in kept)
    return sum(one.count * abs(one.stated - one.right) for one in kept) / max(total, 1)


def by_effect(records: Iterable[Scored]) -> dict[str, tuple[Share, Share]]:
    """Return how often each effect is named first, and is named first or in an honest class."""
    groups: dict[str, list[Scored]] = {}
    for one in records:
        groups.setdefault(one.truth[0], []).append(one)
    return {
        name: (
            share_of(one.named_first for one in group),
            share_of(_right_or_class(one) for one in group),
        )
        for name, group in sorted(groups.items())
    }


class Scorecard:
    """Count verdicts on records.

    Args:
        title: of the bench.
        records: whatever was scored, of every kind.
        about: whose physics the records have, and what was chosen on them.
    """

    def __init__(self, title: str, records: Sequence[Scored], about: str = "") -> None:
        self.title, self.about = title, about
        self.records = tuple(records)

    def chosen(self, kind: str, strength: str = "full", excitation: str = "rich") -> list[Scored]:
        """Return the records of a kind."""
        return [
            one
            for one in self.records
            if (one.kind, one.strength, one.excitation) == (kind, strength, excitation)
        ]

    @property
    def mixed(self) -> list[Scored]:
        """Rich records of every kind and strength on which probabilities are held to account."""
        return [one for one in self.records if one.kind != "pair" and one.excitation == "rich"]

    def lines(self) -> tuple[Line, ...]:
        """Return the figures, those that miss their aim first."""
        full, nulls = self.chosen("named"), self.chosen("none")
        outside, pairs = self.chosen("outside"), self.chosen("pair")
        poor = self.chosen("named", excitation="poor")
        named = [one for one in full if one.named_first]
        classes = [len(one.names) for one in full if one.in_class]
        lines = (
            _share("right name or honest class", full, _right_or_class, least=0.95),
            _share("single right name", full, lambda one: one.named_first),
            _share(
                "right, class, or stated to be too small to see",
                full,
                lambda one: one.honest,
            ),
            Line(what="mean size of classes", found=f"{np.mean(classes):.1f}" if classes else "-"),
            _share("confident wrong name", self.records, _sure_and_wrong, most=0.005),
            _share("a name too many beside the right one", named, lambda one: one.wrong_names),
            _share("false name where nothing is hidden", nulls, lambda one: one.names, most=0.02),
            _share("confident false name where nothing is hidden", nulls, _sure_and_wrong),
            _share("'unknown' where nothing is hidden", nulls, _unknown),
            _share("'unknown' for what is outside", outside, _unknown, least=0.95),
            *_gaps(named),
            _share("pairs: both named", pairs, lambda one: one.both_named, least=0.80),
            _share("stage right", full, lambda one: one.where == one.stage),
            _share("poor excitation: right or an honest class", poor, lambda one: one.honest),
            self._coverage([p.held for one in self.records if one.named_first
                            for p in one.parameters]),
            *self._calibrated(self.mixed),
            self._seconds(),
        )  # fmt: skip
        return tuple(sorted(lines, key=lambda line: line.reached is not False))

    def _coverage(self, held: list[bool]) -> Line:
        share = share_of(held)
        low, high = share.interval
        good = low >= 0.90 and high <= 0.98 if share.total else None
        what = "95 % intervals that hold the truth"
        return Line(what=what, found=str(share), aim="90 to 98 %", reached=good)

    def _calibrated(self, mixed: list[Scored]) -> tuple[Line, ...]:
        if not mixed:
            return ()
        bins = calibration(mixed)
        error = calibration_error(bins)
        rng = np.random.default_rng(0)
        redrawn = [
            calibration_error(
                calibration([mixed[i] for i in rng.integers(len(mixed), size=len(mixed))])
            )
            for _ in range(200)
        ]
        high = float(np.quantile(redrawn, 0.975))
        brier = float(np.mean([one.brier for one in mixed]))
        score = float(np.mean([-log(max(one.given_to_truth, LEAST_PROBABILITY)) for one in mixed]))
        least = min(one.count for one in bins)
        what = f"expected calibration error, {len(bins)} bins of {least} or more"
        found = f"{error:.3f}, redrawn at most {high:.3f}"
        return (
            Line(what=what, found=found, aim="at most 0.05", reached=high <= 0.05),
            Line(what="Brier score (0 best, 2 worst)", found=f"{brier:.3f}"),
            Line(what="logarithmic score (0 best)", found=f"{score:.3f}"),
        )

    def _seconds(self) -> Line:
        spent = [one.seconds for one in self.records]
        found = f"median {np.median(spent):.1f}, most {max(spent):.1f}" if spent else "none"
        return Line(what="seconds a record", found=found)

    # --- print ----------------------------------------------------------------------------

    def tables(self) -> tuple[tuple[str, tuple[str, ...], list[tuple[str, ...]]], ...]:
        """Return every table: its heading, its columns, its rows."""
        figures = [
            (line.what, line.found, line.aim, {True: "yes", False: "NO", None: ""}[line.reached])
            for line in self.lines()
        ]
        effects = [
            (name, str(first), str(two))
            for name, (first, two) in sorted(
                by_effect(self.chosen("named")).items(), key=lambda one: one[1][1].value
            )
        ]
        bins = [
            (str(one.count), f"{one.stated:.3f}", f"{one.right:.3f}")
            for one in calibration(self.mixed)
        ]
        outside = self.chosen("outside")
        counts = {
            name: share_of(_unknown(one) for one in outside if name in one.truth)
            for name in sorted({name for one in outside for name in one.truth})
        }
        families = [
            (name, str(share))
            for name, share in sorted(counts.items(), key=lambda one: one[1].value)
        ]
        return (
            ("Figures", ("what", "found", "aim", "reached"), figures),
            ("By effect", ("effect", "named first", "right or an honest class"), effects),
            ("From outside the library", ("family", "unknown"), families),
            ("Calibration", ("records", "stated", "right"), bins),
        )

    def text(self) -> str:
        """Return the scorecard for a terminal."""
        out = [f"{self.title}: {len(self.records)} records"]
        for heading, columns, rows in self.tables():
            if not rows:
                continue
            shown = [columns, *rows]
            widths = [max(len(row[i]) for row in shown) for i in range(len(columns))]
            out += ["", heading]
            out += [
                "  ".join(
                    cell.ljust(width) for cell, width in zip(row, widths, strict=True)
                ).rstrip()
                for row in shown
            ]
        return "\n".join(out)

    def markdown(self, date: str) -> str:
        """Return the scorecard as a part of a page.

        Args:
            date: on which the records were scored.
        """
        head = f"{len(self.records)} records, scored on {date}. {self.about}".rstrip()
        out = [f"## {self.title}", "", head]
        for heading, columns, rows in self.tables():
            if not rows:
                continue
            out += ["", f"### {heading}", "", _row(columns), _row(["---"] * len(columns))]
            out += [_row(row) for row in rows]
        return "\n".join([*out, ""])


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _share(
    what: str,
    records: Sequence[Scored],
    holds: Callable[[Scored], object],
    *,
    least: float | None = None,
    most: float | None = None,
) -> Line:
    """Count records of which something holds; an aim is reached where the interval's bad end is."""
    share = share_of(bool(holds(one)) for one in records)
    low, high = share.interval
    aim, reached = "", None
    if least is not None:
        aim, reached = f"at least {100.0 * least:g} %", low >= least
    elif most is not None:
        aim, reached = f"at most {100.0 * most:g} %", high <= most
    return Line(what=what, found=str(share), aim=aim, reached=reached if share.total else None)


def _unknown(one: Scored) -> bool:
    return one.verdict == "unknown"


def _right_or_class(one: Scored) -> bool:
    return one.named_first or one.in_class


def _sure_and_wrong(one: Scored) -> bool:
    return one.confidently_wrong


def _worst(gaps: Mapping[str, float]) -> float:
    return max(gaps.values(), default=0.0)


def _gaps(records: list[Scored]) -> Iterator[Line]:
    """Yield what is left of the gap: over its floor, and over what the true model leaves."""
    if not records:
        return
    after = [_worst(one.gaps) for one in records]
    closed = share_of(gap <= GAP_REACHED for gap in after)
    yield Line(what=f"gap after at most {GAP_REACHED:g} floors", found=str(closed))
    yield Line(
        what="gap after over its floor",
        found=f"median {np.median(after):.2f}, nine of ten at most {np.quantile(after, 0.9):.2f}",
    )
    told = [one for one in records if not isnan(one.by_luck)]
    if told:
        luck, learning = (
            f"{100.0 * np.mean([getattr(one, name) for one in told]):.1f} %"
            for name in ("by_luck", "by_learning")
        )
        yield Line(what="expected at 1.1 floors by simulation, noise as stated", found=luck)
        yield Line(what="expected with numbers as uncertain as learned", found=learning)
    truly = [one for one in records if one.gaps_truly]
    if truly:
        share = share_of(_worst(one.gaps_truly) <= GAP_REACHED for one in truly)
        yield Line(what="the same over floors of the noise truly there", found=str(share))
    known = [one for one in records if one.true_gaps]
    if known:
        over = [
            max(one.gaps[name] / true for name, true in one.true_gaps.items() if name in one.gaps)
            for one in known
        ]
        middle, most = float(np.median(over)), float(np.quantile(over, 0.9))
        yield Line(
            what=f"gap after over the gap that the true model leaves, {len(over)} records",
            found=f"median {middle:.3f}, nine of ten at most {most:.3f}",
            aim="median 1.02, nine of ten 1.08",
            reached=middle <= 1.02 and most <= 1.08,
        )
