"""Scores of ground-effect laws over plate distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchtool.physics.catalogue import EFFECTS

Verdict = Literal["best", "indistinguishable", "behind", "refused", "not applied"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LawScore:
    """Score of one law; numbers are nan if it was not fitted."""

    law: str  # name of its effect
    verdict: Verdict
    reason: str = ""  # reason of a verdict "refused" or "not applied"
    one_with: tuple[str, ...] = ()  # equivalent laws (other parameters)
    parameters: int = 0  # number of free parameters, with k and noise
    values: str = ""  # fitted parameters as text
    chi2_per_dof: float = np.nan  # of the fit to all distances
    behind: float = np.nan  # mean loss of log score per distance against the best
    behind_se: float = np.nan  # its standard error, corrected for overlapping folds
    losses: tuple[float, ...] = ()  # of log score at each distance against the best
    held_out_rms: float = np.nan  # of held-out residuals, in the unit of the observations


@dataclass(frozen=True, slots=True, kw_only=True)
class LawComparison:
    """Scores of all laws, best first, and the compared distances."""

    scores: tuple[LawScore, ...]
    distances: tuple[float, ...]  # z/R, increasing

    def find_laws(self, *verdicts: Verdict) -> list[str]:
        """Return the names of the laws with one of these verdicts."""
        return [score.law for score in self.scores if score.verdict in verdicts]

    @property
    def sentence(self) -> str:
        """Return one sentence: best law, rejected laws, indistinguishable laws."""
        near, far = self.distances[0], self.distances[-1]
        where = f"At these {len(self.distances)} distances (z/R {near:.3g} to {far:.3g})"
        leading = self.find_laws("best", "indistinguishable")
        if not leading:
            nearest = self.scores[0].law
            return f"{where} the bench follows none of the laws: {nearest} comes nearest"
        best, *others = leading
        if others:
            summary = f"{best} predicts best; {_listed(others)} cannot be distinguished from it"
        elif best in TABLES:
            summary = f"the bench follows no law with a formula; {best} describes it"
        else:
            summary = f"the bench follows {best}"
        verdicts: tuple[Verdict, ...] = ("behind", "refused", "not applied")
        groups = {verdict: self.find_laws(verdict) for verdict in verdicts}
        parts = [f"{verdict}: {_listed(laws)}" for verdict, laws in groups.items() if laws]
        return "; ".join([f"{where} {summary}", *parts])


TABLES = {name for name, effect in EFFECTS.items() if effect.knots_setting}  # tabulated laws


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + (" and " if names[:-1] else "") + names[-1]
