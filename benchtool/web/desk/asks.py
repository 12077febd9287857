"""What the page asks of the bench process. Stop is no message like these: it goes ahead of all."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """Open a bench; `rig` may be empty where the address names one."""

    address: str
    rig: str = ""


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


Ask = Connect | Disconnect | Stop | Leave
