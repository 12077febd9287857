from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.errors import BenchtoolError, InputError, WouldOverwrite
from benchtool.data.run.runs_folder import RunsFolder
from tests.unit.data.run_of import small_run


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "runs"
    root.mkdir()
    (tmp_path / "secret.csv").write_text("thrust_N\n1\n", "utf-8")
    (tmp_path / "runs-of-others").mkdir()
    small_run(root / "one")
    return RunsFolder(root)


@pytest.mark.parametrize(
    "name",
    [
        *("", ".", "..", "/", "one/", "/one", "./one", "one/.", "one//points.csv"),
        *("../secret.csv", "one/../../secret.csv", "one/..", "../runs/one", "../runs-of-others"),
        *(
            "..\\secret.csv",
            "C:one",
            "C:\\secret.csv",
            "\\\\host\\share",
            "one\0",
            "~/x",
            "%2e%2e/x",
        ),
        *(".hidden", "one/.points.csv.new", "x" * 5000, "x/" * 2000 + "x"),
    ],
)
def test_a_name_that_leads_elsewhere_is_refused(folder, name):
    with pytest.raises(InputError):
        folder.find_path(name)
    with pytest.raises(InputError):
        folder.new_path(name)


@given(name=st.text(max_size=40) | st.from_regex(r"(\.\.|one|/|\\|\.){1,12}", fullmatch=True))
def test_no_name_at_all_leads_out(tmp_path_factory, name):
    root = tmp_path_factory.getbasetemp() / "any" / "runs"
    (root / "one").mkdir(parents=True, exist_ok=True)
    for lead in (RunsFolder(root).find_path, RunsFolder(root).new_path):
        try:
            path = lead(name)
        except BenchtoolError:
            continue
        assert path.resolve().is_relative_to(root.resolve())
        assert path.resolve() != root.resolve()


def test_a_link_that_leads_out_is_refused(folder):
    (folder.root / "away").symlink_to(folder.root.parent)
    (folder.root / "file.csv").symlink_to(folder.root.parent / "secret.csv")
    for name in ("away", "away/secret.csv", "away/runs/one/../../secret.csv", "file.csv"):
        with pytest.raises(InputError, match="is outside the runs folder"):
            folder.find_path(name)
    with pytest.raises(InputError):
        folder.new_path("away")


def test_a_run_that_holds_a_link_out_is_refused_whole(folder):
    samples = folder.root / "one" / "samples.csv"
    samples.unlink()
    samples.symlink_to(folder.root.parent / "secret.csv")
    with pytest.raises(InputError, match=r"samples\.csv is a link to a path outside"):
        folder.find_path("one")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_what_is_no_file_is_refused_before_it_is_opened(folder):
    os.mkfifo(folder.root / "one" / "events.jsonl")
    with pytest.raises(InputError, match="neither a file nor a folder"):
        folder.find_path("one")


def test_nothing_is_written_over(folder):
    (folder.root / "dangling").symlink_to("nowhere")
    for name in ("one", "dangling"):
        with pytest.raises(WouldOverwrite):
            folder.new_path(name)
    assert folder.free_path("2026-01-02", "x").name == "2026-01-02-x"
    (folder.root / "2026-01-02-x").mkdir()
    assert folder.free_path("2026-01-02", "x").name == "2026-01-02-x-2"
    assert not (folder.root / "2026-01-02-x-2").exists()
