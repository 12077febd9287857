"""How near readings are to their limits. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchtool.core.rig import Limits
from benchtool.web.desk.news import Near

Array = NDArray[np.float64]


def near_limits(
    names: Sequence[str], low: Array, high: Array, pulses_us: Sequence[float], limits: Limits
) -> tuple[Near, ...]:
    """Return every limit with the reading that was nearest to it.

    Args:
        names: of channels (c,).
        low: least of each since the last look (c,); nan where nothing came.
        high: greatest of each (c,).
        pulses_us: commanded.
        limits: of the rig.
    """
    found = []
    for family, label, limit in (
        ("thrust_N", "thrust, N", min(limits.thrust_N, limits.load_cell_rating_N)),
        ("rpm", "speed, rpm", limits.rpm),
        ("current_A", "current, A", limits.current_A),
        ("temperature_degC", "ESC, degC", limits.temperature_degC),
    ):
        columns = [i for i, name in enumerate(names) if _family(name) == family]
        values = [max(high[i], -low[i] if family == "thrust_N" else high[i]) for i in columns]
        present = [float(value) for value in values if np.isfinite(value)]
        if present:
            found.append(Near(label, max(present), limit, max(present) / limit))
    if "voltage_V" in names:
        volts = float(low[list(names).index("voltage_V")])
        if np.isfinite(volts) and volts > 0.0:
            least = limits.voltage_min_V
            found.append(Near("least voltage, V", volts, least, least / volts))
    if pulses_us:
        pulse = max(pulses_us)
        found.append(Near("pulse, us", pulse, limits.pwm_us, pulse / limits.pwm_us))
    return tuple(found)


def _family(name: str) -> str:
    bare = name.rstrip("0123456789")
    return "rpm" if bare == "rpm" else name
