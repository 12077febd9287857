"""Record a pitch experiment for the page: the command line's own functions, told of as a sweep."""

from __future__ import annotations

from benchtool.acquire.new_run import new_pitch_run
from benchtool.acquire.pitch_experiment import expected_on
from benchtool.acquire.pitch_record import record_pitch, summary_line
from benchtool.bench.guard import GuardedBench
from benchtool.core.rig import Rig
from benchtool.errors import BenchError, BenchtoolError
from benchtool.web.desk.asks import Record
from benchtool.web.desk.news import Swept
from benchtool.web.desk.sweeping import Sweeping, require_armed


def record(bench: GuardedBench, rig: Rig, ask: Record, sweeping: Sweeping) -> None:
    """Record; motors are at zero when this returns or raises.

    Raises:
        BenchtoolError: why it could not begin.
        BenchError: the bench is not to be used any more.
    """
    sweeping.finish()
    identity = bench.identity
    expected_on(identity, ask.experiment, rig)
    require_armed(ask.typed, identity, rig)
    run = new_pitch_run((ask.runs, ask.name, None), ask.experiment, rig, identity)
    sweeping.begin(Swept(status="running", pitch=True, run=str(run.path)))
    try:
        summary = record_pitch(
            bench, rig, ask.experiment, run, sweeping, lambda left_s: sweeping.tell(left_s=left_s)
        )
        sweeping.close(run, "ended", summary_line(summary))
    except BenchtoolError as error:
        sweeping.close(run, "stopped", bench.with_standstill(str(error)))
        bench.require_standstill(ends_normally=True)
        if isinstance(error, BenchError):
            raise
