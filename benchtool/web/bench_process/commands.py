"""Commands from the page to the bench process. `StopMotors` is not queued behind others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.pitch_experiment import PitchExperiment


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
    """Close the bench, motors at zero."""


@dataclass(frozen=True, slots=True)
class StopMotors:
    """Stop the motors and whatever runs, now."""

    who: str = "the page"


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
        tab: name of the browser's tab.
        press: number of this press, growing in a tab; one that has ended does not come back.
        pulse_us: commanded pulse.
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


@dataclass(frozen=True, slots=True)
class SetClockSpeed:
    """Run a virtual clock at a multiple of real time."""

    speed: float


@dataclass(frozen=True, slots=True)
class StartSweep:
    """Start a sweep, or resume the run that its inputs name.

    Attributes:
        inputs: as of the command line; the bench is the connected one.
        typed: what the operator typed to arm; empty to rely on a simulated or checked bench.
    """

    inputs: SweepInputs
    typed: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRecording:
    """Record a pitch experiment; `typed` as for a sweep."""

    experiment: PitchExperiment
    runs: Path = Path("runs")
    name: str = "pitch"
    typed: str = ""


@dataclass(frozen=True, slots=True)
class PauseSweep:
    """Let a sweep wait before its next visit, motors at zero; or continue it."""

    on: bool


@dataclass(frozen=True, slots=True)
class AnswerQuestion:
    """Answer the question that a sweep asks (a plate moved by hand)."""

    text: str


RunCommand = StartSweep | StartRecording
ThrottleCommand = HoldThrottle | ReleaseThrottle
LoadCellCommand = TareLoadCell | WeighMass | Calibrate
Command = (
    Connect | Disconnect | StopMotors | Shutdown | ArmMotors | ThrottleCommand | LoadCellCommand
    | MovePlateTo | SetClockSpeed | RunCommand | PauseSweep | AnswerQuestion
)  # fmt: skip
