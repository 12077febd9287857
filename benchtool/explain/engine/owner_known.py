"""How well the owner of a plate bench knows what an explanation may adjust of it."""

from __future__ import annotations

from benchtool.core.parameter import Parameter, Prior
from benchtool.explain.engine.effect_knobs import RADIUS_KNOWN

RADIUS_FITTED = 0.05
"""Standard error of R_m over its value where a model leaves it to a fit: an effective radius is
within a tenth of the rotor's; a choice."""

K_KNOWN, K_FITTED = 0.01, 0.1
"""The same two for k; a load cell's scale is known to a per cent, a rotor's coefficient is not."""

_SHARES = {"k": (K_KNOWN, K_FITTED), "R_m": (RADIUS_KNOWN, RADIUS_FITTED)}


def known_prior(name: str, item: Parameter) -> Prior | None:
    """Return the normal prior under which a sweep's explanation adjusts a number.

    The stated one, else a share of the value for k and R_m; None for any other without one.
    """
    if item.prior.kind == "normal":
        return item.prior
    if name not in _SHARES:
        return None
    share = _SHARES[name][item.free]
    source = f"assumed by benchtool explain: {100.0 * share:g} % where none is stated"
    return Prior("normal", item.value, share * item.value, source)
