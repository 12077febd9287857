"""Bench interface. Drivers block with a timeout, and time stamps are bench time (`now_s`).

Bench time is the wall clock of a real bench and a virtual clock of a simulated one, so code that
uses a `Bench` never sleeps on wall time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import LinkLost
from benchtool.core.units import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceInfo:
    """Device information."""

    address: str
    device_id: str  # permanent identifier of the device (serial number)
    firmware: str  # name and version as the device reports them
    protocol: str
    channels: tuple[Channel, ...]  # channels of the stream, in order, without the two time columns
    rate_Hz: float
    n_rotors: int
    simulated: bool  # True if no physical motor turns
    moves_plate: bool
    limits: Mapping[str, float] = field(default_factory=dict)
    watchdog_s: float = 0.25  # the device stops its motors after this time without a heartbeat
    # Update rate of each channel; empty if the device does not report it
    channel_rates_Hz: tuple[float, ...] = ()
    has_loop: bool = False  # an armed control loop on the bench sets the pulse widths
    # The loop may be armed without the host, for example by a transmitter
    armed_by_operator: bool = False
    # Pulse width at motor standstill; None if the device does not report it
    pwm_stop_us: float | None = None
    # Longest pulse width at which the plate may move; None if not reported
    pwm_idle_us: float | None = None
    # `pwm1_us` and so on are outputs that were read back, not a copy of the host's commands
    outputs_measured: bool = False
    # Longest delay of a command so far, bench time, if commands carry no age: a command may arrive
    # this long after a stop. 0 if the device rejects late commands
    longest_delay_s: float = 0.0
    # Bench seconds per wall second, above 1 for a virtual bench that runs faster
    speed: float = 1.0
    # The device rejects late commands, for example after a stop
    rejects_late_commands: bool = False
    # CRC of channel names and units, repeated by the device when it is armed; empty if the device
    # reports none
    channel_hash: str = ""
    # Further metadata stored with a run; for display only
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Samples received since the last read.

    Attributes:
        time_s: (m,) host time of each sample, bench time.
        device_time_us: (m,) device time, unwrapped, microseconds.
        values: (m, c) in the order and units of `DeviceInfo.channels`; nan where a channel had no
            new value at that instant.
        lost: samples lost since the last read, by sequence number.
        corrupt: frames with a wrong checksum since the last read, discarded.
        repeated: samples discarded since the last read: duplicates, or too late to be reordered.
        messages: events and warnings of the device, oldest first.
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
    """Motor and plate commands, and the stream; every method blocks at most its timeout.

    A bench is a context manager. Leaving it commands zero and closes the link. It raises nothing
    over an exception in flight, except StandstillNotSeen, with that exception as its cause.
    """

    @property
    def identity(self) -> DeviceInfo:
        """Device information; available once the bench is open."""

    def now_s(self) -> float:
        """Return the bench time in seconds, monotonic."""

    def open(self) -> None:
        """Open the link and read the device information.

        Raises:
            PortBusy, PortDenied, NoDevice: the port is not available, or no device replies.
            ProtocolError: the reply is not in a supported protocol.
        """

    def close(self) -> None:
        """Command zero if that is still possible and close the link; safe to call twice."""

    def set_pwm(self, pwm_us: Array) -> None:
        """Command the pulse width of every motor (n_rotors,): us; wait for the acknowledgement.

        Raises:
            CommandRefused: rejected by the device.
            LinkLost: no acknowledgement within the timeout.
        """

    def stop(self) -> None:
        """Command zero to every motor and stop the plate at once; a second stop is no error."""

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Move the plate and return after its arrival.

        Raises:
            StageError: the stage rejected the move, raised an alarm, or did not arrive in time.
        """

    def tare(self) -> None:
        """Tare the load cell on the device: the present reading becomes zero thrust."""

    def set_rate(self, rate_Hz: float) -> None:
        """Request a stream rate.

        Raises:
            InputError: the rate exceeds the link's bandwidth; the message contains the calculation.
        """

    def read(self, timeout_s: float) -> Readings:
        """Return the received samples; wait at most `timeout_s` for the first.

        Heartbeats are sent while reading, as often as the device's watchdog requires. On a virtual
        clock the call advances time by `timeout_s`.

        Raises:
            LinkLost: the link broke or was silent for longer than the stale limit.
            DeviceStopped: the device reports that it stopped its motors; raised once, later reads
                return the samples that still arrive.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def concatenate_readings(parts: Sequence[Readings]) -> Readings:
    """Return one block of all samples, with summed losses and messages in order."""
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
    """Base class of drivers: a context manager that calls `open` and `close`."""

    address = ""
    _identity: DeviceInfo | None = None

    @property
    def identity(self) -> DeviceInfo:
        """Device information from `open` on; a driver stores it in `_identity`, None if closed."""
        if self._identity is None:
            raise LinkLost(f"{self.address} is not open; call open() first")
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


Listener = Callable[[Readings], None]  # receives each block once, in order; fast, never raises


class StreamingBench(ContextBench):
    """Driver of a device that streams without requests.

    Samples that arrive during a command are buffered for the next read; the listener gets each
    block immediately.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._listener: Listener | None = None
        self._clear_buffer()

    def subscribe(self, listener: Listener) -> None:
        """Pass every later block to the listener, before `read` returns it, in its thread."""
        self._listener = listener

    def _clear_buffer(self) -> None:
        """Discard all unread samples."""
        self._buffered: list[Readings] = []
        self._losses: list[Readings] = []  # losses and messages of blocks without samples

    def _buffer_readings(self, readings: Readings) -> None:
        """Buffer a block for the next read; one without samples joins the next samples."""
        if len(readings):
            self._buffered.append(self._publish(readings))
        else:
            self._losses.append(readings)

    def _take_buffered(self) -> Readings | None:
        """Return the buffered samples as one block and clear the buffer; None if it is empty."""
        buffered, self._buffered = self._buffered, []
        return concatenate_readings(buffered) if buffered else None

    def _publish(self, readings: Readings) -> Readings:
        counts, self._losses = self._losses, []
        readings = concatenate_readings([*counts, readings])
        if self._listener is not None:
            self._listener(readings)
        return readings
