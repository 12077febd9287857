"""The page's tabs, in order. A new one costs its module and one line here."""

from __future__ import annotations

from benchtool.web.tab import Tab

TABS: tuple[Tab, ...] = (
    Tab(name="Bench", icon="speed", module="benchtool.web.bench.tab"),
    Tab(name="Sweep", icon="stacked_line_chart", module="benchtool.web.sweep.tab"),
    Tab(name="Runs", icon="folder_open", module="benchtool.web.runs.tab"),
    Tab(name="Fit", icon="functions", module="benchtool.web.fits.tab"),
    Tab(name="Simulate", icon="flight_takeoff", module="benchtool.web.simulate.tab"),
    Tab(name="Explain", icon="troubleshoot", module="benchtool.web.explains.tab"),
)
