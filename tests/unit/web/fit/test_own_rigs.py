"""The page offers rig files of the runs folder beside the shipped ones, and opens no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import UnknownChoice
from benchtool.core.rig_file import rig_named, rig_names
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.tabs.fit.model_choice import offered_rig, rig_choices

RIG = 'name = "mine"\n[propulsion]\nradius_m = { value = 0.127, source = "ruler" }\n'


def test_rigs_of_the_runs_folder_are_offered_by_path(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "mine.toml").write_text(RIG)
    (runs / "model.toml").write_text('[model]\nname = "a"\nrig = "pquad"\n')
    (tmp_path / "other.toml").write_text(RIG)
    folder = RunsFolder(runs)
    own = str(folder.file_of("mine.toml"))
    assert list(rig_choices(folder)) == [*rig_names(), own]
    assert rig_choices(folder)[own] == "mine (mine.toml)"
    assert rig_named(offered_rig(own, folder) or "").propulsion.radius_m == 0.127
    assert offered_rig(None, folder) is None
    assert offered_rig("pquad", folder) == "pquad"
    for other in (str(tmp_path / "other.toml"), f"{runs}/../other.toml", "mine.toml"):
        with pytest.raises(UnknownChoice, match="unknown rig"):
            offered_rig(other, folder)
