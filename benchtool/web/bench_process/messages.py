"""Messages between the page's server and the bench process: commands one way, events the other.

`StopMotors` is not queued behind other commands. Events are whole snapshots, so that a page that
is opened late misses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from benchtool.acquire.inputs import SweepInputs, WeighingInputs
from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.bench.bench import DeviceInfo
from benchtool.core.rig import Limits, Rig
from benchtool.data.calibration import Calibration
from benchtool.data.run.append import Event

# --- commands -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """Open a bench.

    Attributes:
        rig: may be empty where the address names one.
        weighs: hold it without the guard's limits, for masses on the load cell; no motor can turn.
    """

    address: str
    rig: str = ""
    weighs: bool = False


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Close the bench, motors at zero."""


@dataclass(frozen=True, slots=True)
class StopMotors:
    """Stop the motors and whatever runs, now."""

    who: str = "the page"


@dataclass(frozen=True, slots=True)
class ServerHeartbeat:
    """Heartbeat of the page's server; silence stops the motors.

    Attributes:
        page_problem: why the page that has the control lock cannot press STOP; empty if it can.
    """

    page_problem: str = ""


@dataclass(frozen=True, slots=True)
class Shutdown:
    """Stop, close the bench, and end the process."""


@dataclass(frozen=True, slots=True)
class ArmMotors:
    """Allow motors to turn by hand, with what the operator typed."""

    typed: str


@dataclass(frozen=True, slots=True)
class HoldThrottle:
    """Report that the throttle button is still held; sent again and again.

    Attributes:
        press: number of this press, growing in a tab; one that has ended does not come back.
        rotors: numbers of the rotors that shall turn, from 1.
        age_s: time since the page knew that the button was held.
    """

    tab: str
    press: int
    pulse_us: float
    rotors: tuple[int, ...]
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class ReleaseThrottle:
    """Report that the button was released; with no number, that its page is gone."""

    tab: str
    press: int | None = None


@dataclass(frozen=True, slots=True)
class TareLoadCell:
    """Take the present reading of the load cell as zero."""


@dataclass(frozen=True, slots=True)
class TightenLimits:
    """Hold the bench to narrower limits than its rig's, until it is disconnected."""

    limits: Limits


@dataclass(frozen=True, slots=True)
class MovePlateTo:
    """Move the plate to a distance, motors standing."""

    z_m: float


@dataclass(frozen=True, slots=True)
class WeighMass:
    """Average raw counts under a known mass, for a calibration."""

    mass_kg: float
    seconds: float = 3.0


@dataclass(frozen=True, slots=True)
class Calibrate:
    """Fit and store a calibration from the weighed masses; or discard them."""

    store: bool = True
    known: WeighingInputs = field(default_factory=WeighingInputs)


@dataclass(frozen=True, slots=True)
class Annotate:
    """Put what the operator writes among the events of the run that is under way."""

    text: str


@dataclass(frozen=True, slots=True)
class SetClockSpeed:
    """Run a virtual clock at a multiple of real time."""

    speed: float


@dataclass(frozen=True, slots=True)
class StartSweep:
    """Start a sweep on the connected bench, or resume the run that its inputs name.

    Nothing `typed` to arm relies on a simulated or checked bench.

    Attributes:
        needs_page: pause with motors at zero when the page that has the control lock is lost.
    """

    inputs: SweepInputs
    typed: str = ""
    needs_page: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRecording:
    """Record a pitch experiment; `typed` and `needs_page` as for a sweep, which is then stopped."""

    experiment: PitchExperiment
    runs: Path = Path("runs")
    name: str = "pitch"
    typed: str = ""
    needs_page: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StartLiveRecording:
    """Record what is turned by hand, until `EndRecording` or a stop."""

    runs: Path = Path("runs")
    name: str = "live"


@dataclass(frozen=True, slots=True)
class EndRecording:
    """End a live recording: motors at zero, the run closed."""


@dataclass(frozen=True, slots=True)
class PauseSweep:
    """Let a sweep wait before its next visit, motors at zero; or continue it."""

    on: bool


@dataclass(frozen=True, slots=True)
class AnswerQuestion:
    """Answer the question of a sweep (a plate moved by hand)."""

    text: str


Command = (
    Connect | Disconnect | StopMotors | ServerHeartbeat | Shutdown | ArmMotors | HoldThrottle
    | ReleaseThrottle | TareLoadCell | WeighMass | Calibrate | MovePlateTo | SetClockSpeed
    | StartSweep | StartRecording | PauseSweep | AnswerQuestion | Annotate | StartLiveRecording
    | EndRecording | TightenLimits
)  # fmt: skip


# --- events -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionStatus:
    """State whether a bench is connected.

    Attributes:
        session: counts connections; a new number means other channels and a new clock.
        identity, rig: of the bench, its limits those that hold now; None when off.
        stated: limits by the rig itself, up to which they may be widened again.
        weighs: for masses on the load cell only, no motor can turn.
        reason: why there is none, empty when that was commanded.
        unseen: why motors may still turn, empty unless they were not seen to stand.
    """

    status: Literal["off", "opening", "on"] = "off"
    address: str = ""
    session: int = 0
    identity: DeviceInfo | None = None
    rig: Rig | None = None
    stated: Limits | None = None
    calibration: Calibration | None = None
    weighs: bool = False
    reason: str = ""
    unseen: str = ""


SPEED_LIMIT = "speed, rpm"  # name of the LimitShare of speed


@dataclass(frozen=True, slots=True)
class LimitShare:
    """State how near a reading is to its limit; `share` is 1 at the limit."""

    name: str
    value: float
    limit: float
    share: float


@dataclass(frozen=True, slots=True)
class LiveValue:
    """State a mean since the last status, or what follows from such means."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStatus:
    """State what the bench does just now, a few times a second.

    Attributes:
        pulses_us: commanded, one for each rotor.
        rate_Hz: samples per second of the bench's clock.
        limits: how near each reading has been to its limit since the last of these.
        values: thrust, torque, power, efficiency and so on, as far as they are measured.
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
    values: tuple[LiveValue, ...] = ()
    armed: bool = False
    speed: float = 0.0
    weighed: tuple[tuple[float, float], ...] = ()
    busy: str = ""
    standstill: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepStatus:
    """State how far a sweep or a recording is.

    Attributes:
        status: "none" before the first one; "closing" while files are finished.
        kind: what it is; a recording has no visits.
        visits, done, left_s: planned, measured, and how long the rest takes.
        now: present visit, in words.
        reason: why it ended early, or its summary.
    """

    status: Literal[
        "none", "running", "pausing", "paused", "asking", "closing", "ended", "stopped"
    ] = "none"
    kind: Literal["sweep", "pitch", "live"] = "sweep"
    run: str = ""
    visits: int = 0
    done: int = 0
    left_s: float = 0.0
    now: str = ""
    question: str = ""
    reason: str = ""

    @property
    def what(self) -> str:
        return "sweep" if self.kind == "sweep" else "recording"

    @property
    def active(self) -> bool:
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
