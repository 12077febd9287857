"""The seam to hardware: what a rotor bench is, whoever answers.

A `Bench` is a device with motors, a plate and a stream of readings. Drivers block, with a timeout.
The time of a bench is its own (`now_s`): the wall clock of a real one, a virtual clock of a
simulated one, so that nothing above this seam ever sleeps on real time by itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import LinkLost


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceInfo:
    """Say who answers.

    Attributes:
        device_id: the device's own unchanging name (serial number).
        firmware: name and version in the device's words.
        channels: what the stream carries, in order, without the two times.
        channel_rates_Hz: how often each channel has a new value; empty where the device does not
            say.
        simulated: True when no physical motor turns.
        watchdog_s: the device stops its motors after so long without a heartbeat.
        has_loop: a control loop on the bench makes the pulses once it is armed.
        armed_by_operator: somebody else than the host may arm that loop, as with a transmitter.
        pwm_stop_us: pulse at which the motors stand still; None where the device gives none.
        pwm_idle_us: longest pulse at which the plate may move; None where the device gives none.
        outputs_measured: `pwm1_us` and so on are outputs that were read back, not the host's own
            commands repeated.
        longest_delay_s: longest time, on the bench's clock, that an order took so far, where orders
            carry no age: one may still come so long after a stop. 0 where late orders are refused.
        speed: bench seconds per wall second, above 1 for a virtual bench that runs faster.
        orders_protected: whether the device refuses an order that comes late, as after a stop.
        channel_hash: CRC of names and units of the channels, as the device repeats it when it is
            armed; empty where the device knows none.
        facts: anything else worth keeping with a run; for people, no decision hangs on them.
    """

    address: str
    device_id: str
    firmware: str
    protocol: str
    channels: tuple[Channel, ...]
    rate_Hz: float
    n_rotors: int
    simulated: bool
    moves_plate: bool
    limits: Mapping[str, float] = field(default_factory=dict)
    watchdog_s: float = 0.25
    channel_rates_Hz: tuple[float, ...] = ()
    has_loop: bool = False
    armed_by_operator: bool = False
    pwm_stop_us: float | None = None
    pwm_idle_us: float | None = None
    outputs_measured: bool = False
    longest_delay_s: float = 0.0
    speed: float = 1.0
    orders_protected: bool = False
    channel_hash: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Hold the samples that arrived since the last read.

    Attributes:
        time_s: (m,) host time of each sample on the bench's clock.
        device_time_us: (m,) device time, unwrapped, microseconds.
        values: (m, c) in the order and units of `DeviceInfo.channels`; nan where a channel had no
            new value at that instant.
        lost: samples that the sequence numbers say were lost since the last read.
        corrupt: frames thrown away for a wrong checksum since the last read.
        repeated: samples left out since the last read because they came twice, or too late to be
            put in order.
        messages: the device's own events and warnings, oldest first.
    """

    time_s: Array
    device_time_us: Array
    values: Array
    lost: int = 0
    corrupt: int = 0
    messages: tuple[str, ...] = ()
    repeated: int = 0

    def __len__(self) -> int:
        return len(self.time_s)


@runtime_checkable
class Bench(Protocol):
    """Command motors and plate, and read the stream; every method blocks at most its timeout.

    A bench is a context manager: leaving it commands zero, closes the link and never raises over
    the error that is already on its way, except StandstillNotSeen with that error as its cause.
    """

    @property
    def identity(self) -> DeviceInfo:
        """Who answers; known once the bench is open."""

    def now_s(self) -> float:
        """Return the bench's clock in seconds, monotonic."""

    def open(self) -> None:
        """Open the link and learn who answers.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or nothing answers on it.
            ProtocolError: it answers, but not in a protocol that we speak.
        """

    def close(self) -> None:
        """Command zero if that is still possible and close the link; safe to call twice."""

    def set_pwm(self, pwm_us: Array) -> None:
        """Command every motor's pulse (n_rotors,): us; the acknowledgement has been read.

        Raises:
            CommandRefused: the device refused it.
            LinkLost: no acknowledgement came.
        """

    def stop(self) -> None:
        """Command zero to every motor and halt the plate at once; a second stop is no error."""

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Ask for a plate position and return when it stands there.

        Raises:
            StageError: the stage refused, alarmed, or did not arrive in time.
        """

    def tare(self) -> None:
        """Let the device take the present load-cell reading as zero thrust."""

    def set_rate(self, rate_Hz: float) -> None:
        """Ask for a stream rate.

        Raises:
            InputError: the rate does not fit the link; the message carries the arithmetic.
        """

    def read(self, timeout_s: float) -> Readings:
        """Return what arrived, waiting at most `timeout_s` for the first sample.

        A heartbeat is sent as often as the device's watchdog needs it while reading. On a virtual
        clock the call advances time by `timeout_s`.

        Raises:
            LinkLost: the link broke or stayed silent for longer than the stale limit.
            DeviceStopped: the device says that it stopped by itself; raised once, later reads
                give what it still sends.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def concatenate_readings(parts: Sequence[Readings]) -> Readings:
    """Return one block of all samples, losses added up, messages in order."""
    if len(parts) == 1:
        return parts[0]
    return Readings(
        time_s=np.concatenate([part.time_s for part in parts]),
        device_time_us=np.concatenate([part.device_time_us for part in parts]),
        values=np.concatenate([part.values for part in parts]),
        lost=sum(part.lost for part in parts),
        corrupt=sum(part.corrupt for part in parts),
        messages=tuple(message for part in parts for message in part.messages),
        repeated=sum(part.repeated for part in parts),
    )


class ContextBench(ABC):
    """Make a context manager of a driver that has `open` and `close`."""

    address = ""
    _identity: DeviceInfo | None = None

    @property
    def identity(self) -> DeviceInfo:
        """Who answers, from `open` on; a driver stores it in `_identity`, None while closed."""
        if self._identity is None:
            raise LinkLost(f"{self.address} is not open; open it first")
        return self._identity

    @abstractmethod
    def open(self) -> None: ...

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


Listener = Callable[[Readings], None]  # gets each block once, in order; quick, never raises


@runtime_checkable
class Subscribable(Protocol):
    """Publish samples as they come, whatever call waits for the device."""

    def subscribe(self, listener: Listener) -> None:
        """Give a listener every block from now on, before `read` hands it out, in its thread."""


class StreamingBench(ContextBench):
    """Be a driver whose samples come by themselves.

    Those that come during a command are held for the next read; a listener gets each at once.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._listener: Listener | None = None
        self._forget()

    def subscribe(self, listener: Listener) -> None:
        self._listener = listener

    def _forget(self) -> None:
        """Forget everything that was not read."""
        self._waiting: list[Readings] = []
        self._losses: list[Readings] = []  # losses and messages without a sample to go with

    def _hold(self, readings: Readings) -> None:
        """Hold a block for the next read; one without samples goes along with the next samples."""
        if len(readings):
            self._waiting.append(self._published(readings))
        else:
            self._losses.append(readings)

    def _held(self) -> Readings | None:
        """Return the samples that wait, in one block; None where there are none."""
        waiting, self._waiting = self._waiting, []
        return concatenate_readings(waiting) if waiting else None

    def _held_or(self, fresh: Callable[[], Readings]) -> Readings:
        held = self._held()
        return self._published(fresh()) if held is None else held

    def _published(self, readings: Readings) -> Readings:
        counts, self._losses = self._losses, []
        readings = concatenate_readings([*counts, readings])
        if self._listener is not None:
            self._listener(readings)
        return readings
