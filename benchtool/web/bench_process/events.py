"""Events of the bench process: whole snapshots, so that a page that comes late misses nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchtool.acquire.calibration import Calibration
from benchtool.bench.bench import Identity
from benchtool.core.rig import Rig
from benchtool.data.run.append import Event


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionStatus:
    """State whether a bench is connected.

    Attributes:
        session: counts connections; a new number means other channels and a new clock.
        identity, rig: of the bench; None when off.
        calibration: stored for this device, None when there is none.
        weighs: for masses on the load cell only, no motor can turn.
        reason: why there is none, empty when that was commanded.
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
class LimitShare:
    """State how near a reading is to its limit; `share` is 1 at the limit."""

    name: str
    value: float
    limit: float
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStatus:
    """State what the bench does just now, a few times a second.

    Attributes:
        pulses_us: commanded, one for each rotor.
        rate_Hz: samples per second of the bench's clock.
        samples, lost, corrupt: since the connection.
        limits: how near each reading has been to its limit since the last of these.
        armed: motors may be turned by hand.
        speed: of a virtual clock, 0 where the clock is the wall's.
        weighed: (mass in kg, counts) so far, for a calibration.
        busy: what takes a while just now, empty when nothing does.
        standstill: which rotors were seen to stand since zero was commanded, in a sentence; empty
            while a motor is driven.
    """

    pulses_us: tuple[float, ...] = ()
    rate_Hz: float = 0.0
    samples: int = 0
    lost: int = 0
    corrupt: int = 0
    limits: tuple[LimitShare, ...] = ()
    armed: bool = False
    speed: float = 0.0
    weighed: tuple[tuple[float, float], ...] = ()
    busy: str = ""
    standstill: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepStatus:
    """State how far a sweep or a pitch recording is.

    Attributes:
        status: "none" before the first one; "closing" while files are finished.
        pitch: a pitch recording; it has no visits.
        run: its folder.
        visits, done, left_s: planned, measured, and how long the rest takes.
        now: present visit, in words.
        question: for the operator, empty when there is none.
        reason: why it ended early, or its summary.
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
class RunEvent:
    """Report an event of the present run."""

    event: Event


@dataclass(frozen=True, slots=True)
class PressEnded:
    """Report that a press of the throttle has ended other than by its release."""

    tab: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Show people something once."""

    text: str
    is_error: bool = False


BenchEvent = ConnectionStatus | LiveStatus | SweepStatus | RunEvent | PressEnded | Notice
