"""Long runs are closed, gone on with and read a batch at a time: memory hardly grows with rows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.data.run_of import small_run

ROWS = 400_000
WHOLE_MB = ROWS * 7 * 8 / 2**20
"""What all columns of the long run take as numbers; the short one has a tenth."""

CHILD = """
import sys
from pathlib import Path
import pyarrow.csv, pyarrow.parquet, pyarrow.compute
from benchtool.data.run.run import Run
from benchtool.data.run.read import read_samples
from benchtool.data.run.append import write_marked_samples

def most_MB():
    status = dict(line.split(":", 1) for line in open("/proc/self/status"))
    return int(status["VmHWM"].split()[0]) / 1024

run = Run.open(Path(sys.argv[1]) / "short")
{statement}
run = Run.open(Path(sys.argv[1]) / "long")
before = most_MB()
{statement}
print(most_MB() - before)
"""


@pytest.fixture(scope="module")
def long_runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for name, count in (("short", ROWS // 10), ("long", ROWS)):
        samples = small_run(folder / name).path / "samples.csv"
        header, *rows = samples.read_text().splitlines(keepends=True)
        body = "".join(rows) * (count // len(rows))
        samples.write_text(header + body + body[:40])
    assert len(body) > 12_000_000
    return folder


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="needs /proc")
@pytest.mark.parametrize(
    ("statement", "limit_MB"),
    [
        ("run.close()", 60.0),
        ("write_marked_samples(run.path / 'samples.csv', frozenset())", 3.0),
        ("read_samples(run.path / 'samples.csv', ['thrust_N'])", WHOLE_MB / 7 + 60.0),
    ],
    ids=["close", "resume", "one channel"],
)
def test_memory_is_that_of_a_batch(long_runs, statement, limit_MB):
    code = CHILD.format(statement=statement)
    words = [sys.executable, "-c", code, str(long_runs)]
    grown_MB = float(subprocess.run(words, capture_output=True, check=True).stdout)
    assert grown_MB < limit_MB
