"""Rest with motors at zero while an ESC cools down or a pack recovers."""

from __future__ import annotations

from math import isnan

from benchtool.acquire.average import average
from benchtool.acquire.motors import Motors
from benchtool.acquire.plan import RestPart
from benchtool.acquire.record import Recorder
from benchtool.core.errors import RunStopped
from benchtool.core.recording import Recording
from benchtool.data.run.points import Point

LOOK_S = 1.0
"""Span over which temperature and voltage are averaged; a choice."""


def rest_if_needed(recorder: Recorder, motors: Motors, plan: RestPart, last: Point | None) -> None:
    """Rest where temperature or voltage of the last point asks for it; look when there is none.

    Raises:
        RunStopped: the rest took longer than the plan allows.
    """
    if plan.above_degC is None and plan.below_V is None:
        return
    if last is None:
        seen = recorder.collect("rest", LOOK_S)
        why = _why(_mean(seen, "temperature_degC"), _mean(seen, "voltage_V"), plan)
    else:
        why = _why(last.temperature_degC, last.voltage_V, plan)
    if not why:
        return
    recorder.note("rest", f"{why}; motors at zero until it has recovered")
    motors.zero()
    begun_s = recorder.now_s
    while not _recovered(recorder.collect("rest", LOOK_S), plan):
        if recorder.now_s - begun_s > plan.longest_s:
            raise RunStopped(
                f"{why} and had not recovered after {plan.longest_s:g} s; cool it or change the "
                f"pack, then go on with benchtool sweep --resume"
            )
    recorder.note("rested", f"went on after {recorder.now_s - begun_s:.0f} s")


def _why(temperature: float, voltage: float, plan: RestPart) -> str:
    if plan.above_degC is not None and temperature > plan.above_degC:
        return f"the ESC reads {temperature:.1f} degC, rest above {plan.above_degC:g} degC"
    if plan.below_V is not None and voltage < plan.below_V:
        return f"the pack reads {voltage:.2f} V, rest below {plan.below_V:g} V"
    return ""


def _recovered(seen: Recording, plan: RestPart) -> bool:
    temperature, voltage = _mean(seen, "temperature_degC"), _mean(seen, "voltage_V")
    cool = plan.above_degC is None or isnan(temperature) or temperature <= plan.until_degC
    until_V = max(plan.until_V, plan.below_V or 0.0)
    charged = plan.below_V is None or isnan(voltage) or voltage >= until_V
    return cool and charged


def _mean(seen: Recording, name: str) -> float:
    return average(seen.column(name)).mean if name in seen else float("nan")
