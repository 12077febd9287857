"""Listen on after a stop, so that a run shows pulses and speeds falling."""

from __future__ import annotations

from collections.abc import Iterator

from benchtool.bench.bench import Bench, Readings
from benchtool.errors import BenchtoolError, DeviceStopped

STEP_S = 0.05


def after_stop(bench: Bench, seconds: float) -> Iterator[Readings]:
    """Give what a bench still sends for so long after zero was commanded; never raises.

    Whatever waited in the link when the stop came, as during a move of the plate, comes first. A
    link that does not answer ends it. Limits are not checked any more: there is nothing left to
    stop.

    Args:
        bench: the one on the wire, not its guard, which would raise why it was stopped.
        seconds: on the bench's clock.
    """
    told = False
    until_s = bench.now_s() + seconds
    while (left_s := until_s - bench.now_s()) > 1e-9:
        try:
            readings = bench.read(min(STEP_S, left_s))
        except DeviceStopped:
            if told:
                return
            told = True
        except (BenchtoolError, OSError):
            return
        else:
            yield readings
