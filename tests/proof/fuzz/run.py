"""Fuzz every target for so many minutes: `python -m tests.proof.fuzz.run MINUTES`.

Where atheris is installed it looks for inputs that reach new lines (coverage-guided); elsewhere
seeds are changed at random. Counts and found inputs are written as they come, to build/fuzz; the
next run goes on counting.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from random import Random

from tests.proof.fuzz.engine import fuzz
from tests.proof.fuzz.targets import Files, targets

OUT = Path("build/fuzz")
PART_S = 5.0  # each target has its turn for so long; assumed

NONE = {"inputs": 0, "seconds": 0.0}


def keep(name: str, data: bytes) -> Path:
    """Write an input that was found and return its path."""
    path = OUT / "found" / f"{name.replace(' ', '-')}--{hashlib.sha256(data).hexdigest()[:10]}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def guided(name: str, seconds: float) -> int:
    """Fuzz one target with atheris in a process of its own and return the inputs it tried."""
    corpus = OUT / "corpus" / name.replace(" ", "-")
    corpus.mkdir(parents=True, exist_ok=True)
    words = [f"-max_total_time={max(1, round(seconds))}", "-timeout=10", "-rss_limit_mb=4096",
             f"-artifact_prefix={OUT}/", str(corpus)]  # fmt: skip
    line = [sys.executable, "-m", "tests.proof.fuzz.guided", name, *words]
    ended = subprocess.run(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    said = ended.stderr.decode("utf-8", "replace")
    tried = re.findall(r"^(?:Done (\d+) runs|#(\d+))", said, re.MULTILINE)
    if ended.returncode:
        print(said[-2000:])
    return max([0, *(int(done or seen) for done, seen in tried)])


def summary(counts: dict[str, dict[str, float]], names: Iterable[str]) -> str:
    """Return the table of all targets, and how many of them have had their turn."""
    rows = {name: counts.get(name, NONE) for name in names}
    lines = ["| target | inputs | a second |", "|---|---|---|"]
    for name, had in rows.items():
        rate = had["inputs"] / max(had["seconds"], 1e-9)
        lines.append(f"| {name} | {had['inputs']:,} | {rate:,.0f} |")
    lines.append(f"| all | {sum(had['inputs'] for had in rows.values()):,} | |")
    turns = sum(had["seconds"] > 0.0 for had in rows.values())
    if turns < len(rows):
        lines.append(f"{turns} of {len(rows)} parsers had their turn; run again to go on")
    return "\n".join(lines)


def main(minutes: float, with_atheris: bool) -> int:
    """Return 1 where an input was found."""
    print("guided by the lines that an input reaches (atheris)" if with_atheris
          else "unguided: atheris is not installed, so seeds are changed at random")  # fmt: skip
    until_s, seed = time.time() + 60.0 * minutes, time.time_ns()
    record = OUT / "counts.json"
    record.parent.mkdir(parents=True, exist_ok=True)
    counts = json.loads(record.read_text()) if record.exists() else {}
    on_disk, bad = Files(), 0
    try:
        every = targets(on_disk)
        part_s = max(PART_S, 60.0 * minutes / len(every)) if with_atheris else PART_S
        while time.time() < until_s:
            # Time that is too short for all begins with those that had least.
            for name in sorted(every, key=lambda name: counts.get(name, NONE)["seconds"]):
                if time.time() >= until_s:
                    break
                before_s, faults = time.process_time(), dict[str, bytes]()
                if with_atheris:
                    number, spent_s = guided(name, part_s), part_s
                else:
                    seed += 1
                    number, faults = fuzz(every[name], Random(seed), seconds=part_s)
                    spent_s = time.process_time() - before_s
                had = counts.get(name, NONE)
                counts[name] = {"inputs": had["inputs"] + number,
                                "seconds": had["seconds"] + spent_s}  # fmt: skip
                record.write_text(json.dumps(counts, indent=1))
                for fault, data in faults.items():
                    bad += 1
                    print(f"{name}: {fault} {keep(name, data)}", flush=True)
    finally:
        on_disk.close()
    print(summary(counts, every))
    return int(bool(bad or list(OUT.glob("found/*"))))


if __name__ == "__main__":
    try:
        sys.exit(main(float(sys.argv[1]), find_spec("atheris") is not None))
    except KeyboardInterrupt:
        print(f"stopped; counts so far are in {OUT}; the same command goes on counting")
        sys.exit(130)
