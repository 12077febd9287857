"""Cost against size: a fit, an explanation, the catalogue and a campaign, with their memory.

Every figure is a process of its own, in wall time. A campaign runs on the workers of a scheduler of
this machine, each with one thread; the memory is that of the process that writes its table.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.proof.benchmarks.bench_catalogue import make_runs
from tests.proof.benchmarks.bench_startup import write_points
from tests.proof.benchmarks.rows import Row, alone

MAX_FIT_S = 30.0  # no larger fit after one that took longer

FIT = """
import benchtool as bt
def fit(path):
    return bt.fit(path, model="single", rig="pquad_single")
fit(arguments[0])
"""

EXPLAIN = """
from tests.proof.benchmarks.bench_explain import explain, pitch_subject
explain(pitch_subject("coulomb_friction", 1), propose=False)
subject = pitch_subject("coulomb_friction", int(arguments[0]))
"""

INDEX = """
from pathlib import Path
from benchtool.data.catalogue.index import load_entries
"""

CAMPAIGN = """
from dataclasses import replace
from pathlib import Path
from benchtool.simulate.campaign import Design, build_campaign, run_campaign
from benchtool.simulate.inputs import PitchInputs
base = PitchInputs(controllers=("pid",))
study = replace(base.study, campaign=replace(base.study.campaign, cluster=arguments[0]))
inputs = replace(base, study=study)
def run(seeds):
    design = Design.read(["gains.attitude=0.9:1.1:10"], seeds=seeds)
    table = Path(arguments[2]) / f"{seeds}.parquet"
    return run_campaign(build_campaign(inputs), inputs, design, table, {}, lambda done: None)
run(10)
"""


def rows(quick: bool) -> Iterator[Row]:
    """Yield all sizes of each work."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_points(folder / "small.csv", 40)
        for size in (40,) if quick else (40, 200, 1000, 4000, 40_000):
            write_points(folder / "points.csv", size)
            files = folder / "small.csv", folder / "points.csv"
            wall, _, memory_MB = alone(FIT, "fit(arguments[1])", *files)
            yield Row("fit, points", wall, "s", size=size, memory_MB=memory_MB)
            if wall > MAX_FIT_S:
                break
        for blocks in () if quick else (1, 2, 4, 8):  # short form: bench_explain
            work = "explain(subject, propose=False)"
            wall, _, memory_MB = alone(EXPLAIN, work, blocks)
            yield Row("explain, s", wall, "s", size=30 * blocks, memory_MB=memory_MB)
        for count in (10,) if quick else (100, 1000, 10_000):
            place = folder / f"catalogue{count}"
            place.mkdir()
            os.environ["BENCHTOOL_STATE"] = str(place / "state")
            make_runs(place, count, 100)
            wall, _, memory_MB = alone(INDEX, "load_entries(Path(arguments[0]))", place / "runs")
            yield Row("index of the catalogue, runs", wall, "s", size=count, memory_MB=memory_MB)
        yield from campaign_rows(folder, (200,) if quick else (1000, 4000, 16_000))


def campaign_rows(folder: Path, sizes: tuple[int, ...]) -> Iterator[Row]:
    """Yield pitch campaigns on one and on two workers."""
    from distributed import LocalCluster

    for workers in (1,) if len(sizes) == 1 else (1, 2):
        with ExitStack() as stack:
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, protocol="tcp"
            )
            stack.enter_context(cluster)
            for size in sizes:
                place = Path(stack.enter_context(TemporaryDirectory(dir=folder)))
                arguments = cluster.scheduler_address, size // 10, place
                wall, _, memory_MB = alone(CAMPAIGN, "run(int(arguments[1]))", *arguments)
                work = f"campaign on {workers} worker{'s' * (workers > 1)}, runs"
                yield Row(work, wall, "s", size=size, memory_MB=memory_MB)
