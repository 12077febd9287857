"""Exception hierarchy with exit codes.

    BenchtoolError                 exit code 1
    ├── InputError                 2   invalid user input
    │   ├── UnknownChoice          2   name outside a known list (driver, key, unit, effect)
    │   ├── FileFormatError        2   invalid content of a file
    │   ├── PlanError              2   plan that exceeds the bench or its limits
    │   ├── CalibrationError       2   invalid calibration
    │   └── WouldOverwrite         2   target exists
    ├── BenchError                 3   bench or link failure
    │   ├── LinkError              3   port or socket failure
    │   │   ├── PortBusy           3   another process uses the port
    │   │   ├── PortDenied         3   no permission
    │   │   ├── NoDevice           3   no device, or no reply
    │   │   ├── LinkLost           3   device stopped replying
    │   │   └── ReadingsLate       3   readings arrive late, or the device clock deviates
    │   ├── ProtocolError          3   invalid reply
    │   ├── CommandRefused         3   device rejected the command
    │   ├── LimitExceeded          4   reading beyond its limit
    │   ├── StageError             3   plate stage failure
    │   ├── DeviceStopped          4   device stopped its motors
    │   └── StandstillNotConfirmed 8   motors may still turn: standstill was not measured
    ├── RunInterrupted             5   run ended early and safely, with a reason
    │   └── HostSuspended          5   host was suspended longer than the maximum command age
    ├── EstimationError            6   no estimate possible
    │   └── NotConverged           6   sampler did not converge
    ├── MissingLibrary             7   optional package not installed
    ├── ModelRejected              9   estimate exists, but the data reject the model
    └── ResourceExhausted         10   disk, memory, file descriptors or output full or closed

A message is one sentence: problem, value with limit or known choices, remedy. Numbers are also
attributes, so that callers need not parse text.
"""

from __future__ import annotations

import copyreg
import re
import sys
from collections.abc import Iterable, Sequence
from math import inf
from typing import Any

MAX_LISTED = 60  # maximum names in a message, and characters of a name; assumed


def _listed(names: Sequence[str]) -> str:
    """Return names separated by commas, at most `MAX_LISTED`."""
    more = f" and {len(names) - MAX_LISTED:,} more" if len(names) > MAX_LISTED else ""
    return (", ".join(names[:MAX_LISTED]) or "none") + more


class BenchtoolError(Exception):
    """Base class of all benchtool errors."""

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        # Subclasses take more arguments than a text; unpickle without calling __init__.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class InputError(BenchtoolError):
    """Invalid user input."""

    exit_code = 2


def check_number(what: str, value: object, unit: str) -> None:
    """Raise InputError for a value that is not a finite number above 0."""
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
    """Name outside a known list.

    Args:
        kind: noun in the singular ("unit", "key in [limits] of plan.toml").
    """

    def __init__(self, kind: str, name: str, choices: Iterable[str]) -> None:
        from difflib import get_close_matches

        self.kind = kind
        self.name = name
        self.choices = tuple(sorted(choices))
        name = name[: 4 * MAX_LISTED]
        # A parameter may also be given by the part after its dot.
        parts = {full.rpartition(".")[2].casefold(): full for full in self.choices if "." in full}
        folded = parts | {full.casefold(): full for full in self.choices}
        folded = {short: full for short, full in folded.items() if len(short) > 1}
        close = get_close_matches(name.casefold(), folded, n=1)
        longer = [text for text in sorted(folded, key=len) if text.startswith(name.casefold())]
        close = close or longer[: len(name) > 1]
        hint = f"did you mean {folded[close[0]]!r}? " if close else ""
        label = name if len(name) <= MAX_LISTED else f"{name[:MAX_LISTED]}..."
        super().__init__(f"unknown {kind} {label!r}; {hint}known: {_listed(self.choices)}")


class FileFormatError(InputError):
    """Invalid content of a file.

    `where` is the file, with line or key if available.
    """

    def __init__(self, where: str, problem: str) -> None:
        self.where = where
        self.problem = problem
        super().__init__(f"{where}: {problem}")


class MissingColumn(InputError):
    """File without a column of the map.

    No similar column is proposed: a similar name may be another quantity (reference and angle).
    `mapped_by` is the file of the map.
    """

    def __init__(
        self, where: str, missing: Iterable[str], columns: Iterable[str], mapped_by: str = ""
    ) -> None:
        self.where = where
        self.missing = tuple(missing)
        self.columns = tuple(columns)
        of = f" of {mapped_by}" if mapped_by else ""
        listed = _listed([name for name in self.columns if name])
        super().__init__(
            f"[columns]{of} names {', '.join(map(repr, self.missing))}, which {where} lacks; its "
            f"columns are {listed}"
        )

    def with_map_file(self, mapped_by: str) -> MissingColumn:
        """Return the error with the file of the map."""
        return MissingColumn(self.where, self.missing, self.columns, mapped_by)


class DataWarning(UserWarning):
    """Repairable defect of data."""


class PlanError(InputError):
    """Invalid plan, or a plan that exceeds the limits of the bench."""


class CalibrationError(InputError):
    """Invalid calibration."""


class WouldOverwrite(InputError):
    """Rejected write to an existing file or folder."""

    def __init__(self, path: str, option: str = "", out: str = "") -> None:  # options
        self.path = path
        remedy = f" with {out}" if out else ""
        remedy += f", or replace it with {option}" if option else ", or delete it"
        super().__init__(f"{path} exists already and was not changed; choose another name{remedy}")


class BenchError(BenchtoolError):
    """Bench or link failure."""

    exit_code = 3


class LinkError(BenchError):
    """Port or socket failure."""


class PortBusy(LinkError):
    """Port in use by another process."""


class PortDenied(LinkError):
    """No permission to open the port."""


class NoDevice(LinkError):
    """No device, or no reply."""


class LinkLost(LinkError):
    """Device stopped replying."""


class ReadingsLate(LinkError):
    """Readings that are old or stamped in the future, unusable for a standstill check.

    Args:
        age_s: of the newest reading, wall time; below 0 if it is in the future.
        speed: of the bench's clock, as reported.
    """

    def __init__(self, age_s: float, limit_s: float, speed: float) -> None:
        self.age_s = age_s
        self.limit_s = limit_s
        if age_s > 0.0:
            super().__init__(
                f"the newest reading is {age_s:.1f} s old, limit {limit_s:g} s: this computer is "
                f"too slow for the stream, or the bench slower than {speed:g} times real time; "
                f"zero was commanded; close other programs, use a lower rate, or serve a virtual "
                f"bench with a lower --speed"
            )
        else:
            super().__init__(
                f"the newest reading is {-age_s:.1f} s ahead of this computer's clock, limit "
                f"{limit_s:g} s: the bench's clock runs faster than the reported {speed:g} times "
                f"real time; zero was commanded; reconnect, and check the bench's clock if this "
                f"repeats"
            )


class ProtocolError(BenchError):
    """Invalid reply of the device."""


class CommandRefused(BenchError):
    """Command rejected by the device."""

    def __init__(self, command: str, reason: str) -> None:
        self.command = command
        self.reason = reason
        super().__init__(f"the device refused {command!r}: {reason}")


class LimitExceeded(BenchError):
    """Reading beyond its limit; zero was commanded to the motors."""

    exit_code = 4

    def __init__(self, channel: str, value: float, limit: float, advice: str) -> None:
        self.channel = channel
        self.value = value
        self.limit = limit
        super().__init__(
            f"{channel} read {value:.6g}, limit {limit:.6g}; zero was commanded; {advice}"
        )


class StageError(BenchError):
    """Failure or rejection of the plate stage."""


class DeviceStopped(BenchError):
    """Device stopped its motors and reported the reason."""

    exit_code = 4


class StandstillNotConfirmed(BenchError):
    """Motors may still turn after a stop: standstill was not measured.

    Args:
        message: readings, and the request to cut the power.
        rpm: highest speed in the last readings; nan without speed sensor.
    """

    exit_code = 8

    def __init__(self, message: str, rpm: float = float("nan")) -> None:
        self.rpm = rpm
        super().__init__(message)


class RunInterrupted(BenchtoolError):
    """Run ended early and safely, with a reason."""

    exit_code = 5


class HostSuspended(RunInterrupted):
    """Host suspended longer than the maximum age of a command."""

    def __init__(self, paused_s: float, limit_s: float) -> None:
        self.paused_s = paused_s
        self.limit_s = limit_s
        super().__init__(
            f"benchtool was not running for {paused_s:.1f} s, limit {limit_s:g} s (computer "
            f"suspended or busy); zero was commanded to the motors; keep the computer awake and "
            f"free during a run"
        )


class EstimationError(BenchtoolError):
    """No estimate possible."""

    exit_code = 6


class NotConverged(EstimationError):
    """Sampler did not converge; the message has the remedy."""


class MissingLibrary(BenchtoolError):
    """Optional package or system library not installed.

    Args:
        extra: benchtool extra that installs it.
        install: installation hint if there is no extra.
    """

    exit_code = 7

    def __init__(self, package: str, purpose: str, extra: str = "", install: str = "") -> None:
        self.package = package
        hint = install or f"install it with: pip install benchtool[{extra}]"
        super().__init__(f"{purpose} needs {package}; {hint}")


class ModelRejected(BenchtoolError):
    """Estimate exists, but the data reject the model."""

    exit_code = 9


class ResourceExhausted(BenchtoolError):
    """Disk, memory, file descriptors or output full or closed."""

    exit_code = 10


_CONTROLS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


def show_controls(text: str) -> str:
    r"""Return a text with control and bidi characters (not newline, tab) escaped as `\u202e`."""
    return _CONTROLS.sub(
        lambda match: f"\\x{ord(match[0]):02x}" if match[0] < "\x80" else f"\\u{ord(match[0]):04x}",
        text,
    )


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a `DataWarning` as one line; other warnings are suppressed."""
    if issubclass(category, DataWarning):
        sys.stderr.write(f"benchtool: warning: {show_controls(str(message))}\n")
