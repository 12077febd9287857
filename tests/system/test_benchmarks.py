"""Every benchmark runs, in its short form."""

from __future__ import annotations

from math import isfinite

import pytest

from tests.browser.conftest import CHROMIUM
from tests.proof.benchmarks.table import NAMES, measure

pytestmark = pytest.mark.timeout(600)


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_yields_finite_figures(name):
    if name in ("hold", "web") and CHROMIUM is None:
        pytest.skip("no browser is installed; on Debian or Ubuntu: apt install chromium")
    rows, error = measure(name, quick=True)
    assert error == ""
    assert rows
    figures = [
        figure
        for row in rows
        for figure in (row.ours, row.peer, row.memory_MB)
        if figure is not None
    ]
    assert all(isfinite(figure) and figure > 0.0 for figure in figures), rows
