"""Calls that run benches, and read and compare what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.acquire.inputs import RecordInputs, SweepInputs
from benchtool.acquire.operator import Operator
from benchtool.acquire.session import run_keywords
from benchtool.api.messages import keyword_messages
from benchtool.core.choices import Over
from benchtool.core.keywords import with_keywords
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.columns import concatenate_frames, rows_to_frame, to_frame
from benchtool.data.derived import add_quantities, load_run_context, with_quantities
from benchtool.data.run.read import is_run
from benchtool.report.compare import page as comparing
from benchtool.report.replay.replay_source import STAND, ReplaySource, read_recorded
from benchtool.report.report_file import detect_kind
from benchtool.report.result import Data, Result, saved_paths
from benchtool.report.sweep.page import SWEEP
from benchtool.report.sweep.run import SweepRun, read_sweep_run

if TYPE_CHECKING:
    import pandas as pd

EXPERIMENT = ("address", "operator", "dry_run")  # inputs that other parameters replace


@keyword_messages()
def read(path: Data) -> Result[SweepRun] | Result[ReplaySource]:
    """Read a run folder, a recording, a log in an import format, or a table in memory.

    Parameters
    ----------
    path : str, Path, DataFrame or mapping of arrays
        Run folder; recording of `import` or `simulate`; log or table. Columns of a table have
        channel names, or usual names with the unit in brackets or in ``attrs["units"]``.

    Returns
    -------
    Result
        Tables: `points`, `settings` and `samples` of a sweep; `samples` otherwise.

    Raises
    ------
    FileFormatError
        Missing path or unknown content.

    Examples
    --------
    >>> import benchtool as bt
    >>> log = bt.read({"time_s": [0.0, 0.5, 1.0], "thrust_N": [0.0, 1.0, 2.0]})
    >>> log.to_dataframe().attrs["units"]["thrust_N"]
    'N'
    """
    (text,) = saved_paths(path)
    path = Path(text)
    if is_run(path) and detect_kind(path) == "sweep":
        return _sweep(path)
    replay = read_recorded(path)
    n_rows = len(replay.recording)
    names = ", ".join(replay.recording.names)
    return Result(
        found=replay, path=path, _page=STAND,
        _summary=lambda source: f"{source.name}: {n_rows} rows of {names}",
        _tables={"samples": lambda source: to_frame(source.with_quantities())},
    )  # fmt: skip


def _sweep(path: Path) -> Result[SweepRun]:
    tables: dict[str, Callable[[SweepRun], pd.DataFrame]] = {
        "points": lambda run: to_frame(add_quantities(run.points, load_run_context(path))),
        "settings": lambda run: to_frame(with_quantities(run.settings, run.quantities)),
    }
    run = read_sweep_run(path)
    if (samples := run.samples) is not None:
        tables["samples"] = lambda run: to_frame(samples)
    return Result(
        found=run, path=path, _page=SWEEP, _summary=lambda run: str(SWEEP.summary(run)),  # type: ignore[operator]
        _tables=tables,
    )  # fmt: skip


@with_keywords(SweepInputs, omit=EXPERIMENT)
def sweep(
    bench: str = "",
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    progress: bool = False,
    operator: Operator | str | None = None,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[SweepRun]:
    """Sweep plate distance and throttle like `benchtool sweep`, and read the run.

    Motors turn. Every exit stops them, including Ctrl-C and *Interrupt* of a notebook; signals
    are handled only if this is called in the main thread, as in notebooks.

    Parameters
    ----------
    bench : str
        Address, for example ``"sim:pquad"``; not needed with ``resume=``.
    rig : Rig, str or Path, optional
        Rig on the bench; default: rig of a ``sim:`` address.
    yes : bool, default False
        Skip the arming confirmation, for a simulated bench or one whose `benchtool bench check`
        passed today.
    progress : bool, default False
        Show one progress bar; by default nothing is printed.
    operator : Operator or str, optional
        Interface for the arming confirmation in place of `yes`, or the operator's name.
    permit : callable, optional
        Called with user code files in the address; by default this raises.

    Returns
    -------
    Result
        Run as of `read`.

    Raises
    ------
    InputError
        No confirmation, or invalid or incomplete inputs; no motor has turned.
    BenchError, RunInterrupted
        The sweep ended early; throttle is zero, and the measured points are in the run folder.

    Examples
    --------
    >>> import benchtool as bt
    >>> run = bt.sweep("sim:pquad_single", z_over_r=(0.6, 0.8, 1, 1.5, 3), pwm=1500, repeats=2,
    ...                sample_s=0.5, anchor_every=0, yes=True, out="run")
    >>> len(run.to_dataframe("settings"))
    6
    """
    values = {"address": bench or None, "yes": yes} | options
    return _sweep(run_keywords("sweep", values, rig, operator, permit, progress=progress))


@with_keywords(RecordInputs, omit=EXPERIMENT)
def record(
    bench: str,
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    operator: Operator | str | None = None,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[ReplaySource]:
    """Record a pitch experiment like `benchtool record`, and read the run.

    Parameters
    ----------
    bench : str
        Address, for example ``"sim:pquad?mode=pitch"``.
    rig, yes, operator, permit
        As in `sweep`.

    Returns
    -------
    Result
        Run as of `read`.

    Raises
    ------
    InputError, BenchError, RunInterrupted
        As in `sweep`.

    Examples
    --------
    >>> import benchtool as bt
    >>> run = bt.record("sim:pquad?mode=pitch", seconds=1.0, yes=True, out="pitch")
    >>> "theta_rad" in run.to_dataframe()
    True
    """
    values = {"address": bench, "yes": yes} | options
    path = run_keywords("record", values, rig, operator, permit)
    return read(path)  # type: ignore[return-value]


@keyword_messages()
def compare(
    data: Data | Sequence[Data], *, over: Over = "thrust", at_thrust_N: float | None = None
) -> Result[comparing.RunComparison]:
    """Compare runs and recordings, like `benchtool report --over --at-thrust`.

    Parameters
    ----------
    data : str, Path, Result, DataFrame, mapping of arrays, or a sequence of these
        Run folders or recordings of `benchtool import`.
    over : str, default "thrust"
        Abscissa of the figure.
    at_thrust_N : float, optional
        Thrust at which the runs are ranked, in N.

    Returns
    -------
    Result
        Tables: `curves`, and with `at_thrust_N` also `best`, most efficient first.

    Raises
    ------
    InputError
        No run contains the abscissa.

    Examples
    --------
    >>> import benchtool as bt
    >>> bt.compare("run", over="distance").to_dataframe("curves").attrs["units"]["thrust_N"]
    'N'
    """
    comparison = comparing.compare_runs(
        [Path(path) for path in saved_paths(data)], over, at_thrust_N
    )
    tables: dict[str, Callable[[comparing.RunComparison], pd.DataFrame]] = {
        "best": lambda comparison: rows_to_frame(comparing.best_rows(comparison)),
        "curves": lambda comparison: concatenate_frames(comparison.tables()),
    }
    if not comparison.found:
        del tables["best"]
    page, summary = comparing.COMPARISON, comparing.comparison_sentence
    return Result(found=comparison, _page=page, _summary=summary, _tables=tables)
