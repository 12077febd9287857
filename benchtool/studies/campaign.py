"""Campaigns: the pitch bench over a grid or a random design of numbers, results to disk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from math import isfinite, prod
from pathlib import Path

import numpy as np

from benchtool.errors import InputError
from benchtool.simulate.pitch_batch import simulate_many
from benchtool.simulate.pitch_result import plate_numbers
from benchtool.simulate.pitch_run import PitchJob, PitchLoop, shared_key
from benchtool.simulate.pitch_simulate import taken
from benchtool.studies.pitch_setup import PitchSetup, changed

Row = Mapping[str, float | str]

MEASURES = ("rms_deg", "peak_deg", "residual_deg", "rebound_deg", "quiet_rms_deg", "stopped_steps")
"""What every run of a campaign is summed up in: the RMS error over the whole run, and the numbers
of the plate's first visit (nan without one)."""


@dataclass(frozen=True, slots=True)
class Vary:
    """Vary one number from `lower` to `upper`; `count` values in a grid."""

    name: str
    lower: float
    upper: float
    count: int

    @classmethod
    def read(cls, text: str) -> Vary:
        """Return what `NAME=FROM:TO:COUNT` says."""
        name, _, rest = text.partition("=")
        parts = rest.split(":")
        try:
            lower, upper, count = float(parts[0]), float(parts[1]), int(parts[2])
        except (ValueError, IndexError):
            count = 0
            lower = upper = float("nan")
        if len(parts) != 3 or not name or not (isfinite(lower) and isfinite(upper)) or count < 1:
            raise InputError(f"--vary got {text!r}; write NAME=FROM:TO:COUNT, as K_b=1.5:2.5:11")
        return cls(name.strip(), lower, upper, count)

    def values(self) -> list[float]:
        """Return the grid."""
        return [float(value) for value in np.linspace(self.lower, self.upper, self.count)]


def design(varied: Sequence[Vary], samples: int, seed: int) -> Iterator[dict[str, float]]:
    """Yield the points: the full grid, or `samples` random points within the ranges."""
    names = [each.name for each in varied]
    if len(set(names)) != len(names):
        raise InputError("--vary names one number twice; give it once with the whole range")
    if not samples:
        for values in product(*(each.values() for each in varied)):
            yield dict(zip(names, values, strict=True))
        return
    rng = np.random.default_rng(seed)
    for _ in range(samples):
        yield {each.name: float(rng.uniform(each.lower, each.upper)) for each in varied}


def design_size(varied: Sequence[Vary], samples: int) -> int:
    """Return how many points a design has."""
    return samples or prod(each.count for each in varied)


def run_campaign(
    setup: PitchSetup,
    points: Callable[[], Iterator[Mapping[str, float]]],
    seeds: int,
    seed: int = 0,
    threads: int | None = None,
) -> Iterator[Row]:
    """Yield one row per controller, point and seed, in that order, as results come.

    Every point sees the same noise: seed k of one point is seed k of any other.
    """
    rate_Hz = setup.rate_Hz
    schedule = setup.schedule.sampled(rate_Hz, setup.bench.model.rig.propulsion.radius_m)
    visit = setup.schedule.plate[0] if setup.schedule.plate else None
    end_s = setup.schedule.duration_s

    def measured(loop: PitchLoop, lane: int, _run: int) -> dict[str, float]:
        run = taken(loop, lane, "campaign")
        error = run.column("true_theta_rad") - run.column("reference_rad")
        out = dict.fromkeys(MEASURES, float("nan"))
        out["rms_deg"] = float(np.degrees(np.sqrt(np.mean(error**2))))
        out["stopped_steps"] = float(run.stopped_steps)
        if visit is not None and visit.in_s < end_s:
            numbers = plate_numbers(run, visit.in_s, min(visit.out_s, end_s), visit.move_s)
            out["peak_deg"] = float(np.degrees(numbers.peak_rad))
            out["residual_deg"] = float(np.degrees(numbers.residual_rad))
            out["rebound_deg"] = float(np.degrees(numbers.rebound_rad))
            out["quiet_rms_deg"] = float(np.degrees(numbers.quiet_rms_rad))
        return out

    def jobs() -> Iterator[tuple[dict[str, float | str], PitchJob, tuple[object, ...]]]:
        for position, name in enumerate(control.name for control in setup.controls):
            for point in points():
                here = changed(setup, point)
                if here.rate_Hz != rate_Hz:
                    raise InputError("a campaign cannot vary control_rate_Hz; run one per rate")
                job = PitchJob(here.bench, here.controls[position], here.believed)
                yield {**point, "controller": name}, job, shared_key(job)

    for _, alike in groupby(jobs(), key=lambda item: item[2]):
        labels: deque[dict[str, float | str]] = deque()

        def supply(
            group: Iterator[tuple[dict[str, float | str], PitchJob, tuple[object, ...]]],
            labels: deque[dict[str, float | str]],
        ) -> Iterator[PitchJob]:
            for label, job, _ in group:
                for number in range(seeds):
                    labels.append({**label, "seed": float(seed + number)})
                    yield job

        results = simulate_many(
            supply(alike, labels), schedule, measured, seed=seed, threads=threads, repeat=seeds
        )
        for numbers in results:
            yield {**labels.popleft(), **numbers}


def write_campaign(
    rows: Iterator[Row], path: Path, metadata: Mapping[str, str], tell: Callable[[int], None]
) -> int:
    """Write rows to a Parquet file as they come and return how many; `tell` hears each count."""
    from benchtool.store.campaign import CampaignWriter

    count = 0
    with CampaignWriter(path, metadata) as writer:
        for row in rows:
            writer.add(row)
            count += 1
            tell(count)
    return count
