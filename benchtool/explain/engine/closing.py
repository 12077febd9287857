"""Every one of several named effects must close a part of the gap of its own.

A law that is a little off in shape leaves something that another effect picks up: the likelihood
of so many rows calls it significant, and the prediction of what was not learned from is none the
better for it.
"""

from __future__ import annotations

import numpy as np

from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.search import Search, without
from benchtool.explain.engine.subject import ChannelErrors, Subject

CLOSES = 0.02
"""Part of the error on the check recordings, root mean square in the channel that gains most, that
an effect must take away. On development records true second effects took 0.06 and more, what took
up the rest of another's law less than nothing."""


def closing(subject: Subject, hypotheses: Hypotheses, search: Search) -> Search:
    """Return the search without effects that close no part of the gap on the check recordings."""
    while len(search.best.opened) > 1:
        sets = np.vstack([*(slot.base.at for slot in search.slots), search.best.at])
        found = subject.errors(sets)
        parts = [max(_part(one, k) for one in found.values()) for k in range(len(search.slots))]
        least = int(np.argmin(parts))
        if parts[least] > CLOSES:
            return search
        search = without(hypotheses, search, search.slots[least].name)
    return search


def _part(found: ChannelErrors, column: int) -> float:
    """Return the part of the error of a column's set that the last set takes away."""
    before, after = np.mean(found.squares[:, [column, -1]], axis=0)
    return float(1.0 - np.sqrt(after / max(before, 1e-300)))
