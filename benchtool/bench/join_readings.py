"""Join readings that arrived one after another into one block."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.bench.bench import Readings


def joined(parts: Sequence[Readings]) -> Readings:
    """Return one block of all samples, losses added up, messages in order."""
    if len(parts) == 1:
        return parts[0]
    return Readings(
        time_s=np.concatenate([part.time_s for part in parts]),
        device_time_us=np.concatenate([part.device_time_us for part in parts]),
        values=np.concatenate([part.values for part in parts]),
        lost=sum(part.lost for part in parts),
        corrupt=sum(part.corrupt for part in parts),
        messages=tuple(message for part in parts for message in part.messages),
        repeated=sum(part.repeated for part in parts),
    )
