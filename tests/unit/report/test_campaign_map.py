"""Maps of campaigns: cells as summed up from the whole table at once, panels, and the drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.data.run import campaign as store
from benchtool.data.run.campaign import write_campaign
from benchtool.report.figure import drawn
from benchtool.report.flight.campaign import campaign_map
from benchtool.simulate.campaign import Measure, Row, measure_named
from benchtool.simulate.design import Design

SPEED, GAIN, HEIGHT = "speed=0.2:1.0:5", "gain=0.8:1.2:3", "height=2:3:2"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dice:
    """A campaign whose results are drawn by lot."""

    gain_sets: tuple[str, ...] = ("soft",)
    controllers: tuple[str, ...] = ("pid",)
    title: str = "Dice"

    @property
    def setups(self) -> Mapping[str, None]:
        return dict.fromkeys(self.gain_sets)

    @property
    def metadata(self) -> Mapping[str, str]:
        return {}

    @property
    def fixed(self) -> Mapping[str, str]:
        return {"height": "2", "noise": "0.1"}

    @property
    def measures(self) -> Mapping[str, Measure]:
        return {"arrives": Measure(text="share", share=True), "late_s": Measure(text="late [s]")}

    def check(self, design: Design) -> None:
        """Nothing can be wrong with dice."""

    def rows(self, design: Design, threads: int | None = None) -> Iterator[Row]:
        rng = np.random.default_rng(7)
        for gains in self.gain_sets:
            for controller in self.controllers:
                for point in design.points():
                    for seed in range(design.seeds):
                        arrives = float(rng.random() < point["speed"])
                        late_s = float(rng.random()) if arrives else float("nan")
                        yield {
                            **point, "gains": gains, "controller": controller,
                            "seed": float(seed), "arrives": arrives, "late_s": late_s,
                        }  # fmt: skip


def table_of(tmp_path: Path, dice: Dice, design: Design) -> Path:
    path = tmp_path / "campaign.parquet"
    write_campaign(dice.rows(design), path, {})
    return path


@pytest.mark.parametrize("measure", ["arrives", "late_s"])
def test_cells_are_the_means_of_the_whole_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measure: str
) -> None:
    monkeypatch.setattr(store, "ROWS_AT_ONCE", 37)
    dice = Dice(gain_sets=("soft", "stiff"), controllers=("oge", "pid"))
    design = Design.read([SPEED, GAIN], seeds=6)
    path = table_of(tmp_path, dice, design)
    panels = campaign_map(path, dice, design, measure).panels
    assert [(panel.column, panel.row) for panel in panels] == [
        ("soft", "oge"), ("soft", "pid"), ("stiff", "oge"), ("stiff", "pid"),
    ]  # fmt: skip
    means = pd.read_parquet(path).groupby(["gains", "controller", "gain", "speed"])[measure]
    for panel in panels:
        expected = means.mean()[panel.column][panel.row].unstack().to_numpy()
        np.testing.assert_allclose(panel.means, expected, atol=1e-12)
        least = means.min()[panel.column][panel.row].unstack().to_numpy()
        np.testing.assert_allclose(panel.least[panel.count > 0], least[panel.count > 0])


def test_random_points_fall_into_cells_and_none_is_lost(tmp_path: Path) -> None:
    dice, design = Dice(), Design.read([SPEED, GAIN], samples=300, seeds=2)
    (panel,) = campaign_map(table_of(tmp_path, dice, design), dice, design, "arrives").panels
    assert panel.means.shape == (8, 8)
    assert panel.count.sum() == 600
    slow, fast = panel.total[:, :4].sum(), panel.total[:, 4:].sum()
    assert fast > 1.5 * slow


def test_a_third_number_has_its_own_panels_while_they_stay_few(tmp_path: Path) -> None:
    dice, design = Dice(controllers=("oge", "pid")), Design.read([SPEED, GAIN, HEIGHT])
    panels = campaign_map(table_of(tmp_path, dice, design), dice, design, "arrives").panels
    assert {(panel.row, panel.column) for panel in panels} == {
        (row, column) for row in ("oge", "pid") for column in ("height = 2", "height = 3")
    }
    many = Design.read([SPEED, GAIN, "height=2:3:9"])
    merged = campaign_map(table_of(tmp_path / "many", dice, many), dice, many, "arrives").panels
    assert [(panel.row, panel.column) for panel in merged] == [("", "oge"), ("", "pid")]
    assert merged[0].count.min() == 9


@pytest.mark.parametrize(
    ("words", "samples", "note"),
    [
        ([SPEED], 0, "Each point: one run; height 2, noise 0.1"),
        ([SPEED, GAIN], 0, "Each cell, drawn around its values: one run; height 2, noise 0.1"),
        ([SPEED, GAIN, HEIGHT], 0, "Each cell, drawn around its values: one run; noise 0.1"),
        (
            [SPEED, GAIN, HEIGHT],
            60,
            "Each cell: mean over the random points in it (60 in all) and height from 2 to 3; "
            "noise 0.1",
        ),
    ],
)
def test_the_figure_says_what_a_cell_is_and_is_stamped(
    tmp_path: Path, words: list[str], samples: int, note: str
) -> None:
    dice, design = Dice(), Design.read(words, samples=samples)
    path = table_of(tmp_path, dice, design)
    for measure in dice.measures:
        cells = campaign_map(path, dice, design, measure)
        figure = drawn("flight.campaign", cells)["campaign"].figure
        texts = [text.get_text() for text in figure.texts]
        assert "SIMULATED" in texts
        assert figure.get_supxlabel() == note


def test_shares_between_none_and_all_are_written_into_their_cells(tmp_path: Path) -> None:
    dice, design = Dice(), Design.read([SPEED, GAIN], seeds=10)
    cells = campaign_map(table_of(tmp_path, dice, design), dice, design, "arrives")
    figure = drawn("flight.campaign", cells)["campaign"].figure
    means = cells.panels[0].means
    shown = sorted(text.get_text() for text in figure.axes[0].texts)
    between = means[(means > 0.0) & (means < 1.0)]
    assert shown == sorted(f"{share:.2f}".lstrip("0") for share in between)
    assert len(shown) > 5


def test_a_measure_that_is_not_there_is_refused(tmp_path: Path) -> None:
    dice, design = Dice(), Design.read(["speed=-2:-1:3"])
    assert measure_named(dice, "") == "arrives"
    with pytest.raises(UnknownChoice, match="did you mean 'arrives'"):
        measure_named(dice, "arive")
    path = table_of(tmp_path, dice, design)
    with pytest.raises(InputError, match="late_s has no value in any run"):
        campaign_map(path, dice, design, "late_s")


def test_ticks_stand_at_the_values_of_a_grid(tmp_path: Path) -> None:
    dice, design = Dice(controllers=("oge", "pid")), Design.read([SPEED, GAIN])
    cells = campaign_map(table_of(tmp_path, dice, design), dice, design, "arrives")
    (axes, *_) = drawn("flight.campaign", cells)["campaign"].figure.axes
    np.testing.assert_allclose(axes.get_xticks(), [0.2, 0.4, 0.6, 0.8, 1.0])
    np.testing.assert_allclose(axes.get_yticks(), [0.8, 1.0, 1.2])
    assert [text.get_text() for text in axes.get_yticklabels()] == ["0.8", "1", "1.2"]
    assert axes.get_title(loc="left") == "oge"
