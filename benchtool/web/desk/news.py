"""What the bench process tells the page: whole snapshots, so that a late page misses nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchtool.acquire.calibration import Calibration
from benchtool.bench.bench import Identity
from benchtool.core.rig import Rig
from benchtool.store import Event


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """Say whether a bench is there.

    Attributes:
        status: "off", "opening" or "on".
        address: as it was asked for.
        session: counts connections; a new number means other channels and a new clock.
        identity, rig: who answers and what stands on it; None when off.
        calibration: kept for this device, None when there is none.
        weighs: for masses on the load cell only, no motor can turn.
        reason: why there is none, empty when that was asked for.
        unseen: why motors may still turn, empty unless they were not seen to stand.
    """

    status: Literal["off", "opening", "on"] = "off"
    address: str = ""
    session: int = 0
    identity: Identity | None = None
    rig: Rig | None = None
    calibration: Calibration | None = None
    weighs: bool = False
    reason: str = ""
    unseen: str = ""


@dataclass(frozen=True, slots=True)
class Near:
    """Say how near a reading is to its limit; `share` is 1 at the limit."""

    name: str
    value: float
    limit: float
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """Say what the bench does just now, a few times a second.

    Attributes:
        pulses_us: commanded, one for each rotor.
        rate_Hz: samples that came per second of the bench's clock.
        samples, lost, corrupt: since the connection.
        near: limits, and how near each reading has been since the last of these.
        armed: motors may be turned by hand.
        speed: of a virtual clock, 0 where the clock is the wall's.
        weighed: (mass in kg, counts) so far, for a calibration.
        busy: what is being done that takes a while, empty when nothing is.
        standstill: which rotors were seen to stand since zero was commanded, in a sentence; empty
            while a motor is driven.
    """

    pulses_us: tuple[float, ...] = ()
    rate_Hz: float = 0.0
    samples: int = 0
    lost: int = 0
    corrupt: int = 0
    near: tuple[Near, ...] = ()
    armed: bool = False
    speed: float = 0.0
    weighed: tuple[tuple[float, float], ...] = ()
    busy: str = ""
    standstill: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """Say how far a sweep or a pitch recording is.

    Attributes:
        status: "none" before the first one; "closing" while files are finished.
        pitch: a pitch recording; it has no visits.
        run: its folder.
        visits, done, left_s: how many there are and are measured, and how long the rest takes.
        now: what is being visited, in words.
        question: what the operator is asked, empty when nothing is.
        reason: why it ended early, or its summary.
        resumable: whether it can be gone on with.
    """

    status: Literal[
        "none", "running", "pausing", "paused", "asking", "closing", "ended", "stopped"
    ] = "none"
    pitch: bool = False
    run: str = ""
    visits: int = 0
    done: int = 0
    left_s: float = 0.0
    now: str = ""
    question: str = ""
    reason: str = ""

    @property
    def active(self) -> bool:
        """Whether one is under way."""
        return self.status in ("running", "pausing", "paused", "asking", "closing")


@dataclass(frozen=True, slots=True)
class Happened:
    """Tell an event of the present run."""

    event: Event


@dataclass(frozen=True, slots=True)
class PressEnded:
    """Tell that a press of the throttle has ended, but not by the hand itself."""

    tab: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """Tell people something once."""

    text: str
    is_error: bool = False


News = Connection | Live | Swept | Happened | PressEnded | Said
