"""Sections 3.2 to 3.5 of the paper: flying over an obstacle, hovering at its edge."""

from __future__ import annotations

import numpy as np

from benchtool.commands.paper.claims import (
    CONSTRUCTED,
    FAILS,
    UNCLEAR,
    Claim,
    Flights,
    arrival,
    yes,
)
from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S, PLATE_S
from benchtool.simulate.flight.flight import Flight
from benchtool.simulate.flight.study import Flown

NOISE_SEEDS = (1, 2, 3, 4)
"""Four seeds, as in the notes' table."""

SAME_WIDTH = 0.05
"""A change of the oscillation's width by less than this share, either way, is no amplification."""


def flight_claims(flights: Flights) -> list[Claim]:
    """Return the rows of sections 3.2 to 3.5 with gain set S3, and the stiff set for contrast."""
    return [
        *baseline_claims(flights),
        *compensated_claims(flights),
        *map_claims(flights),
        free_hover_claim(flights),
    ]


def baseline_claims(flights: Flights) -> list[Claim]:
    """Return what is said of PID alone (section 3.2)."""
    measure = flights.measure
    low, high, free = measure("over"), measure("over", "pid", 3.0), measure("over", "pid", None)
    fast, calm = flights.fly("over", speed_m_s=1.0), flights.fly("over", "pid", None, 1.0)
    edge, edge_fast = measure("edge"), measure("edge", speed_m_s=1.0)
    stiff = {case: measure(case, gains="stiff") for case in ("over", "edge")}
    swing, still = pitch_at_edge(fast), pitch_at_edge(calm)
    return [
        Claim(
            where="3.2, Fig. 12",
            says="PID at z/R = 2 and 0.2 m/s is pushed back again and again and never crosses",
            found=f"{arrival(low)}; {low.push_backs} push-backs of over 3 cm in 120 s",
            gains="s3",
            verdict=yes(not low.arrives and low.push_backs > 5),
        ),
        Claim(
            where="3.2, contrast",
            says="(the same, of any PID in use: 'implemented in many multirotors', section 3.5)",
            found=f"a normally tuned autopilot crosses in {arrival(stiff['over'])} with "
            f"{stiff['over'].max_pitch_deg:.1f} deg of pitch and hovers at the edge within "
            f"{1e3 * stiff['edge'].swing_m:.0f} mm: the result is one of a soft cascade",
            gains="stiff",
            verdict=yes(not stiff["over"].arrives),
        ),
        Claim(
            where="3.2, Fig. 12",
            says="the effect is weaker at z/R = 3",
            found=f"arrives in {arrival(high)} with {high.push_backs} push-backs, out of ground "
            f"effect in {arrival(free)}",
            gains="s3",
            verdict=yes(high.arrives and high.push_backs < low.push_backs),
        ),
        Claim(
            where="3.2, Fig. 14",
            says="at 1 m/s it crosses at z/R = 2, with a strong perturbation of pitch",
            found=f"arrives in {arrival(fast.measures)}; pitch over the edge {swing[0]:+.1f} to "
            f"{swing[1]:+.1f} deg, {still[0]:+.1f} to {still[1]:+.1f} out of ground effect",
            gains="s3",
            verdict=yes(fast.measures.arrives and np.ptp(swing) > 5.0 * np.ptp(still)),
        ),
        Claim(
            where="3.2, Fig. 13",
            says="hovering with one rotor over the edge at z/R = 2 keeps oscillating in and out",
            found=f"{arrival(edge)}: swings {edge.swing_m:.2f} m, pitch {edge.max_pitch_deg:.1f} "
            f"deg",
            gains="s3",
            verdict=yes(not edge.arrives and edge.swing_m > 0.1),
        ),
        Claim(
            where="3.2, Fig. 14",
            says="approached at 1 m/s it is much the same",
            found=f"{arrival(edge_fast)}: swings {edge_fast.swing_m:.2f} m",
            gains="s3",
            verdict=yes(not edge_fast.arrives and edge_fast.swing_m > 0.1),
        ),
        noise_claim(flights, edge_fast.swing_m),
    ]


def noise_claim(flights: Flights, quiet_m: float) -> Claim:
    """Return what gyro noise does to the oscillation (Fig. 15)."""
    widths = [
        flights.measure("edge", speed_m_s=1.0, gyro_noise_rad_s=GYRO_NOISE_RAD_S, seed=seed).swing_m
        for seed in NOISE_SEEDS
    ]
    changes = [width / quiet_m - 1.0 for width in widths]
    amplified = min(changes) > SAME_WIDTH
    return Claim(
        where="3.2, Fig. 15",
        says="noise of the gyro amplifies the oscillation; qualitatively it stays the same",
        found=f"width {min(widths):.3f} to {max(widths):.3f} m over {len(widths)} seeds, "
        f"{quiet_m:.3f} m without noise ({100 * min(changes):+.1f} to {100 * max(changes):+.1f} %)"
        f": no amplification to be seen; it stays the same",
        gains="s3",
        verdict=yes(True) if amplified else UNCLEAR,
    )


def compensated_claims(flights: Flights) -> list[Claim]:
    """Return what is said of the observer and of the feedforward (sections 3.3 to 3.5)."""
    measure = flights.measure
    high, low = measure("over", "observer", 3.0), measure("over", "observer")
    base, free = measure("over", "pid", 3.0), measure("over", "pid", None)
    edge = measure("edge", "observer")
    forward, edge_forward = measure("over", "feedforward"), measure("edge", "feedforward")
    binary = measure("edge", "feedforward", whole_discs=True)
    return [
        Claim(
            where="3.3, Fig. 17",
            says="the observer is not pushed back at z/R = 3 and arrives at z/R = 2",
            found=f"push-backs {high.push_backs} at 3; arrives at 2 in {arrival(low)}, RMS pitch "
            f"{low.rms_pitch_deg:.2f} deg",
            gains="s3",
            verdict=yes(high.push_backs == 0 and low.arrives),
        ),
        Claim(
            where="3.3, Fig. 17",
            says="it is faster than the baseline",
            found=f"at z/R = 3 {arrival(high)} against {arrival(base)}: a small gain; at z/R = 2 "
            f"the baseline does not arrive",
            gains="s3",
            verdict=yes(high.arrives_s < base.arrives_s),
        ),
        Claim(
            where="3.3, Fig. 18",
            says="it removes the oscillation at the edge",
            found=f"arrives in {arrival(edge)} and stays within {1e3 * edge.swing_m:.1f} mm",
            gains="s3",
            verdict=yes(edge.arrives and edge.swing_m < 0.01),
        ),
        Claim(
            where="3.4 and 3.5, Figs 20, 21, 23, 24",
            says="feedforward with a map is better than the other two",
            found=f"RMS pitch {forward.rms_pitch_deg:.2f} deg against {low.rms_pitch_deg:.2f} "
            f"(observer) and {free.rms_pitch_deg:.2f} out of ground effect; at the edge within "
            f"{1e3 * edge_forward.swing_m:.1f} mm. Its map is the plant's own model: it cannot but "
            f"be best. A map that knows only whether a rotor's centre is over the obstacle leaves "
            f"{binary.swing_m:.2f} m of oscillation",
            gains="s3",
            verdict=CONSTRUCTED if forward.rms_pitch_deg < low.rms_pitch_deg else FAILS,
        ),
    ]


def map_claims(flights: Flights) -> list[Claim]:
    """Return what is said of maps with an error (section 3.4, Fig. 22)."""
    measure = flights.measure

    def early(name: str, offset_m: float, gains: str = "s3") -> Flown:
        return flights.fly(name, "feedforward", gains=gains, map_offset_m=(-offset_m, 0.0, 0.0))

    small, large = early("edge", 0.05).measures, early("edge", 0.15).measures
    soft, crossed = early("edge", 0.15, "s1a").measures, early("over", 0.15).measures
    free, base = measure("edge", "pid", None), measure("edge")
    soft_base, stiff = measure("edge", gains="s1a"), early("edge", 0.15, "stiff").measures
    worse = large.ending == "struck" or large.swing_m > base.swing_m
    return [
        Claim(
            where="3.4, Fig. 22(a)",
            says="a map 5 cm early overshoots and still arrives",
            found=f"arrives in {arrival(small)}; furthest place {small.max_x_m:.2f} m against "
            f"{free.max_x_m:.2f} out of ground effect, "
            f"{100 * (small.max_x_m - free.max_x_m):.0f} cm more: small, but there",
            gains="s3",
            verdict=yes(small.arrives and small.max_x_m > free.max_x_m),
        ),
        Claim(
            where="3.4, Fig. 22(b)",
            says="a map 15 cm early is unstable, worse than PID alone",
            found=f"{arrival(large)} after {large.max_pitch_deg:.0f} deg of pitch; PID alone "
            f"swings {base.swing_m:.2f} m. In case 1 it still arrives ({arrival(crossed)})",
            gains="s3",
            verdict=yes(worse),
        ),
        Claim(
            where="3.4, Fig. 22(b)",
            says="(the same with a softer set)",
            found=f"{arrival(soft)}, {soft.max_pitch_deg:.0f} deg of pitch; PID alone swings "
            f"{soft_base.swing_m:.2f} m",
            gains="s1a",
            verdict=yes(soft.ending != "flown" or soft.swing_m > soft_base.swing_m),
        ),
        Claim(
            where="3.4, contrast",
            says="(the same with a stiff set)",
            found=f"{arrival(stiff)}: stiffness does not save a map that is 15 cm wrong",
            gains="stiff",
            verdict=yes(stiff.ending != "flown" or not stiff.arrives),
        ),
    ]


def free_hover_claim(flights: Flights) -> Claim:
    """Return what a plate does that comes under one rotor in free hover and goes (Fig. 30)."""
    flight = flights.fly("plate").flight
    came, _, left, _ = PLATE_S
    first, after = (first_bump_deg(flight, begin) for begin in (came, left))
    return Claim(
        where="4, Fig. 30",
        says="in free flight too the angle is perturbed, and the other way when the plate goes",
        found=f"{first:+.2f} deg first when it comes, {after:+.2f} deg first when it goes: the "
        f"velocity loop's integral, which held against the plate, is then wrong. On the hinge the "
        f"same PID gives no such rebound",
        gains="s3",
        verdict=yes(first * after < 0.0 and abs(after) > 0.3 * abs(first)),
    )


def first_bump_deg(flight: Flight, begin_s: float) -> float:
    """Return the first extreme of the pitch beyond a quarter degree after a time: deg."""
    pitch = np.degrees(flight["pitch_rad"][flight["time_s"] >= begin_s])
    pitch = pitch - pitch[0]
    start = int(np.argmax(np.abs(pitch) > 0.25))
    turns = np.flatnonzero(np.diff(np.abs(pitch[start:])) < 0.0)
    return float(pitch[start + (int(turns[0]) if turns.size else 0)])


def pitch_at_edge(flown: Flown) -> tuple[float, float]:
    """Return the least and greatest pitch (deg) while the body passes from x = 2.5 to 4.5 m."""
    x, pitch = flown.flight["x_m"], np.degrees(flown.flight["pitch_rad"])
    near = (x > 2.5) & (x < 4.5)
    return float(pitch[near].min()), float(pitch[near].max())
