"""Hashes of outputs that a change of structure must not change; deleted when the redesign ends.

    python -m tests.proof.frozen.frozen          # compare; exit code 1 where one differs
    python -m tests.proof.frozen.frozen --write  # store

Hashes are bit by bit, those of fits to 9 digits, so both sides belong to one machine. Explanations
of foreign records, without their remarks, need `BENCHTOOL_REFERENCE_DATA` and are else left out.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pandas as pd

from tests.faults.links import Far
from tests.faults.loop import World, plan, sweep_in

ROOT = Path(__file__).parents[3]
HASHES = Path(__file__).with_name("hashes.json")
DATA = os.environ.get("BENCHTOOL_REFERENCE_DATA")
SETTINGS = {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
UNSTABLE = {
    "remarks",
    "seconds",
    "commit",
    "version",
    "benchtool",
    "python",
    "created",
    "written",
    "wall_s",
}
SIMULATIONS = {
    "pitch pquad": "simulate pitch --duration-s 8 --seed 1",
    "pitch beam": "simulate pitch --model pitch_beam --schedule identify --duration-s 8 --seed 2",
    "pitch amuse": "simulate pitch --rig amuse --gains stiff --duration-s 8 --seed 3",
    "pitch batch": "simulate pitch --vary gains.attitude.k_q_per_s=6:10:3 --seeds 2 --duration-s 4",
    "flight over": "simulate flight --seed 1",
    "flight gust": "simulate flight --case gust --seed 2",
    "flight batch": "simulate flight --vary z_over_R=1:3:3 --seeds 2",
}
EXPLAINED = {
    "pitch_friction": "datasets/pitch_friction/learn.parquet"
    " --check datasets/pitch_friction/check.parquet --model datasets/pitch_bench/model.toml",
    "quad": "datasets/quad/run --model quad_bench --check datasets/three_rotors/run",
    "single": "datasets/single_rotor/run --model single_bench --check datasets/partial_area/run",
}


def tool(arguments: str | list[str], folder: Path) -> None:
    """Run benchtool."""
    words = arguments.split() if isinstance(arguments, str) else arguments
    ended = subprocess.run(
        [sys.executable, "-m", "benchtool", *words], cwd=ROOT, capture_output=True, text=True,
        env=os.environ | SETTINGS,
    )  # fmt: skip
    if ended.returncode:
        raise RuntimeError(f"benchtool {' '.join(words)}: {ended.stderr.strip()[-300:]}")


def stable(value: object, digits: int = 17) -> object:
    """Return a JSON value without times, versions and remarks, floats to some digits."""
    if isinstance(value, dict):
        return {key: stable(item, digits) for key, item in value.items() if key not in UNSTABLE}
    if isinstance(value, list):
        return [stable(item, digits) for item in value]
    if isinstance(value, str) and " " in value:
        return ""  # sentences may be reworded
    return f"{value:.{digits}g}" if isinstance(value, float) else value


def hash_tables(folder: Path) -> str:
    """Return one hash of all tables and results below a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".csv":
            digest.update(path.name.encode() + path.read_bytes())
        elif path.name == "campaign.parquet":
            digest.update(pd.read_parquet(path).to_csv().encode())
        elif path.name in ("result.json", "answer.json"):
            digits = 9 if path.name == "result.json" else 17
            text = json.dumps(stable(json.loads(path.read_text()), digits), sort_keys=True)
            digest.update(path.name.encode() + text.replace(str(folder), "").encode())
    return digest.hexdigest()[:16]


def explain(arguments: list[str], folder: Path) -> None:
    """Write answer.json of an explanation."""
    tool(["explain", *arguments, "--json", str(folder / "answer.json")], folder)


def outputs() -> Iterator[tuple[str, str]]:
    """Yield the name and hash of each output."""
    for name, arguments in SIMULATIONS.items():
        with tempfile.TemporaryDirectory() as made:
            tool([*arguments.split(), "--out", f"{made}/out"], Path(made))
            yield name, hash_tables(Path(made))
    for recipe in sorted(path.parent.name for path in (ROOT / "fits").glob("*/recipe.toml")):
        with tempfile.TemporaryDirectory() as made:
            tool(f"fit --recipe fits/{recipe} --out {made}/out", Path(made))
            yield f"fit {recipe}", hash_tables(Path(made))
    for name, arguments in EXPLAINED.items():
        with tempfile.TemporaryDirectory() as made:
            explain(arguments.split(), Path(made))
            yield f"explain {name}", hash_tables(Path(made))
    for link in ("memory", "mavlink"):
        with tempfile.TemporaryDirectory() as made:
            yield f"wire {link}", hash_wire(link, Path(made))
    with tempfile.TemporaryDirectory() as made:
        sweep = "sweep sim:pquad --repeats 1 --z-over-r 0.5,1,2 --sample-s 1 --yes"
        tool(f"{sweep} --out {made}/run", Path(made))
        yield "sweep sim:pquad", hash_tables(Path(made))
    for family in ("sweeps", "pitch") if DATA else ():
        for seed in range(6):
            yield f"explain foreign {family} {seed}", hash_foreign(family, seed)


def hash_wire(link: str, folder: Path) -> str:
    """Return the hash of all bytes of a sweep on a virtual clock, both ways."""
    sent = hashlib.sha256()
    read, write = Far.read, Far.write

    def noted_read(far: Far) -> bytes:
        data = read(far)
        sent.update(b">" + data if data else b"")
        return data

    def noted_write(far: Far, data: bytes) -> int:
        sent.update(b"<" + data if data else b"")
        return write(far, data)

    with mock.patch.object(Far, "read", noted_read), mock.patch.object(Far, "write", noted_write):
        world = World([], link=link)
        try:
            outcome = sweep_in(world, folder, plan("1.36, 1.32"))
        finally:
            world.close()
    assert outcome.code == 0, outcome.said
    return sent.hexdigest()[:16]


def hash_foreign(family: str, seed: int) -> str:
    """Return the hash of the answer on a foreign record."""
    assert DATA is not None
    generator = Path(DATA).parent / "foreign" / f"{family}.py"
    effects = {
        "sweeps": ["none", "plate_offset", "body_lift", "battery_sag", "x_law", "plate_tilt"],
        "pitch": ["none", "coulomb_friction", "gyro_bias", "x_law", "motor_lag", "cog_offset"],
    }
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        words = ["--seed", str(seed), "--effect", effects[family][seed], "--out", f"{made}/records"]
        command = [sys.executable, str(generator), *words, "--size", "2"]
        ended = subprocess.run(command, check=True, capture_output=True, text=True)
        record = Path(ended.stdout.strip())
        records = [str(record / "learn.csv"), "--check", str(record / "check.csv")]
        explain([*records, "--model", str(record / "model.toml")], folder)
        answer = folder / "answer.json"
        text = answer.read_text() if answer.exists() else "none"
        text = json.dumps(stable(json.loads(text))) if answer.exists() else text
        return hashlib.sha256(text.replace(str(folder), "").encode()).hexdigest()[:16]


def main() -> int:
    """Print each output that differs."""
    found = {}
    for name, value in outputs():
        found[name] = value
        print(f"{name:32} {value}", flush=True)
    if "--write" in sys.argv:
        HASHES.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    stored = json.loads(HASHES.read_text())
    different = [name for name, value in found.items() if stored.get(name) != value]
    print("different: " + (", ".join(different) or "none"))
    return bool(different)


if __name__ == "__main__":
    sys.exit(main())
