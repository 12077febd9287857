"""Figures: the stamp, the same bytes every time, files not overwritten unasked."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from benchtool.core.errors import WouldOverwrite
from benchtool.report.files import figure_bytes, save_figure
from benchtool.report.style import SIMULATED, SIMULATED_GID, look, new_figure


@look()
def example(*, simulated: bool) -> Figure:
    figure = new_figure("Example", simulated=simulated, height_in=3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [1.0, 2.0], label="line")
    axes.legend()
    return figure


@pytest.mark.parametrize("simulated", [True, False])
def test_the_stamp_is_on_simulated_figures_only(simulated):
    figure = example(simulated=simulated)
    stamps = [text for text in figure.texts if text.get_gid() == SIMULATED_GID]
    assert [text.get_text() for text in stamps] == ([SIMULATED] if simulated else [])
    svg = figure_bytes(figure, "svg").decode()
    assert (f'id="{SIMULATED_GID}"' in svg) is simulated


@pytest.mark.parametrize("file_format", ["svg", "png", "pdf"])
def test_the_same_figure_gives_the_same_bytes(file_format):
    one = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    other = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    assert one == other
    assert len(one) > 2000


def test_files_are_written_whole_and_not_overwritten_unasked(tmp_path):
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
