"""The page's tabs, in order. A new one costs its module and one line here."""

from __future__ import annotations

from benchtool.web.bench import tab as bench_tab
from benchtool.web.explains import tab as explain_tab
from benchtool.web.fits import tab as fit_tab
from benchtool.web.runs import tab as runs_tab
from benchtool.web.simulate import tab as simulate_tab
from benchtool.web.sweep import tab as sweep_tab
from benchtool.web.tab import Tab

TABS: tuple[Tab, ...] = (
    bench_tab.TAB,
    sweep_tab.TAB,
    runs_tab.TAB,
    fit_tab.TAB,
    simulate_tab.TAB,
    explain_tab.TAB,
)
