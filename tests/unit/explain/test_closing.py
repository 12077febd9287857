"""An effect stays beside another only where it closes a part of the gap of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.search import Search, closing, searched
from benchtool.explain.engine.subject import ChannelErrors, Subject
from tests.unit.explain.linear_made import Linear, quiet

Array = np.ndarray
BOTH = np.array([4.0, 5.0, 0.0, 0.0])


@dataclass
class Checked:
    """Tells the errors on other data, in blocks of 20 rows."""

    check: Linear

    def errors(self, sets: Array) -> dict[str, ChannelErrors]:
        """Return mean squares of each block."""
        rows = self.check.residuals(sets)
        squares = np.mean(rows.reshape(20, 20, -1) ** 2, axis=1)
        return {"x": ChannelErrors(unit="1", squares=squares)}


def closed(true_of_check: Array) -> Search:
    hypotheses = Hypotheses(Linear(BOTH, 3))
    search = searched(hypotheses, quiet)
    assert set(search.best.opened) == {"a", "b"}
    subject = cast("Subject", Checked(Linear(true_of_check, 4)))
    return closing(subject, hypotheses, search)


def test_two_that_both_predict_stay() -> None:
    found = closed(BOTH)
    assert set(found.best.opened) == {"a", "b"}
    assert len(found.trials) == 2


def test_one_that_predicts_nothing_goes() -> None:
    found = closed(np.array([0.0, 5.0, 0.0, 0.0]))
    assert found.best.opened == ("b",)
    assert [trial.name for trial in found.trials] == ["b"]
