"""The look: one colour per role, the stamp, the same bytes every time, no setting left changed."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from benchtool.core.errors import WouldOverwrite
from benchtool.report.files import figure_bytes, save_figure
from benchtool.report.palette import CYCLE, LOOKS
from benchtool.report.style import SIMULATED, SIMULATED_GID, look, new_figure


@look()
def example(*, simulated: bool, title: str = "Example") -> Figure:
    figure = new_figure(title, simulated=simulated, height_in=3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [1.0, 2.0], label="line")
    axes.fill_between([0.0, 1.0], [0.5, 1.0], [1.5, 2.5])
    axes.axvspan(0.0, 0.2, hatch="//", facecolor="none")
    axes.legend()
    return figure


def test_roles_differ_in_colour_and_in_marker() -> None:
    rotors = ("single_rotor", "second_rig", "three_rotors", "quad", "model")
    assert len({LOOKS[role].color for role in rotors}) == len(rotors)
    assert len({LOOKS[role].marker for role in rotors}) == len(rotors)
    assert len(set(CYCLE)) == len(CYCLE) >= 8


@pytest.mark.parametrize("simulated", [True, False])
def test_the_stamp_is_on_simulated_figures_only(simulated: bool) -> None:
    figure = example(simulated=simulated)
    stamps = [text for text in figure.texts if text.get_gid() == SIMULATED_GID]
    assert [text.get_text() for text in stamps] == ([SIMULATED] if simulated else [])
    svg = figure_bytes(figure, "svg").decode()
    assert (f'id="{SIMULATED_GID}"' in svg) is simulated


def test_a_long_title_is_broken_before_it_reaches_the_stamp() -> None:
    figure = example(simulated=True, title="word " * 40)
    figure.draw_without_rendering()
    stamp_box = next(t for t in figure.texts if t.get_gid() == SIMULATED_GID).get_window_extent()
    assert figure.get_suptitle().count("\n") >= 2
    title = next(t for t in figure.texts if t.get_text() == figure.get_suptitle())
    assert title.get_window_extent().x1 < stamp_box.x0


@pytest.mark.parametrize("file_format", ["svg", "png", "pdf"])
def test_the_same_figure_gives_the_same_bytes(file_format: str) -> None:
    one = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    other = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    assert one == other
    assert len(one) > 2000


def test_settings_of_the_user_neither_show_nor_change() -> None:
    expected = figure_bytes(example(simulated=False))
    with mpl.rc_context({"font.size": 30.0, "axes.grid": False, "lines.linewidth": 9.0}):
        assert figure_bytes(example(simulated=False)) == expected
        assert mpl.rcParams["font.size"] == 30.0


def test_files_are_written_whole_and_not_overwritten_unasked(tmp_path: Path) -> None:
    stem = tmp_path / "figures" / "run.1"
    paths = save_figure(example(simulated=True), stem, ("svg", "png", "pdf"))
    assert [path.name for path in paths] == ["run.1.svg", "run.1.png", "run.1.pdf"]
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert paths[2].read_bytes().startswith(b"%PDF")
    paths[1].write_text("kept")
    with pytest.raises(WouldOverwrite, match=r"run\.1\.(svg|png|pdf)"):
        save_figure(example(simulated=True), stem)
    assert paths[1].read_text() == "kept"
    save_figure(example(simulated=True), stem, replace=True)
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert len(list(stem.parent.iterdir())) == len(paths)
