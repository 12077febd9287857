"""Schedules as text read back to the same schedule."""

from __future__ import annotations

import pytest

from benchtool.core.schedule import PlateVisit, Schedule, Signal, Switch
from benchtool.core.schedule_file import schedule_named, schedule_names, schedule_to_toml
from benchtool.core.toml_text import read_strict


@pytest.mark.parametrize("name", schedule_names())
def test_every_shipped_schedule_comes_back(name: str) -> None:
    schedule = schedule_named(name)
    assert read_strict(Schedule, schedule_to_toml(schedule), name) == schedule


def test_every_kind_of_part_comes_back() -> None:
    schedule = Schedule(
        name="all",
        title="everything",
        duration_s=9.5,
        reference_deg=(Signal(shape="steps", levels=(0.0, -3.0), every_s=1.0, to_s=4.0),),
        dither_us=(Signal(shape="prbs", level=15.0, bit_s=0.04, seed=7),),
        plate=(PlateVisit(z_over_R=1.5, in_s=2.0, out_s=6.0, move_s=0.0),),
        switches=(Switch(at_s=1.0, observer=False),),
    )
    assert read_strict(Schedule, schedule_to_toml(schedule), "all") == schedule
