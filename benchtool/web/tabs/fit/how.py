"""How a fit is made, on the page: estimators, basis, noise, and what is seldom changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, get_args

from nicegui import ui

from benchtool.fit.recipe import Basis, FitInputs, Noise
from benchtool.web.form import InputForm

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
        self._form = InputForm(FitInputs, changed)
        with ui.row().classes("items-center w-full gap-4"):
            self._squares = ui.checkbox("least squares", value=True, on_change=changed)
            self._squares.mark("least squares")
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=changed).mark("emcee")
        with ui.element("div").classes("field-grid"):
            self._form.add("basis", options=BASES)
            self._form.add("noise", options=NOISES)
        more = ui.expansion("More options").classes("w-full")
        with more, ui.element("div").classes("field-grid"):
            self._form.add("compare", options=models)
            self._form.add("loss", options=LOSSES)
            self._form.add("min_z_over_r", "walkers", "max_steps", "seed", "where", "profile")

    def options(self) -> dict[str, Any]:
        """Return what is typed or chosen, by the names of the inputs."""
        methods = {"least_squares": self._squares.value, "emcee": self._emcee.value}
        given = self._form.given()
        where = [part.strip() for part in (given["where"] or "").split(";") if part.strip()]
        chosen = [method for method, wanted in methods.items() if wanted]
        return {**given, "method": chosen, "where": where}
