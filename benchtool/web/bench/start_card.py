"""What to do first, where no bench is connected."""

from __future__ import annotations

from nicegui import ui

STEPS = (
    "**Without hardware**: press *Connect*. `sim:pquad` is a simulated quadrotor over a plate; no "
    "motor turns, and its clock can run up to 100 times faster.",
    "**With a bench on a cable**: press *Find*, choose its port, name its rig, then *Connect*. "
    "Motors stay at zero until you type ARM.",
    "**Then**: *Sweep* measures thrust over plate distance and throttle, *Fit* estimates K_b and "
    "the effective radius from it. *Simulate* and *Explain* need no bench.",
)


class StartCard:
    """Say how to begin."""

    def __init__(self) -> None:
        with ui.card().classes("w-full") as self._card:
            ui.label("No bench is connected").classes("card-title").props(
                "role=heading aria-level=2"
            )
            ui.markdown("\n".join(f"1. {step}" for step in STEPS)).classes("steps")

    def set_visibility(self, visible: bool) -> None:
        """Show it or not."""
        self._card.set_visibility(visible)
