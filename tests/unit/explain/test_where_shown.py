"""Where a disagreement shows: the regime in words."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.engine.describe import where_shown
from benchtool.explain.engine.subject import EARLY, LATE, RowGroups

N = 900
TIME = np.arange(N)


@pytest.mark.parametrize(
    ("gained", "regime"),
    [
        (TIME >= 600, "high collective"),  # both begin together: the collective says more
        ((TIME >= 600) & (TIME < 700), "high collective"),
        (TIME >= 750, LATE),  # the high collective ends before it is worst
        (TIME < 300, EARLY),
    ],
)
def test_the_clock_is_named_only_where_nothing_else_fits_about_as_well(gained, regime):
    groups = RowGroups(
        stages={"hinge": np.ones(N, bool)},
        regimes={
            LATE: TIME >= 600,
            EARLY: TIME < 300,
            "high collective": (TIME >= 590) & (TIME < 790),
            "plate in": TIME % 2 == 0,
        },
    )
    before = np.where(gained, 3.0, 1.0)
    found = where_shown(groups, before, np.ones(N), "hinge")
    assert found is not None
    assert (found.stage, found.regime) == ("hinge", regime)
