"""What a comparison of laws of thrust against distance found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchtool.physics.catalogue import EFFECTS

Verdict = Literal["best", "indistinguishable", "behind", "refused", "not applied"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LawScore:
    """Hold how one law did; numbers are nan where it was not fitted."""

    law: str  # name of its effect
    verdict: Verdict
    reason: str = ""  # why it was refused or not applied
    one_with: tuple[str, ...] = ()  # laws that it is by another parameter
    parameters: int = 0  # how many are free, with k and noise
    values: str = ""  # its fitted numbers, in words
    chi2_per_dof: float = np.nan  # of the fit to all distances
    behind: float = np.nan  # mean loss of log score per distance against the best
    behind_se: float = np.nan  # its standard error, overlap of the folds counted
    losses: tuple[float, ...] = ()  # of log score at each distance against the best
    held_out_rms: float = np.nan  # of held-out residuals, in the unit of what was observed


@dataclass(frozen=True, slots=True, kw_only=True)
class LawComparison:
    """Hold all laws, the best first, and the distances they were compared on."""

    scores: tuple[LawScore, ...]
    distances: tuple[float, ...]  # z/R, increasing

    def named(self, *verdicts: Verdict) -> list[str]:
        """Return the laws that fared so."""
        return [score.law for score in self.scores if score.verdict in verdicts]

    @property
    def sentence(self) -> str:
        """Say which law the bench follows, which are refused and which are indistinguishable."""
        near, far = self.distances[0], self.distances[-1]
        where = f"At these {len(self.distances)} distances (z/R {near:.3g} to {far:.3g})"
        leading = self.named("best", "indistinguishable")
        if not leading:
            nearest = self.scores[0].law
            return f"{where} the bench follows none of the laws: {nearest} comes nearest"
        best, *others = leading
        if others:
            said = f"{best} predicts best; {_listed(others)} cannot be distinguished from it"
        elif best in TABLES:
            said = f"the bench follows no law with a formula; {best} describes it"
        else:
            said = f"the bench follows {best}"
        counts: tuple[Verdict, ...] = ("behind", "refused", "not applied")
        rest = [f"{each}: {_listed(found)}" for each in counts if (found := self.named(each))]
        return "; ".join([f"{where} {said}", *rest])


# Tables through the data.
TABLES = {name for name, effect in EFFECTS.items() if effect.knots_setting}


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + (" and " if names[:-1] else "") + names[-1]
