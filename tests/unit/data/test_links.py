"""Symbolic links inside a run folder are neither read nor written through."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError
from benchtool.data.atomic import data_hash, file_hash, read_json
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run, read_settings
from benchtool.data.run.run_writer import RunWriter
from tests.unit.data.run_of import CHANNELS, small_run

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "metadata": ("metadata.json", lambda run: Run.open(run).metadata),
    "plan": ("plan.toml", lambda run: Run.open(run).plan_text),
    "points": ("points.csv", read_points),
    "settings": ("settings.csv", read_settings),
    "samples": ("samples.csv", lambda run: read_samples(run)),
    "parquet": ("samples.parquet", lambda run: read_samples(run)),
    "events": ("events.jsonl", lambda run: read_events(run / "events.jsonl")),
    "hash": ("samples.csv", data_hash),
}


@pytest.mark.parametrize(("name", "read"), READERS.values(), ids=READERS)
def test_no_reader_follows_a_link(tmp_path, name, read):
    run = small_run(tmp_path / "run")
    run.close()
    path = run.path / name
    victim = path.rename(tmp_path / "victim")
    path.symlink_to(victim)
    with pytest.raises(BenchtoolError, match=rf"{name}: this is a symbolic link"):
        read(run.path)


def test_a_file_that_a_person_names_may_be_a_link(tmp_path):
    (tmp_path / "real").write_text("{}")
    (tmp_path / "link").symlink_to("real")
    assert read_json(tmp_path / "link") == {}
    assert file_hash(tmp_path / "link") == file_hash(tmp_path / "real")


@pytest.mark.parametrize("name", ["samples.csv", "points.csv", "events.jsonl"])
def test_nothing_is_appended_through_a_link(tmp_path, name):
    run = small_run(tmp_path / "run")
    run.event_log().close()
    victim = (run.path / name).rename(tmp_path / "victim")
    before = victim.read_bytes()
    (run.path / name).symlink_to(victim)
    with pytest.raises(BenchtoolError, match=rf"{name}: this is a symbolic link"):
        RunWriter(run, CHANNELS, 1)
    assert victim.read_bytes() == before


def test_nothing_is_written_through_a_link_left_for_a_half_written_file(tmp_path):
    run = small_run(tmp_path / "run")
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name in ("samples.parquet", "settings.csv", "metadata.json"):
        (run.path / name).unlink(missing_ok=name != "metadata.json")
        (run.path / f".{name}.new").symlink_to(victim)
    (run.path / "metadata.json").write_text("{}")
    run.close()
    assert victim.read_text() == "mine"


def test_new_files_have_the_rights_that_the_umask_leaves(tmp_path):
    import os

    before = os.umask(0o002)
    try:
        run = small_run(tmp_path / "run")
        run.close()
    finally:
        os.umask(before)
    assert run.path.stat().st_mode & 0o777 == 0o775
    modes = {path.name: oct(path.stat().st_mode & 0o777) for path in run.path.iterdir()}
    assert modes == dict.fromkeys(modes, "0o664")
    assert len(modes) == 7
