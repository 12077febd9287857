"""Every error that benchtool raises on purpose.

    BenchtoolError                 exit code 1
    ├── InputError                 2   something the user gave cannot be used
    │   ├── UnknownChoice          2   a name outside a known list (driver, key, unit, effect)
    │   ├── FileFormatError        2   a file that does not say what it must
    │   ├── PlanError              2   a plan the bench or its limits do not allow
    │   ├── CalibrationError       2   a calibration that does not hold
    │   └── WouldOverwrite         2   the target exists already
    ├── BenchError                 3   the bench or its link
    │   ├── LinkError              3   the port or socket
    │   │   ├── PortBusy           3   somebody else holds it
    │   │   ├── PortDenied         3   no permission
    │   │   ├── NoDevice           3   nothing there, or nothing that answers
    │   │   ├── LinkLost           3   it answered and went silent
    │   │   └── ReadingsLate       3   what it sends is read too late, or its clock runs apart
    │   ├── ProtocolError          3   an answer that makes no sense
    │   ├── CommandRefused         3   the device refused
    │   ├── LimitExceeded          4   a reading beyond its limit
    │   ├── StageError             3   the plate's stage
    │   ├── DeviceStopped          4   the device stopped its motors by itself
    │   └── StandstillNotSeen      8   motors may still turn: no measurement shows that they stand
    ├── RunStopped                 5   a run ended early, safely, for a stated reason
    │   └── HostPaused             5   the host did not run for longer than an order may be old
    ├── EstimationError            6   no estimate can be given
    │   └── NotConverged           6   a sampler that has not converged
    ├── MissingLibrary             7   an optional package is not installed
    ├── ModelRejected              9   an estimate exists, but the data reject the model
    └── ResourceExhausted         10   the disk, memory, descriptors or output are full or closed

A message is one sentence: what happened, the value against the limit or the known choices, and
what to do next. The numbers are attributes too, so that no caller parses text.
"""

from __future__ import annotations

import copyreg
import re
import sys
from collections.abc import Iterable, Sequence
from math import inf
from typing import Any

MAX_LISTED = 60  # most names in a message, and most letters of a repeated name; assumed


def _listed(names: Sequence[str]) -> str:
    """Return names with commas; of many only the first."""
    rest = f" and {len(names) - MAX_LISTED:,} more" if len(names) > MAX_LISTED else ""
    return (", ".join(names[:MAX_LISTED]) or "none") + rest


class BenchtoolError(Exception):
    """Root of everything benchtool raises on purpose."""

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        # Many subclasses take more than a text: a pickled error is made without them.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class InputError(BenchtoolError):
    """Refuse something the user gave."""

    exit_code = 2


def check_number(what: str, value: object, unit: str) -> None:
    """Refuse what is no number above 0, where no input of a command has checked it.

    Raises:
        InputError: with the value and the unit it should have.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < inf:
        raise InputError(f"{what} is {value!r}; give a number above 0, in {unit}")


_NAME = re.compile(r"[^\W_][\w.-]*")


def check_name(kind: str, name: str, *, max_length: int = 255, ascii_only: bool = False) -> None:
    """Raise InputError for a name with other characters than letters, digits and `._-`."""
    if not _NAME.fullmatch(name) or len(name) > max_length or (ascii_only and not name.isascii()):
        raise InputError(
            f"{name[:80]!r} cannot name a {kind}; use letters, digits, '.', '_' and '-', a letter "
            f"or digit first, at most {max_length} characters"
        )


class UnknownChoice(InputError):
    """Refuse a name outside a known list.

    Args:
        kind: what was named, in the singular ("unit", "key in [limits] of plan.toml").
        name: the name as given.
        known: the names that would have been accepted.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        from difflib import get_close_matches

        self.kind = kind
        self.name = name
        self.known = tuple(sorted(known))
        name = name[: 4 * MAX_LISTED]
        # A parameter is also known by what stands behind the dot.
        parts = {each.rpartition(".")[2].casefold(): each for each in self.known if "." in each}
        folded = parts | {each.casefold(): each for each in self.known}
        folded = {each: full for each, full in folded.items() if len(each) > 1}
        close = get_close_matches(name.casefold(), folded, n=1)
        begun = [each for each in sorted(folded, key=len) if each.startswith(name.casefold())]
        close = close or begun[: len(name) > 1]
        hint = f"did you mean {folded[close[0]]!r}? " if close else ""
        shown = name if len(name) <= MAX_LISTED else f"{name[:MAX_LISTED]}..."
        super().__init__(f"unknown {kind} {shown!r}; {hint}known: {_listed(self.known)}")


class FileFormatError(InputError):
    """Refuse a file that does not say what it must.

    Args:
        where: the file, with the line or key when there is one.
        problem: what is wrong and what to do next.
    """

    def __init__(self, where: str, problem: str) -> None:
        self.where = where
        self.problem = problem
        super().__init__(f"{where}: {problem}")


class MissingColumn(InputError):
    """Refuse a file without a column that a map names.

    No other column is proposed: one that is merely spelt alike (a reference for an angle) would be
    read for it without a word.

    Args:
        where: the file.
        column: its name in the map.
        known: the columns that the file has.
        mapped_by: the file that holds the map, where that is known.
    """

    def __init__(self, where: str, column: str, known: Iterable[str], mapped_by: str = "") -> None:
        self.where = where
        self.column = column
        self.known = tuple(known)
        of = f" of {mapped_by}" if mapped_by else ""
        listed = _listed([name for name in self.known if name])
        super().__init__(
            f"[columns]{of} names {column!r}, which {where} lacks; its columns are {listed}"
        )

    def of(self, mapped_by: str) -> MissingColumn:
        """Return the same with the file that holds the map."""
        return MissingColumn(self.where, self.column, self.known, mapped_by)


class DataWarning(UserWarning):
    """Defect of data that can still be read."""


class PlanError(InputError):
    """Refuse a plan that the bench or its limits do not allow."""


class CalibrationError(InputError):
    """Refuse a calibration that does not hold."""


class WouldOverwrite(InputError):
    """Refuse to write over what exists.

    Args:
        path: what is there.
        option: the option that replaces it; empty where nothing does.
    """

    def __init__(self, path: str, option: str = "") -> None:
        self.path = path
        way = f", or replace it with {option}" if option else ""
        super().__init__(f"{path} exists already and was left as it is; choose another name{way}")


class BenchError(BenchtoolError):
    """The bench or its link failed."""

    exit_code = 3


class LinkError(BenchError):
    """The port or socket failed."""


class PortBusy(LinkError):
    """Somebody else holds the port."""


class PortDenied(LinkError):
    """The port may not be opened by this user."""


class NoDevice(LinkError):
    """Nothing is there, or nothing that answers."""


class LinkLost(LinkError):
    """The device answered before and went silent."""


class ReadingsLate(LinkError):
    """Readings are old when they are read, or stamped ahead of time; no rotor is judged by them.

    Args:
        age_s: of the newest reading, wall time; below 0 where it is stamped ahead.
        limit_s: the largest difference that is none.
        speed: of the bench's clock, as it states it.
    """

    def __init__(self, age_s: float, limit_s: float, speed: float) -> None:
        self.age_s = age_s
        self.limit_s = limit_s
        if age_s > 0.0:
            super().__init__(
                f"the newest reading was {age_s:.1f} s old when it was read, limit {limit_s:g} s: "
                f"this computer reads more slowly than the bench sends, or the bench runs more "
                f"slowly than {speed:g} times life; zero was commanded; free the computer, ask for "
                f"a lower rate, or serve a virtual bench with a lower --speed"
            )
        else:
            super().__init__(
                f"the newest reading is stamped {-age_s:.1f} s ahead of this computer's clock, "
                f"limit {limit_s:g} s: the bench's clock runs faster than {speed:g} times life, "
                f"which is what it states; zero was commanded; connect again, and check the "
                f"bench's clock if that stays"
            )


class ProtocolError(BenchError):
    """The device answered something that makes no sense."""


class CommandRefused(BenchError):
    """The device refused a command.

    Args:
        command: the command as sent.
        reason: the device's own words.
    """

    def __init__(self, command: str, reason: str) -> None:
        self.command = command
        self.reason = reason
        super().__init__(f"the device refused {command!r}: {reason}")


class LimitExceeded(BenchError):
    """A reading went beyond its limit; zero was commanded to the motors.

    Args:
        channel: channel name with its unit suffix.
        value: what was read.
        limit: the limit that it broke.
        advice: what to do next.
    """

    exit_code = 4

    def __init__(self, channel: str, value: float, limit: float, advice: str) -> None:
        self.channel = channel
        self.value = value
        self.limit = limit
        super().__init__(
            f"{channel} read {value:.6g}, limit {limit:.6g}; zero was commanded; {advice}"
        )


class StageError(BenchError):
    """The stage that moves the plate failed or refused."""


class DeviceStopped(BenchError):
    """The device stopped its motors by itself and gave the reason."""

    exit_code = 4


class StandstillNotConfirmed(BenchError):
    """Motors may still turn after a stop: no measurement shows that they stand.

    Args:
        message: what was seen, and that the power must be cut.
        rpm: the fastest speed that was measured last; nan where nothing measures speed.
    """

    exit_code = 8

    def __init__(self, message: str, rpm: float = float("nan")) -> None:
        self.rpm = rpm
        super().__init__(message)


class RunInterrupted(BenchtoolError):
    """A run ended early, safely, for a stated reason."""

    exit_code = 5


class HostSuspended(RunInterrupted):
    """The host did not run for longer than an order may be old.

    Args:
        paused_s: how long it did not run.
        limit_s: the longest pause after which a run goes on.
    """

    def __init__(self, paused_s: float, limit_s: float) -> None:
        self.paused_s = paused_s
        self.limit_s = limit_s
        super().__init__(
            f"this computer did not run benchtool for {paused_s:.1f} s, limit {limit_s:g} s "
            f"(suspended, or busy with other work); zero was commanded to the motors; keep the "
            f"computer awake and free for the run"
        )


class EstimationError(BenchtoolError):
    """No estimate can be given."""

    exit_code = 6


class NotConverged(EstimationError):
    """A sampler has not converged; the message says what to change."""


class MissingLibrary(BenchtoolError):
    """An optional package or system library is not installed.

    Args:
        package: what is missing.
        purpose: what needs it.
        extra: of benchtool's own that brings it.
        install: how to install it where no extra does.
    """

    exit_code = 7

    def __init__(self, package: str, purpose: str, extra: str = "", install: str = "") -> None:
        self.package = package
        how = install or f"install it with: pip install benchtool[{extra}]"
        super().__init__(f"{purpose} needs {package}; {how}")


class ModelRejected(BenchtoolError):
    """An estimate exists, but the data reject the model."""

    exit_code = 9


class ResourceExhausted(BenchtoolError):
    """The disk, the memory, the descriptors or the output of the process are full or closed."""

    exit_code = 10


_CONTROLS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


def show_controls(text: str) -> str:
    r"""Return a text with control and bidi characters but line ends and tabs as `\u202e`."""
    return _CONTROLS.sub(
        lambda found: f"\\x{ord(found[0]):02x}" if found[0] < "\x80" else f"\\u{ord(found[0]):04x}",
        text,
    )


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a `DataWarning` as one line; warnings of Python itself are not shown."""
    if issubclass(category, DataWarning):
        sys.stderr.write(f"benchtool: warning: {show_controls(str(message))}\n")
