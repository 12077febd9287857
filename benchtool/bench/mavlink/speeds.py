"""Which of several speed messages of an autopilot lives, rotor by rotor. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

SPEED_SOURCES = ("ESC_TELEMETRY", "ESC_STATUS", "RAW_RPM", "RPM")
"""Messages that carry speeds, the most trusted first: ESCs name the motor they turn."""

DEAD_US = 1_000_000
"""A channel that reads 0 for so long while its motor is driven is dead: an ESC without telemetry
reads 0 for ever. A choice, above the time in which small rotors start."""


@dataclass(slots=True)
class _Rotor:
    chosen: str = ""
    zero_since_us: dict[str, int] = field(default_factory=dict)
    lively: set[str] = field(default_factory=set)
    dead: set[str] = field(default_factory=set)


class SpeedSources:
    """Take speeds from whichever message lives, and withhold those of a dead one.

    Args:
        n_rotors: how many rotors there are.
    """

    def __init__(self, n_rotors: int) -> None:
        self._rotors = [_Rotor() for _ in range(n_rotors)]
        self._news: list[str] = []

    def take(self, source: str, rotor: int, rpm: float, driven: bool, time_us: int) -> bool:
        """Note a reading; tell whether it is the speed of that rotor (from 0).

        Args:
            source: one of `SPEED_SOURCES`.
            rotor: number from 0.
            rpm: reading.
            driven: whether the rotor's output is above idle.
            time_us: of the reading, on the autopilot's clock.
        """
        state = self._rotors[rotor]
        if rpm != 0.0:
            state.lively.add(source)
            state.dead.discard(source)
            state.zero_since_us.pop(source, None)
        elif not driven:
            state.zero_since_us.pop(source, None)
        elif time_us - state.zero_since_us.setdefault(source, time_us) >= DEAD_US:
            self._bury(rotor, source)
        if not state.chosen or (
            state.chosen not in state.lively
            and SPEED_SOURCES.index(source) < SPEED_SOURCES.index(state.chosen)
        ):
            state.chosen = source
        if state.chosen in state.dead and source in state.lively - state.dead:
            self._news.append(f"rpm{rotor + 1} is taken from {source} now")
            state.chosen = source
        return source == state.chosen and source not in state.dead

    def take_news(self) -> list[str]:
        """Return what was found out since the last call, in words."""
        news, self._news = self._news, []
        return news

    def _bury(self, rotor: int, source: str) -> None:
        state = self._rotors[rotor]
        if source in state.dead:
            return
        state.dead.add(source)
        if source == state.chosen:
            self._news.append(
                f"rpm{rotor + 1} of {source} reads 0 while its motor is driven: a dead channel, "
                f"not a speed; switch the ESC's telemetry on or leave it out with rpm=none"
            )
