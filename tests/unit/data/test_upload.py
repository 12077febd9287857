from __future__ import annotations

import pytest

from benchtool.core.errors import FileFormatError
from benchtool.data.run import runs_folder
from benchtool.data.run.runs_folder import RunsFolder, store_table

GOOD = b"gap_mm;F_gf\n60;424,1\n"


@pytest.mark.parametrize(
    "name",
    [
        "../../x.csv",
        "/etc/passwd",
        "..\\x.csv",
        "C:\\x.csv",
        "..",
        "",
        ".hidden",
        "a\0b.csv",
        "x" * 999,
    ],
)
def test_a_name_cannot_choose_the_place(tmp_path, name):
    folder = RunsFolder(tmp_path / "runs")
    path = store_table(folder, name, GOOD, "2026-01-02")
    assert path.parent.parent == folder.root
    assert folder.find_path(folder.relative_name(path)) == path
    assert [item.name for item in tmp_path.iterdir()] == ["runs"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"\x00\x01", "not a text file"),
        (b",".join(b"c%d" % i for i in range(600)) + b"\n" + b"1," * 599 + b"1\n", "600 columns"),
        (b"x" * 1001, r"0\.0 MB; allowed"),
    ],
)
def test_what_is_no_table_is_refused_and_not_written(tmp_path, monkeypatch, data, message):
    if data == b"x" * 1001:
        monkeypatch.setattr(runs_folder, "MAX_UPLOAD_BYTES", 1000)
    with pytest.raises(FileFormatError, match=message):
        store_table(RunsFolder(tmp_path / "runs"), "t.csv", data, "2026-01-02")
    assert not (tmp_path / "runs").exists()
