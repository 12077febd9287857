"""Judge whether a simulated run follows the recording beside it: one that does not is no result."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.pitch.replay_track import PitchTrack

LEAST_RAD = 0.035
"""Two degrees: noise, and what a window begins with, part a right run from its log by less. A
choice; windows of the virtual bench were seen to part by 0.2 to 0.4 degrees."""

FARTHEST = {"pulses": 1.0, "controller": 2.0}
"""How far a run may be from its log, RMS, in swings of the log about its own mean, RMS. From one
on, a line drawn at the log's mean is nearer to the log than a plant under the log's own pulses. A
closed loop has noise of its own: with the same swing, but always the opposite way, it is two
away."""

STRAYED = 5.0
"""A simulated run that covers so many times the recorded range goes where its vehicle never was; a
choice."""

_CHECK = (
    "check that the model is of this vehicle and the order of its motors (--motors), and that it "
    "was in the air"
)


def on_log_clock(track: PitchTrack, time_s: Array, theta_rad: Array) -> Array:
    """Return a simulated pitch (m,) at the recording's times (n,): rad, nan beyond its end."""
    at = np.searchsorted(time_s, track.time_s)
    theta = theta_rad[np.minimum(at, len(theta_rad) - 1)]
    return np.where(at < len(theta_rad), theta, np.nan)


def mismatch(track: PitchTrack, time_s: Array, theta_rad: Array, by: str) -> str:
    """Return a sentence saying that a simulated run does not follow its log; empty where it does.

    It is held against the whole log, and against what lies over a surface.

    Args:
        track: the recording.
        time_s: (m,) of the simulated run.
        theta_rad: (m,) of it; nan where it starts anew.
        by: what drove it, "pulses" or "controller".
    """
    apart = track.theta_rad - on_log_clock(track, time_s, theta_rad)
    swing = track.theta_rad - np.nanmean(track.theta_rad)
    for rows, where in (
        (np.ones(len(track), bool), ""),
        (track.any_over > 0.0, " over the surface"),
    ):
        missed_rad, swing_rad = _rms(apart[rows]), _rms(swing[rows])
        limit_rad = max(FARTHEST[by] * swing_rad, LEAST_RAD)
        if missed_rad > limit_rad:
            reason = f"there the log swings by {np.degrees(swing_rad):.1f}° about its mean"
            if limit_rad == LEAST_RAD:
                reason += f", and up to {np.degrees(LEAST_RAD):.0f}° may be noise"
            elif by == "pulses":
                reason += ", so that a line at its mean is nearer to it"
            else:
                reason += ", and the same swing the opposite way is twice that away"
            return (
                f"The simulated run does not follow the log, so it is no result: it misses it by "
                f"{np.degrees(missed_rad):.1f}° RMS{where}, above {np.degrees(limit_rad):.1f}° "
                f"({reason}); {_CHECK}."
            )
    known = theta_rad[np.isfinite(theta_rad)]
    seen = np.concatenate([track.theta_rad, track.reference_rad])
    seen = seen[np.isfinite(seen)]
    most, recorded = float(np.ptp(known)), float(np.ptp(seen))
    if most < STRAYED * max(recorded, LEAST_RAD):
        return ""
    return (
        f"The simulated run does not follow the log, so it is no result: it goes over "
        f"{np.degrees(most):.0f}°, the recorded one over {np.degrees(recorded):.1f}°; {_CHECK}."
    )


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0
