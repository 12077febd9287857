"""What the page asks of the bench process. Stop is not queued like the others: it goes ahead."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from benchtool.acquire.air import Air
from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.acquire.plan import Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """Open a bench.

    Attributes:
        address: as on the command line.
        rig: may be empty where the address names one.
        weighs: hold it without the guard's limits, for masses on the load cell; no motor can turn.
    """

    address: str
    rig: str = ""
    weighs: bool = False


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Let go of the bench, motors at zero."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop the motors and whatever runs, now."""

    who: str = "the page"


@dataclass(frozen=True, slots=True)
class Leave:
    """Stop, let go of the bench, and end the process."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Allow motors to turn by hand, with what the operator typed."""

    typed: str


@dataclass(frozen=True, slots=True)
class Hold:
    """Say that a hand still holds the throttle; sent again and again.

    Attributes:
        tab: name of the browser's tab.
        press: number of this press, growing in a tab; one that has ended does not come back.
        pulse_us: what is wanted.
        rotors: numbers of the rotors that shall turn, from 1.
        age_s: time since the page knew that the button was held.
    """

    tab: str
    press: int
    pulse_us: float
    rotors: tuple[int, ...]
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Release:
    """Say that the hand let go; with no number, that its page is gone."""

    tab: str
    press: int | None = None


@dataclass(frozen=True, slots=True)
class Tare:
    """Take the present reading of the load cell as zero."""


@dataclass(frozen=True, slots=True)
class MovePlate:
    """Move the plate to a distance, motors standing."""

    z_m: float


@dataclass(frozen=True, slots=True)
class Weigh:
    """Average raw counts under a known mass, for a calibration."""

    mass_kg: float
    seconds: float = 3.0


@dataclass(frozen=True, slots=True)
class Calibrate:
    """Fit and keep a calibration from what was weighed; or forget what was weighed."""

    keep: bool = True


@dataclass(frozen=True, slots=True)
class Pace:
    """Let a virtual clock run so many times faster than life."""

    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Begin a sweep, or go on with one.

    Attributes:
        plan: not resolved; None to go on with `resume`.
        resume: run folder to go on with.
        runs: where run folders are made.
        typed: what the operator typed to arm; empty to rely on a simulated or checked bench.
        calibration, stage: as the command line's options.
    """

    plan: Plan | None = None
    resume: Path | None = None
    runs: Path = Path("runs")
    typed: str = ""
    operator: str = ""
    air: Air = field(default_factory=Air)
    calibration: str | None = None
    stage: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """Record a pitch experiment.

    Attributes:
        experiment: what to record.
        runs, name: where run folders are made, and what this one is called.
        typed: as for `Sweep`.
    """

    experiment: PitchExperiment
    runs: Path = Path("runs")
    name: str = "pitch"
    typed: str = ""


@dataclass(frozen=True, slots=True)
class Pause:
    """Let a sweep wait before its next visit, motors at zero; or go on."""

    on: bool


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer the question that a sweep asks (a plate moved by hand)."""

    text: str


Ask = (
    Connect | Disconnect | Stop | Leave | Arm | Hold | Release | Tare | MovePlate
    | Weigh | Calibrate | Pace | Sweep | Record | Pause | Answer
)  # fmt: skip
