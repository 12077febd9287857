"""Messages between web server and bench process: commands and events.

`StopMotors` bypasses the command queue. Status events are complete snapshots.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from benchtool.acquire.inputs import RecordInputs, SweepInputs, WeighingInputs
from benchtool.bench.bench import DeviceInfo
from benchtool.core.channel import channel_family
from benchtool.core.errors import LimitExceeded
from benchtool.core.rig import Limits, Rig
from benchtool.data.calibration import Calibration
from benchtool.data.run.append import Event

# --- commands -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """Open a bench."""

    address: str
    rig: str = ""  # may be empty if the address names one
    is_weighing: bool = False  # load cell calibration without limits; rejects motor commands


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Set zero throttle and close the bench."""


@dataclass(frozen=True, slots=True)
class StopMotors:
    """Stop motors, sweep and recording at once."""

    source: str = "the page"


@dataclass(frozen=True, slots=True)
class ServerHeartbeat:
    """Heartbeat of the web server; `page_problem` of the page with the control lock, or ""."""

    page_problem: str = ""


@dataclass(frozen=True, slots=True)
class Shutdown:
    """Stop the motors, close the bench and end the process."""


@dataclass(frozen=True, slots=True)
class ArmMotors:
    """Arm the motors for manual throttle; `typed` is the operator's confirmation."""

    typed: str


@dataclass(frozen=True, slots=True)
class HoldThrottle:
    """Periodic report that the throttle button is held."""

    tab: str
    press: int  # increases per tab; an ended press is not resumed
    command_pwm_us: float
    rotors: tuple[int, ...]  # numbers from 1
    age_s: float = 0.0  # since the page last confirmed that the button was held


@dataclass(frozen=True, slots=True)
class ReleaseThrottle:
    """Report that the button was released; without a number, that its page was closed."""

    tab: str
    press: int | None = None


@dataclass(frozen=True, slots=True)
class TareLoadCell:
    """Set the current load cell reading to zero."""


@dataclass(frozen=True, slots=True)
class TightenLimits:
    """Apply limits narrower than the rig's until the bench is disconnected."""

    limits: Limits


@dataclass(frozen=True, slots=True)
class MovePlateTo:
    """Move the plate to a distance; the motors must be at standstill."""

    target_z_m: float


@dataclass(frozen=True, slots=True)
class WeighMass:
    """Average raw counts under a known mass for a calibration."""

    mass_kg: float
    seconds: float = 3.0


@dataclass(frozen=True, slots=True)
class Calibrate:
    """Fit and store a calibration from the weighed masses, or discard them."""

    store: bool = True
    weighing: WeighingInputs = field(default_factory=WeighingInputs)


@dataclass(frozen=True, slots=True)
class Annotate:
    """Add an operator's annotation to the events of the current run."""

    text: str


@dataclass(frozen=True, slots=True)
class SetClockSpeed:
    """Run a virtual clock at a multiple of real time."""

    speed: float


@dataclass(frozen=True, slots=True)
class StartRun:
    """Start a sweep or a pitch recording on the connected bench, or resume a sweep.

    With `needs_page`, a sweep pauses at zero throttle and a recording stops if the page with the
    control lock is lost.
    """

    inputs: SweepInputs | RecordInputs
    typed: str = ""  # arming confirmation; "" is accepted for a simulated or checked bench only
    needs_page: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StartLiveRecording:
    """Record under manual throttle until `EndRecording` or a stop."""

    runs: Path = Path("runs")
    name: str = "live"


@dataclass(frozen=True, slots=True)
class EndRecording:
    """End a live recording: set zero throttle and close the run."""


@dataclass(frozen=True, slots=True)
class PauseSweep:
    """Pause a sweep before its next point, at zero throttle, or continue it."""

    on: bool


@dataclass(frozen=True, slots=True)
class AnswerQuestion:
    """Answer to a question of a sweep (manual stage)."""

    text: str


Command = (
    Connect | Disconnect | StopMotors | ServerHeartbeat | Shutdown | ArmMotors | HoldThrottle
    | ReleaseThrottle | TareLoadCell | WeighMass | Calibrate | MovePlateTo | SetClockSpeed
    | StartRun | PauseSweep | AnswerQuestion | Annotate | StartLiveRecording | EndRecording
    | TightenLimits
)  # fmt: skip


# --- events -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectionStatus:
    """Connection status of the bench."""

    status: Literal["off", "opening", "on"] = "off"
    address: str = ""
    session: int = 0  # a new number means other channels and a new clock
    identity: DeviceInfo | None = None
    rig: Rig | None = None  # with the limits in force; None when off
    rig_limits: Limits | None = None  # of the rig file, the upper bound of `TightenLimits`
    calibration: Calibration | None = None
    is_weighing: bool = False  # for load cell calibration only; no motor can be commanded
    reason: str = ""  # of the disconnection; "" if commanded
    standstill_problem: str = ""  # reason why motors may still turn


def limits_by_family(limits: Limits) -> dict[str, float]:
    """Return the limits by channel family ("rpm", "pwm_us")."""
    thrust_N = min(limits.thrust_N, limits.load_cell_rating_N)
    return asdict(limits) | {"thrust_N": thrust_N, "voltage_V": limits.voltage_min_V}


SPEED_LIMIT = "speed"  # name of the LimitShare of speed
LIMITED = (
    ("thrust", "thrust_N", "N"),
    (SPEED_LIMIT, "rpm", "rpm"),
    ("pulse", "pwm_us", "us"),
    ("voltage", "voltage_V", "V"),
    ("current", "current_A", "A"),
    ("temperature", "temperature_degC", "°C"),
)
"""Readings with a limit: name, channel family, unit."""
DECIMALS = {"N": 2, "V": 2, "A": 1, "°C": 1}  # of readings by unit


def limit_message(error: LimitExceeded, limits: Limits, rig_limits: Limits) -> str:
    """Return the text of a limit that ended the connection under manual throttle."""
    bounds, rig_bounds = limits_by_family(limits), limits_by_family(rig_limits)
    for name, family, unit in LIMITED:
        limit, rig_limit = bounds[family], rig_bounds[family]
        # Thrust that is not plausible for its speed has another limit.
        if (channel_family(error.channel), abs(error.limit)) == (family, limit):
            rig = f" (rig: {rig_limit:g} {unit})" if limit != rig_limit else ""
            return (
                f"{name.capitalize()} limit reached: {error.value:.{DECIMALS.get(unit, 0)}f} "
                f"{unit}, limit {limit:g} {unit}{rig}. Motors are at zero. The bench was "
                f"disconnected{', your limits are removed' if limits != rig_limits else ''}. "
                f"{'Charge the battery' if unit == 'V' else 'Lower the pulse'}, then connect again."
            )
    return str(error)


@dataclass(frozen=True, slots=True)
class LimitShare:
    """Mean reading and its limit; `share` of the extreme reading is 0 at idle, 1 at the limit."""

    name: str
    unit: str
    value: float
    limit: float
    share: float
    is_minimum: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStatus:
    """Live status of the bench, published four times a second."""

    command_pwm_us: tuple[float, ...] = ()  # per rotor
    rate_Hz: float = 0.0  # samples per second of the bench's clock
    samples: int = 0
    lost: int = 0
    corrupt: int = 0
    limits: tuple[LimitShare, ...] = ()  # readings since the last status
    values: dict[str, tuple[float, str]] = field(default_factory=dict)  # see `live_values`
    armed: bool = False
    speed: float = 0.0  # of a virtual clock; 0 for real time
    weighed: tuple[tuple[float, float], ...] = ()  # (mass in kg, counts) of a calibration
    busy: str = ""  # name of a slow operation in progress
    standstill: str = ""  # sentence about rotors at standstill; "" while a motor is driven


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepStatus:
    """Progress of a sweep or a recording.

    The status is "none" before the first run, and "closing" while files are written.
    """

    status: Literal[
        "none", "running", "pausing", "paused", "asking", "closing", "ended", "stopped"
    ] = "none"
    kind: Literal["sweep", "pitch", "live"] = "sweep"
    run: str = ""
    n_points: int = 0  # 0 for a pitch recording
    n_measured: int = 0
    remaining_s: float = 0.0
    point_text: str = ""  # label of the current point
    question: str = ""
    reason: str = ""  # of an early end, or the summary

    @property
    def name(self) -> str:
        return Path(self.run).name

    @property
    def noun(self) -> str:
        return "sweep" if self.kind == "sweep" else "recording"

    @property
    def active(self) -> bool:
        return self.status in ("running", "pausing", "paused", "asking", "closing")


@dataclass(frozen=True, slots=True)
class PressEnded:
    """End of a throttle press other than by release."""

    tab: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Notification shown once on every page."""

    text: str
    is_error: bool = False


BenchEvent = ConnectionStatus | LiveStatus | SweepStatus | Event | PressEnded | Notice
