"""The pitch bench over a design of numbers: lanes side by side in the compiled loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from benchtool.core.errors import InputError
from benchtool.simulate.campaign import Measure, Row
from benchtool.simulate.design import Design
from benchtool.simulate.pitch.batch import simulate_many
from benchtool.simulate.pitch.result import plate_numbers
from benchtool.simulate.pitch.run import PitchJob, PitchLoop, shared_key
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, PitchSetup, changed
from benchtool.simulate.pitch.simulate import taken

MEASURES = {
    "rms_deg": Measure(text="RMS error of pitch [deg]"),
    "peak_deg": Measure(text="peak of the plate's visit [deg]"),
    "residual_deg": Measure(text="residual of the plate's visit [deg]"),
    "rebound_deg": Measure(text="rebound after the plate's visit [deg]"),
    "quiet_rms_deg": Measure(text="RMS of pitch before the plate [deg]"),
    "stopped_steps": Measure(text="steps at the hinge's stop"),
}
"""What every run is summed up in: the RMS error over the whole run, and the numbers of the plate's
first visit (nan without one)."""

Label = dict[str, float | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchCampaign:
    """Run the pitch bench at many points; see `Campaign`.

    Attributes:
        setups: bench, controllers and schedule by the name of the gain set.
    """

    setups: Mapping[str, PitchSetup]

    @property
    def _first(self) -> PitchSetup:
        return next(iter(self.setups.values()))

    @property
    def title(self) -> str:
        """See `Campaign`."""
        schedule = self._first.schedule
        return f"{self._first.bench.model.rig.name}: {schedule.title or schedule.name}"

    @property
    def metadata(self) -> Mapping[str, str]:
        """See `Campaign`."""
        return {"model": self._first.bench.model.name, "schedule": self._first.schedule.name}

    @property
    def fixed(self) -> Mapping[str, str]:
        """See `Campaign`."""
        return {"model": self._first.bench.model.name}

    @property
    def gain_sets(self) -> tuple[str, ...]:
        """See `Campaign`."""
        return tuple(self.setups)

    @property
    def controllers(self) -> tuple[str, ...]:
        """See `Campaign`."""
        return tuple(control.name for control in self._first.controls)

    @property
    def measures(self) -> Mapping[str, Measure]:
        """See `Campaign`."""
        return MEASURES

    def check(self, design: Design) -> None:
        """See `Campaign`."""
        for setup in self.setups.values():
            for point in design.probes():
                here = changed(setup, point)
                if here.rate_Hz != setup.rate_Hz:
                    raise InputError("a campaign cannot vary control_rate_Hz; run one per rate")
                if here.schedule != setup.schedule:
                    raise InputError(
                        f"a campaign cannot vary {PLATE_DISTANCE}; run one per distance, with --set"
                    )

    def rows(self, design: Design, threads: int | None = None) -> Iterator[Row]:
        """See `Campaign`."""
        for gains, setup in self.setups.items():
            yield from _rows(setup, gains, design, threads)


def _rows(setup: PitchSetup, gains: str, design: Design, threads: int | None) -> Iterator[Row]:
    schedule = setup.schedule.sampled(setup.rate_Hz, setup.bench.model.rig.propulsion.radius_m)
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

    def jobs() -> Iterator[tuple[Label, PitchJob, tuple[object, ...]]]:
        for position, control in enumerate(setup.controls):
            for point in design.points():
                here = changed(setup, point)
                job = PitchJob(here.bench, here.controls[position], here.believed)
                yield {**point, "gains": gains, "controller": control.name}, job, shared_key(job)

    def supply(
        group: Iterator[tuple[Label, PitchJob, tuple[object, ...]]], labels: deque[Label]
    ) -> Iterator[PitchJob]:
        for label, job, _ in group:
            for number in range(design.seeds):
                labels.append({**label, "seed": float(design.seed + number)})
                yield job

    for _, alike in groupby(jobs(), key=lambda item: item[2]):
        labels: deque[Label] = deque()
        results = simulate_many(
            supply(alike, labels), schedule, measured,
            seed=design.seed, threads=threads, repeat=design.seeds,
        )  # fmt: skip
        for numbers in results:
            yield {**labels.popleft(), **numbers}
