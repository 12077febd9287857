"""Are pulses seen at the outputs that were commanded? An acknowledgement proves nothing. Pure."""

from __future__ import annotations

from collections.abc import Mapping

SEEN_S = 0.3
"""An acknowledged pulse must show at the outputs within this; ArduPilot takes 0.02 to 0.07 s."""

TOLERANCE_US = 3.0
"""Rounding of pulses on the way through percent and timer ticks; a choice."""


GAP_S = 0.15
"""Outputs come at 10 Hz at least; a longer pause is one of the link or of the reader."""

UNTOLD_S = 1.0
"""Motors do not turn for longer without their outputs being told; a choice."""

UNTOLD_AT_REST_S = 3.0
"""The same at rest: an autopilot that has started anew has forgotten what it was asked for."""


class OutputWatch:
    """Compare what outputs tell with what they were told.

    Attributes:
        shown: whether every output, as last told, shows what was commanded.

    Args:
        name: of the autopilot, for messages.
        stop_us: pulse of a motor that stands; outputs without any pulse stand as well.
    """

    def __init__(self, name: str, stop_us: float) -> None:
        self._name = name
        self._stop_us = stop_us
        self._wanted: dict[int, tuple[int, float]] = {}
        self._lately: list[tuple[float, int, float]] = []
        self._good_s: dict[int, float] = {}
        self._heard_s: float | None = None
        self.shown = False

    def told_since(self, time_s: float) -> bool:
        """Tell whether outputs were told after a wall time."""
        return self._heard_s is not None and self._heard_s > time_s

    def command(self, wanted: Mapping[int, tuple[int, float]], now_s: float) -> None:
        """Note what outputs should show from now on.

        Args:
            wanted: by rotor (from 1): its output (from 1, 0 when not known) and its pulse in us.
            now_s: wall time.
        """
        for rotor, (output, pulse_us) in wanted.items():
            before = self._wanted.get(rotor)
            if before != (output, pulse_us):
                if before is not None:
                    self._lately.append((now_s, rotor, before[1]))
                self._good_s[rotor] = max(self._good_s.get(rotor, now_s), now_s)
        self._wanted = dict(wanted)
        self.shown = False

    def seen(self, outputs_us: tuple[int, ...], now_s: float) -> tuple[int, int] | None:
        """Note what outputs tell; a pulse commanded a moment ago is as good as the present one.

        Returns:
            a rotor whose output was not known, and the only output that follows it (from 1).
        """
        found = None
        gap_s = now_s - self._heard_s if self._heard_s is not None else 0.0
        self._heard_s = now_s
        if gap_s > GAP_S:
            # A pause of the link or of the reader says nothing about the outputs.
            self._good_s = {rotor: good_s + gap_s for rotor, good_s in self._good_s.items()}
        self._lately = [item for item in self._lately if now_s - item[0] <= SEEN_S]
        self.shown = True
        for rotor, (output, pulse_us) in self._wanted.items():
            shown = outputs_us[output - 1] if output else _nearest(outputs_us, pulse_us)
            self.shown = self.shown and self._fits(shown, pulse_us)
            allowed = [pulse_us, *(us for _, own, us in self._lately if own == rotor)]
            if any(self._fits(shown, us) for us in allowed):
                self._good_s[rotor] = now_s
                if not output and max(allowed) > self._stop_us:
                    found = self._only(rotor, outputs_us) or found
        if found is not None:
            self._wanted[found[0]] = (found[1], self._wanted[found[0]][1])
        return found

    def fault(
        self, outputs_us: tuple[int, ...], now_s: float, lost_s: float = 0.0, slowest_s: float = 0.0
    ) -> str | None:
        """Return what is wrong in a sentence, None while nothing is.

        Args:
            outputs_us: pulse of every output, as last told.
            now_s: wall time.
            lost_s: since the last acknowledgement of an order that is sent again and again.
            slowest_s: longest time that an acknowledgement took.
        """
        if self._heard_s is None:
            return None
        late = f"; acknowledgements take up to {slowest_s:.1f} s: the link carries more than it can"
        late = late if slowest_s > SEEN_S else ""
        for rotor, (output, pulse_us) in self._wanted.items():
            late_s = self._heard_s - self._good_s[rotor]
            if late_s <= SEEN_S:
                continue
            shown = f"output {output} shows {outputs_us[output - 1]} us"
            where = shown if output else "no output shows it"
            if lost_s > SEEN_S:
                return (
                    f"{self._name} acknowledged no order for {lost_s:.1f} s and {where} where "
                    f"rotor {rotor} was commanded {pulse_us:g} us: orders get lost on the way to "
                    f"it; check cable, radio and ports{late}"
                )
            return (
                f"rotor {rotor} was commanded {pulse_us:g} us and {self._name} acknowledged it, "
                f"but {where} after {late_s:.1f} s, limit "
                f"{SEEN_S:g} s; look at the safety switch, the arming checks and the map of "
                f"outputs (benchtool bench map){late}"
            )
        untold_s = now_s - self._heard_s
        turning = any(us > self._stop_us for _, us in self._wanted.values())
        if untold_s > (UNTOLD_S if turning else UNTOLD_AT_REST_S):
            return f"{self._name} has not told its outputs for {untold_s:.1f} s{late}"
        return None

    def _only(self, rotor: int, outputs_us: tuple[int, ...]) -> tuple[int, int] | None:
        """Return a rotor with the one output that is driven, None where several are."""
        driven = [
            output
            for output, shown in enumerate(outputs_us, 1)
            if shown > self._stop_us + TOLERANCE_US
        ]
        turning = [own for own, (_, pulse_us) in self._wanted.items() if pulse_us > self._stop_us]
        return (rotor, driven[0]) if len(driven) == 1 and turning == [rotor] else None

    def _fits(self, shown: int, pulse_us: float) -> bool:
        if pulse_us <= self._stop_us:
            return shown <= self._stop_us + TOLERANCE_US
        return abs(shown - pulse_us) <= TOLERANCE_US


def _nearest(outputs_us: tuple[int, ...], pulse_us: float) -> int:
    """Return the output that comes nearest to a pulse, where it is not known which one it is."""
    return min(outputs_us, key=lambda shown: abs(shown - pulse_us))
