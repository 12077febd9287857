"""What a pitch bench's lanes share: the spelled-out effects, geometry and time."""

from __future__ import annotations

from typing import Any, NamedTuple


class Hooks(NamedTuple):
    """Hold the functions that `pitch_hooks` spells out for a set of effects and discs.

    Attributes:
        numbers: numbers(w, row, lane, at) -> all parameters of all effects.
        of_discs: of_discs(w, row, lane, at) -> a block's numbers, one per disc.
        places: places(table) -> x, y and roots, one per disc each.
        spans: spans(distances, arms) -> the same as tuples.
        gaps: gaps(gap_m, x_m, sine) -> height of each disc over the plate.
        bare: a Flow of given heights and areas, without images.
        blown: blown(flow, distances, arms, p) -> the Flow with changed heights, areas, images.
        factors: factors(flow, p) -> T_IGE/T_OGE of each disc.
        loaded: loaded(flow, rate, k, factor) -> the Flow with thrusts, at another rate.
        torque, dry_friction, dry_width: of the hinge, summed over effects.
        speeds: speeds(flow, p) -> commanded speeds, changed by effects.
        gyro: gyro(reading, flow, p) -> the gyro's reading, changed by effects.
    """

    numbers: Any
    of_discs: Any
    places: Any
    spans: Any
    gaps: Any
    bare: Any
    blown: Any
    factors: Any
    loaded: Any
    torque: Any
    dry_friction: Any
    dry_width: Any
    speeds: Any
    gyro: Any


class Shared(NamedTuple):
    """Hold what is the same for all lanes of a step.

    Attributes:
        x, y: places of the discs (n,): m.
        roots: root of the number of rotors on each disc (n,).
        distances: between discs (n, n), arms: from the body's centre (n,): m.
        dt_s: plant step: s.
        time_s: when the control tick began: s.
    """

    x: Any
    y: Any
    roots: Any
    distances: Any
    arms: Any
    dt_s: Any
    time_s: Any
