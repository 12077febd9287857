"""How a fit is made, on the page: estimators, basis, noise, and what is seldom changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, get_args

from nicegui import ui

from benchtool.fit.recipe import Basis, Noise, Recipe

BASES = {
    "joint": "thrust itself (joint fit)",
    "equal_rpm2": "T_IGE/T_OGE at equal rpm²",
    "equal_pwm": "T_IGE/T_OGE at equal pulse width",
    "equal_power": "T_IGE/T_OGE at equal electrical power",
}
NOISES = {
    "auto": "auto: scaled in a run, stated in a table",
    "stated": "the errors as they are stated",
    "scale": "one factor on the errors",
    "add": "scatter added to the errors",
}
LOSSES = {
    "linear": "linear",
    "soft_l1": "soft_l1: distant points count less",
    "huber": "huber: distant points count less",
}

assert tuple(BASES) == get_args(Basis)
assert tuple(NOISES) == get_args(Noise)


class MethodCard:
    """Ask how to fit.

    Args:
        models: to compare with, name to words.
        changed: called after every change.
    """

    def __init__(self, models: Mapping[str, str], changed: Callable[[], None]) -> None:
        usual = Recipe(name="usual", data=("none",), model="none")
        with ui.row().classes("items-center w-full gap-4"):
            self._squares = ui.checkbox("least squares", value=True, on_change=changed)
            self._squares.mark("least squares")
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=changed).mark("emcee")
        with ui.row().classes("w-full gap-4"):
            self._basis = ui.select(BASES, value=usual.basis, label="What is fitted")
            self._noise = ui.select(NOISES, value=usual.noise, label="Errors")
            for chosen in (self._basis, self._noise):
                chosen.on_value_change(changed)
                chosen.classes("grow")
        with ui.expansion("More options").classes("w-full"):
            with ui.row().classes("items-end w-full gap-4"):
                self._compare = ui.select(
                    dict(models), multiple=True, label="Hold against models", on_change=changed
                )
                self._compare.props("use-chips").classes("grow")
                self._loss = ui.select(
                    LOSSES, value=usual.loss, label="Loss", on_change=changed
                ).classes("w-56")
            with ui.row().classes("items-end w-full gap-4"):
                self._nearest = _number("Nearest z/R", usual.min_z_over_R, changed)
                self._walkers = _number("Walkers of emcee", usual.walkers, changed)
                self._steps = _number("Most steps of emcee", usual.max_steps, changed)
                self._seed = _number("Seed", usual.seed, changed)
            with ui.row().classes("items-end w-full gap-4"):
                self._where = ui.input(
                    "Only rows with COLUMN=VALUE (several: split by ;)", on_change=changed
                ).classes("grow")
                self._profile = ui.checkbox("profile-likelihood intervals", on_change=changed)

    @property
    def profile(self) -> bool:
        """Whether intervals are wanted from the profile likelihood as well."""
        return bool(self._profile.value)

    def options(self) -> dict[str, Any]:
        """Return what is asked, by the recipe's keys."""
        chosen = {"least_squares": self._squares.value, "emcee": self._emcee.value}
        return {
            "method": [method for method, wanted in chosen.items() if wanted],
            "basis": self._basis.value,
            "noise": self._noise.value,
            "loss": self._loss.value,
            "compare": list(self._compare.value or []),
            "min_z_over_r": self._nearest.value,
            "walkers": _whole(self._walkers.value),
            "max_steps": _whole(self._steps.value),
            "seed": _whole(self._seed.value),
            "where": [
                part.strip() for part in (self._where.value or "").split(";") if part.strip()
            ],
        }


def _number(label: str, value: float, changed: Callable[[], None]) -> ui.number:
    return ui.number(label, value=value, on_change=changed, min=0).classes("w-40")


def _whole(value: float | None) -> int | float | None:
    return int(value) if value is not None and value == int(value) else value
