"""The paper's claims about control near surfaces, each held against simulations of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from textwrap import wrap
from typing import Any

from benchtool.core.counted import counted
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_named
from benchtool.simulate.flight.cases import flight_case
from benchtool.simulate.flight.measures import Measures
from benchtool.simulate.flight.study import Flown, fly_and_measure
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains, gains_named

HOLDS = "comes out"
FAILS = "does not come out"
UNCLEAR = "not distinguishable"
CONSTRUCTED = "by construction"
VERDICTS = (HOLDS, FAILS, UNCLEAR, CONSTRUCTED)
"""What may be said of a claim; the last two are no confirmations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Hold one claim and what became of it.

    Attributes:
        where: section or figure.
        says: what the paper says.
        found: what comes out, with numbers.
        gains: the gain set, or what was changed in it.
        verdict: one of `VERDICTS`.
        by: who says it: the paper, or the planar study that this simulator is held to.
    """

    where: str
    says: str
    found: str
    gains: str
    verdict: str
    by: str = "paper"


@dataclass(slots=True)
class Flights:
    """Fly cases for the claims, each once.

    Attributes:
        rig: what flies.
        flown: by what was asked.
        tell: is called with a line before each flight; None for silence.
    """

    rig: Rig = field(default_factory=lambda: rig_named("pquad"))
    flown: dict[Any, Flown] = field(default_factory=dict)
    tell: Callable[[str], None] | None = None

    def fly(
        self,
        name: str,
        control: str = "pid",
        z_over_R: float | None = 2.0,
        speed_m_s: float = 0.2,
        gains: Gains | str = "s3",
        vehicle: FlightVehicle | None = None,
        **changes: Any,
    ) -> Flown:
        """Return a flight of a shipped case, flown when it is asked for the first time."""
        craft = vehicle or FlightVehicle.of_rig(self.rig)
        set_ = gains_named(gains) if isinstance(gains, str) else gains
        case = flight_case(
            name, craft, set_, z_over_R=z_over_R, speed_m_s=speed_m_s, control=control, **changes
        )
        plain = {key: value for key, value in changes.items() if key != "below"}
        below = repr(case.below.blocks)
        craft_key = repr(craft.identity)
        asked = (name, control, z_over_R, speed_m_s, repr(set_), craft_key, repr(plain), below)
        if asked not in self.flown:
            if self.tell is not None:
                self.tell(f"{name} {control} z/R {z_over_R} {speed_m_s} m/s")
            self.flown[asked] = fly_and_measure(case)
        return self.flown[asked]

    def measure(self, name: str, *words: Any, **changes: Any) -> Measures:
        """Return the numbers of such a flight."""
        return self.fly(name, *words, **changes).measures


def yes(condition: bool) -> str:
    """Return the verdict of a claim that either comes out or does not."""
    return HOLDS if condition else FAILS


def arrival(found: Measures) -> str:
    """Say when a flight arrives, or what it does instead."""
    if found.ending == "struck":
        return "strikes the obstacle"
    if found.arrives:
        return f"{found.arrives_s:.1f} s"
    return f"never, x {found.range_m[0]:.2f} to {found.range_m[1]:.2f} m"


def claim_lines(claims: Sequence[Claim], width: int = 110) -> Iterator[str]:
    """Give the table as lines of plain text: one block per claim."""
    for number, claim in enumerate(claims, 1):
        yield f"{number:>2}  {claim.verdict.upper():<20} [{claim.where}; gains {claim.gains}]"
        for word, text in ((claim.by, claim.says), ("here", claim.found)):
            lines = wrap(text, width - 11)
            yield f"    {word:>5}: {lines[0]}"
            yield from (f"           {line}" for line in lines[1:])
    counts = ", ".join(
        f"{sum(claim.verdict == verdict for claim in claims)} {verdict}" for verdict in VERDICTS
    )
    yield f"{counted(len(claims), 'row')}: {counts}"


def claim_csv(claims: Sequence[Claim]) -> str:
    """Return the table as CSV text."""
    import csv
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["where", "by", "says", "comes_out", "gains", "verdict"])
    for claim in claims:
        writer.writerow(
            [claim.where, claim.by, claim.says, claim.found, claim.gains, claim.verdict]
        )
    return buffer.getvalue()
