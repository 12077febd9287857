"""Fits of several rigs, read from their folders and pooled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from benchtool.core.counted import counted
from benchtool.core.errors import InputError
from benchtool.core.parameter import full_name
from benchtool.data.run.entry import FIT_FILE
from benchtool.fit.pool.hierarchy import Pooled, RigValues, pool_rigs
from benchtool.physics.catalogue import EFFECTS
from benchtool.report.fit.stored_fit import StoredFit, read_stored

ONE_QUANTITY = 1.0 - 1e-9  # correlation from which two are one quantity: R_m, R_m over radius


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PooledFits:
    """Hold the fits of several rigs and what they say together."""

    pooled: Pooled
    units: Mapping[str, str]  # of parameters
    basis: str
    simulated: bool
    seed: int
    hashes: Mapping[str, str]  # of data files, by fit and file


def pool_fits(
    folders: Sequence[Path],
    of: Sequence[str] = (),  # parameters; default: those of the physics without unit
    shared: Sequence[str] = (),
    *,
    seed: int = 1,
) -> PooledFits:
    """Pool the fits that folders hold, one of each rig.

    Raises:
        InputError: fewer than two fits, fits that cannot be used, or that share data.
        NotConverged: the chains of tau do not agree.
    """
    if len(folders) < 2:
        raise InputError(
            f"{counted(len(folders), 'fit')} given; pooling needs folders of 2 or more fits, as of "
            f"benchtool fit RUN --model MODEL --out FITS/RUN"
        )
    fits = {name: read_stored(folder) for name, folder in _names(folders).items()}
    hashes = _checked(fits)
    known = list(dict.fromkeys(name for fit in fits.values() for name in _budget(fit).names))
    both = [full_name(name, known, "fitted parameter") for name in (*of, *shared)]
    names = list(dict.fromkeys(both)) or [
        name
        for name in known
        if _is_physics(name, fits) and sum(name in _budget(fit).names for fit in fits.values()) > 1
    ]
    if not names:
        raise InputError(
            f"no parameter without a unit is in two of these fits; name some with --of, known: "
            f"{', '.join(known)}"
        )
    rigs = [_values(name, fit, names) for name, fit in fits.items()]
    pooled = pool_rigs(rigs, names, both[len(of) :], seed=seed)
    units = {k: v for fit in fits.values() for k, v in zip(_budget(fit).names, _budget(fit).units,
                                                           strict=True)}  # fmt: skip
    return PooledFits(
        pooled=pooled,
        units={name: units[name] for name in names},
        basis=next(iter(fits.values())).basis,
        simulated=any(fit.simulated for fit in fits.values()),
        seed=seed,
        hashes=hashes,
    )


def _names(folders: Sequence[Path]) -> dict[str, Path]:
    """Return folders by the shortest names that keep them apart."""
    for place, folder in enumerate(folders):
        if not (folder / FIT_FILE).is_file():
            raise InputError(f"{folder} holds no fit; name folders of benchtool fit --out")
        if folder.resolve() in (each.resolve() for each in folders[:place]):
            raise InputError(f"the fit {folder} is named twice; name each once")
    short = [folder.resolve().name for folder in folders]
    return {
        name if short.count(name) == 1 else str(folder): folder
        for name, folder in zip(short, folders, strict=True)
    }


def _budget(fit: StoredFit) -> Any:
    return fit.budget


def _checked(fits: Mapping[str, StoredFit]) -> dict[str, str]:
    """Refuse fits that cannot be pooled; return the hashes of their data."""
    first = next(iter(fits))
    owner: dict[str, str] = {}
    hashes = {}
    for name, fit in fits.items():
        result = fit.results[0]
        problem = ""
        if result.outcome.status != "converged" or fit.budget is None:
            problem = "has no answer"
        elif result.facts.get("verdict") == "rejected":
            problem = "has a model that its data reject, so that its intervals are too narrow"
        elif fit.basis != fits[first].basis:
            problem = f"is of basis {fit.basis}, {first} of {fits[first].basis}"
        for key, digest in result.facts.items():
            if key.startswith("sha256."):
                hashes[f"{name}: {key.removeprefix('sha256.')}"] = str(digest)
                if (other := owner.setdefault(str(digest), name)) != name:
                    problem = f"is of the same data as {other}, which would count twice"
        if problem:
            raise InputError(f"the fit {name} {problem}; fit it anew or leave it out")
    return hashes


def _is_physics(name: str, fits: Mapping[str, StoredFit]) -> bool:
    """Whether a parameter has no unit and describes neither noise nor a sensor nor the plate."""
    effect = EFFECTS.get(name.partition(".")[0])
    if name.startswith("noise.") or (effect and effect.subsystem in ("sensor", "plate")):
        return False
    return any(
        dict(zip(_budget(fit).names, _budget(fit).units, strict=True)).get(name) == "1"
        for fit in fits.values()
    )


def _values(label: str, fit: StoredFit, names: Sequence[str]) -> RigValues:
    """Return a fit's values with the covariance of its whole budget.

    A standard uncertainty is that of the normal distribution with the same 95 % interval, which
    Student's t of few degrees of freedom is wider than.
    """
    budget, result = _budget(fit), fit.results[0]
    own = tuple(name for name in names if name in budget.names)
    for item in (*result.estimates, *result.derived):
        if item.name in own and (item.bound or item.open):
            raise InputError(
                f"{item.name} of {label} {item.bound or f'is not determined: {item.open}'}; leave "
                f"that fit out, or name other parameters with --of"
            )
    at = [budget.names.index(name) for name in own]
    correlation = np.array(budget.correlation)[np.ix_(at, at)]
    for one, other in combinations(range(len(own)), 2):
        if abs(correlation[one, other]) > ONE_QUANTITY:
            raise InputError(f"{own[one]} and {own[other]} are one quantity; name one of them")
    sd = budget.expanded[at] / float(ndtri(0.975))
    return RigValues(
        name=label,
        names=own,
        values=np.array(budget.values)[at],
        covariance=correlation * np.outer(sd, sd),
    )
