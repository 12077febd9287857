"""The Sweep tab: a plan with its preview, start to end, points on the plot as they come."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.context import Context

LOOK_S = 0.5
"""How often points are looked for: the plot changes at most twice a second."""


def build(context: Context) -> None:
    """Make the tab."""
    from benchtool.web.sweep.plan_card import PlanCard
    from benchtool.web.sweep.ratio_card import RatioCard
    from benchtool.web.sweep.run_card import RunCard

    with ui.element("div").classes("grid-main plan-left"):
        with ui.element("div"):
            run = RunCard(context)
            plot = RatioCard(context)
        with ui.element("div"):
            plan = PlanCard(context)

    def refresh() -> None:
        run.refresh()
        plan.refresh()

    ui.timer(LOOK_S, refresh)
    # By itself: the state of a sweep does not wait for its plot.
    ui.timer(LOOK_S, plot.refresh)
