"""Table of all benchmarks: median of five processes each, beside another commit if one is named.

    python -m tests.proof.benchmarks.table [NAME ...] [--beside COMMIT] [--quick] [--page]

`make bench` runs it. Rows are printed and written to build/bench.json; `--page` writes those of
the last run into docs/explanation/performance.md and draws the figure of scale, and measures
nothing.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import platform
import statistics
import subprocess
import sys
import tarfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

from tests.proof.benchmarks.rows import TOP, Row, machine_slowness

NAMES = sorted(path.stem.removeprefix("bench_") for path in Path(__file__).parent.glob("bench_*"))
RESULTS = TOP / "build" / "bench.json"
PAGE = TOP / "docs" / "explanation" / "performance.md"
REPETITIONS = 5
ONCE = ("hold", "scale")  # take minutes, or count events of their own


def measure(name: str, product: Path = TOP, *, quick: bool = False) -> tuple[list[Row], str]:
    """Return the rows of a benchmark and its error, if any.

    It runs in a process of its own with the product of a folder.
    """
    environment = {
        "PYTHONPATH": os.pathsep.join((str(product), str(TOP))),
        "PYTHONSAFEPATH": "1",  # the working directory is not searched
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    code = "from tests.proof.benchmarks.table import print_rows; print_rows()"
    ended = subprocess.run(
        [sys.executable, "-c", code, name, *["--quick"] * quick],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    lines = (line for line in ended.stdout.splitlines() if line.startswith('{"work"'))
    error = f"{name}: {ended.stderr.strip()[-600:]}" if ended.returncode else ""
    return [Row(**json.loads(line)) for line in lines], error


def print_rows() -> None:
    """Print the rows of the benchmark named on the command line, as lines of JSON."""
    module = import_module(f"tests.proof.benchmarks.bench_{sys.argv[1]}")
    for row in module.rows("--quick" in sys.argv):
        print(json.dumps(asdict(row)), flush=True)


def medians(repetitions: Sequence[list[Row]]) -> list[Row]:
    """Return one row for each work and size, with the medians of its figures."""
    groups: dict[tuple[str, int], list[Row]] = {}
    for row in (row for rows in repetitions for row in rows):
        groups.setdefault((row.work, row.size), []).append(row)
    return [
        replace(
            group[0],
            ours=statistics.median(row.ours for row in group),
            peer=statistics.median(row.peer for row in group if row.peer is not None)
            if group[0].peer is not None
            else None,
        )
        for group in groups.values()
    ]


def extract(commit: str) -> Path:
    """Return a folder with the product at a commit."""
    identity = subprocess.check_output(["git", "rev-parse", commit], cwd=TOP, text=True).strip()
    folder = TOP / "build" / "beside" / identity
    if not folder.is_dir():
        archive = subprocess.check_output(["git", "archive", identity, "benchtool"], cwd=TOP)
        with tarfile.open(fileobj=BytesIO(archive)) as tar:
            tar.extractall(folder, filter="data")
    return folder


def run(
    name: str, beside: Path | None, times: int, *, quick: bool
) -> tuple[list[dict[str, Any]], set[str]]:
    """Measure both commits in turns; return rows and errors of this commit.

    `before` of a row is None where it does not run in the other commit.
    """
    now: list[list[Row]] = []
    before: list[list[Row]] = []
    errors = set()
    for _ in range(1 if quick or name in ONCE else times):
        measured, error = measure(name, quick=quick)
        now.append(measured)
        errors |= {error} - {""}
        if beside is not None:
            before.append(measure(name, beside, quick=quick)[0])
    earlier = {(row.work, row.size): row.ours for row in medians(before)}
    rows = [
        asdict(row) | {"bench": name, "before": earlier.get((row.work, row.size))}
        for row in medians(now)
    ]
    return rows, errors


def number(value: float | None) -> str:
    """Return three digits of a figure, or a dash."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def table(results: dict[str, Any], *, page: bool = False) -> str:
    """Return the results as a Markdown table; the page has the rows with a limit or a size."""
    before, slowness = results["before"], results["slowness"]
    heads = ["work", *([before] if before else []), "now", "unit", *(["ratio"] if before else [])]
    lines = [[*heads, "peer", "times peer", "wanted", "bench"]]
    for fields in results["rows"]:
        fields = dict(fields)
        bench, earlier = fields.pop("bench"), fields.pop("before")
        row = Row(**fields)
        if page and (row.wanted is None or row.size):
            continue
        work = row.work + f" {row.size:,}" * bool(row.size)
        unit = row.unit + (f", {row.memory_MB:.0f} MB" if row.memory_MB else "")
        change = None if earlier is None else row.ours / earlier
        peer = f"{row.peer_name} {number(row.peer)}" if row.peer is not None else "–"
        wanted = "–"
        if row.wanted is not None:
            sign = "≥" if row.is_rate else "≤"
            wanted = f"{sign} {number(row.wanted)}{' × peer' * row.of_peer}"
            limit = row.limit(slowness)
            wanted += f", here {number(limit)}" if limit != row.wanted else ""
            wanted += "" if row.is_met(slowness) else ", missed"
        line = [work, *([number(earlier)] if before else []), number(row.ours), unit]
        line += [number(change)] if before else []
        lines.append([*line, peer, number(row.ratio), wanted, f"`{bench}`"])
    lines.insert(1, ["---"] * len(lines[0]))
    widths = [0 if page else max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = (
        (cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines
    )
    return "\n".join(f"| {' | '.join(cells)} |" for cells in texts)


def write_page(results: dict[str, Any]) -> None:
    """Write the table of the page between its marks, and draw the figure of scale."""
    from benchtool.report.figure import look, new_figure, save_figure

    before, begin, rest = PAGE.read_text("utf-8").partition("<!-- bench -->\n")
    after = rest.partition("<!-- end of bench -->")[2]
    head = (
        f"{results['date']}, commit {results['commit']}, {results['machine']}; typer takes "
        f"{results['slowness']:.2f} times as long to import as where the limits were set.\n"
    )
    text = f"{head}\n{table(results, page=True)}\n\n"
    PAGE.write_text(f"{before}{begin}{text}<!-- end of bench -->{after}", "utf-8")
    groups: dict[str, list[Row]] = {}
    for fields in results["rows"]:
        row = Row(**{key: fields[key] for key in fields if key not in ("bench", "before")})
        if row.size:
            groups.setdefault(row.work, []).append(row)
    if not groups:
        return
    with look():
        figure = new_figure("Cost against size", simulated=False, height_in=5.0)
        upper, lower = figure.subplots(2, 1, sharex=True)
        for work, rows in groups.items():
            sizes = [row.size for row in rows]
            upper.loglog(sizes, [row.ours for row in rows], "o-", label=work)
            lower.loglog(sizes, [row.memory_MB or float("nan") for row in rows], "o-")
        upper.set_ylabel("time, s")
        lower.set_ylabel("peak memory, MB")
        lower.set_xlabel("size: points, seconds, runs")
        upper.legend(fontsize="small")
        save_figure(figure, TOP / "docs" / "assets" / "scale", ("svg",), replace=True)


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--beside", default="", help="commit to measure in turns")
    parser.add_argument("--times", type=int, default=REPETITIONS, help="processes of a row")
    parser.add_argument("--quick", action="store_true", help="tiny sizes, once")
    parser.add_argument("--page", action="store_true", help="write the page, measure nothing")
    given = parser.parse_args()
    if given.page:
        write_page(json.loads(RESULTS.read_text("utf-8")))
        return
    describe = ["git", "describe", "--always", "--dirty"]
    results: dict[str, Any] = {
        "commit": subprocess.check_output(describe, cwd=TOP, text=True).strip(),
        "before": given.beside,
        "date": dt.date.today().isoformat(),
        "machine": f"{os.cpu_count()} cores, Python {platform.python_version()}, load "
        f"{os.getloadavg()[0]:.1f}, medians of {given.times}",
        "slowness": machine_slowness(),
        "rows": [],
    }
    beside = extract(given.beside) if given.beside else None
    failures: set[str] = set()
    for name in given.names or NAMES:
        print(f"{name} ...", file=sys.stderr, flush=True)
        measured, errors = run(name, beside, given.times, quick=given.quick)
        results["rows"] += measured
        failures |= errors
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(json.dumps(results, indent=1), "utf-8")
    print(table(results))
    if failures:
        sys.exit("\n".join(failures))


if __name__ == "__main__":
    main()
