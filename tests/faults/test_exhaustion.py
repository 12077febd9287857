"""A full disk, no memory, no descriptors, no output: a sentence, exit code 10, no traceback."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from benchtool.core.errors import ResourceExhausted
from benchtool.data.run.run import Run
from tests.unit.data.run_of import small_run

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux")

SWEEP = (
    *("sweep", "sim:pquad_single", "--z-over-r", "1", "--pwm", "1450", "--repeats", "1"),
    *("--sample-s", "0.5", "--yes", "--out"),
)


def benchtool(
    folder: Path,
    *words: str,
    limit: tuple[int, int] | None = None,
    output: str | None = None,
) -> tuple[int, str]:
    """Run benchtool in a process under a limit and return exit code and standard error."""
    prepare: Callable[[], None] | None = None
    if limit is not None:
        what, most = limit
        prepare = lambda: resource.setrlimit(what, (most, most))  # noqa: E731
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "BENCHTOOL_STATE": str(folder / "state"),
        "TMPDIR": str(folder),
    }
    environment.pop("BENCHTOOL_DEBUG", None)
    with open(output or os.devnull, "w") as out:
        done = subprocess.run(
            [sys.executable, "-m", "benchtool", *words],
            cwd=folder, env=environment, stdout=out, stderr=subprocess.PIPE, text=True,
            preexec_fn=prepare, check=False,
        )  # fmt: skip
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr.strip().splitlines()[-1] if done.stderr.strip() else ""


@pytest.mark.parametrize("words", [("library", "rigs"), (*SWEEP, "run")], ids=["list", "sweep"])
def test_a_full_output(tmp_path, words):
    code, said = benchtool(tmp_path, *words, output="/dev/full")
    assert said == ("benchtool: standard output cannot be written: no space left on device")
    assert code == 10


def test_too_few_descriptors(tmp_path):
    code, said = benchtool(tmp_path, *SWEEP, "run", limit=(resource.RLIMIT_NOFILE, 6))
    assert "too many open files" in said
    assert code == 10


def test_too_little_memory(tmp_path):
    code, said = benchtool(tmp_path, *SWEEP, "run", limit=(resource.RLIMIT_AS, 200 << 20))
    assert said.endswith("cannot allocate memory")
    assert code == 10
    assert not (tmp_path / "run").exists()  # nothing was begun, so nothing turned


def test_a_file_that_may_not_grow_leaves_a_run_that_can_be_closed(tmp_path):
    code, said = benchtool(tmp_path, *SWEEP, "run", limit=(resource.RLIMIT_FSIZE, 60 << 10))
    assert "run cannot be written: file too large; zero was commanded" in said
    assert code == 10
    # No file may hold the whole run, so that only what was in memory is saved.
    assert "only data missing in run are saved in run-rescued" in said
    begun = (tmp_path / "run/samples.csv").read_text()
    rest = (tmp_path / "run-rescued/samples.csv").read_text()
    assert begun.endswith("\n")
    assert rest.endswith("\n")
    lines = (begun + rest).splitlines()[1:]
    times_us = [int(line.split(",")[1]) for line in lines]
    assert {b - a for a, b in pairwise(times_us)} == {5000}
    assert Run.open(tmp_path / "run").metadata["state"] == "stopped"
    code, said = benchtool(tmp_path, "runs", "close", "run")
    assert (code, said) == (0, "")


def test_a_full_disk_while_a_run_is_made_leaves_nothing(tmp_path, monkeypatch):
    def no_room(handle: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", no_room)
        with pytest.raises(ResourceExhausted, match="run cannot be made: no space left on device"):
            Run.create(tmp_path / "run", "", {})
    assert list(tmp_path.iterdir()) == []
    assert Run.create(tmp_path / "run", "", {}).path.is_dir()


def test_a_read_only_folder_is_not_closed_and_said_so(tmp_path):
    made = small_run(tmp_path / "run")
    made.close()
    run = made.path
    tmp_path.chmod(0o777)
    (run / "settings.csv").unlink()
    run.chmod(0o555)
    pid = os.fork()
    if not pid:
        os.chdir(tmp_path)
        if os.getuid() == 0:  # root could write there all the same
            os.setuid(65534)
        try:
            Run.open(Path("run")).close()
        except ResourceExhausted as error:
            Path("said").write_text(str(error))
        os._exit(0)
    os.waitpid(pid, 0)
    run.chmod(0o755)
    said = (tmp_path / "said").read_text()
    assert said.startswith("run cannot be closed: permission denied")
    assert said.endswith("then: benchtool runs close run")


IMPORTS = """
import sys
from benchtool.bench.guard import GuardedBench
from benchtool.commands.app import main

turning, imported = [], []
sys.addaudithook(
    lambda name, what: imported.append(what[0])
    if name == "import" and turning and what[0] not in sys.modules
    else None
)
order = GuardedBench.set_pwm

def watched(bench, pulses_us):
    turning.extend(us for us in pulses_us if us > 1100.0)
    return order(bench, pulses_us)

GuardedBench.set_pwm = watched
try:
    main(sys.argv[1:])
except SystemExit as ended:
    assert ended.code == 0
assert turning
print("imported:", *imported)
"""


@pytest.mark.parametrize(
    "words",
    [
        (*SWEEP, "run"),
        ("record", "sim:pquad?mode=pitch", "--seconds", "1", "--yes", "--out", "run"),
    ],
    ids=["sweep", "record"],
)
def test_nothing_is_imported_once_motors_turn(tmp_path, words):
    run = [sys.executable, "-c", IMPORTS, *words]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].strip() == "imported:"
    assert (tmp_path / "run/samples.parquet").is_file()
