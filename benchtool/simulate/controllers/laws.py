"""Built-in control laws, and the built-in controllers by name."""

from __future__ import annotations

from benchtool.core.errors import UnknownChoice
from benchtool.simulate.controllers import flight_law, pitch
from benchtool.simulate.controllers.controller import ControlLaw
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.gain_file import Gains

LAWS: tuple[ControlLaw, ...] = (pitch.LAW, flight_law.LAW)  # built-in laws; add a new one here

_HINGED, _FREE = (
    {law.name: law.title for law in LAWS if law.body == body and law.name != "pid"}
    for body in ("hinged", "free")
)
PITCH_CONTROLLERS = {  # built-in controllers of the pitch bench with their titles
    "pid": pitch.LAW.title,
    "observer": "PID with the disturbance observer of eq. (12)",
    "feedforward": "PID with each rotor's thrust divided by the expected factor",
    "observer+feedforward": "PID with both",
    **_HINGED,
    **{f"{name}+feedforward": f"{title}; with the feedforward" for name, title in _HINGED.items()},
}

FLIGHT_CONTROLLERS = {  # built-in controllers of a flight with their labels in figures
    "pid": flight_law.LAW.title,
    "observer": "PID + observer",
    "feedforward": "PID + feedforward",
    "both": "PID + observer + feedforward",
    **_FREE,
    **{f"{name}+feedforward": f"{title} + feedforward" for name, title in _FREE.items()},
}


def find_law(controller: str, body: str) -> ControlLaw:
    """Return the law of a built-in controller of a body; PID where the name contains no law."""
    body_laws = [law for law in LAWS if law.body == body]
    return next((law for law in body_laws if law.name in controller.split("+")), body_laws[0])


def build_pitch_controller(
    name: str, gains: Gains, feedforward: Feedforward | None = None
) -> PitchControl:
    """Return a built-in controller by name.

    Args:
        feedforward: settings of a feedforward; 90 % of the true effect by default (assumed: a
            model is never exact).
    """
    if name not in PITCH_CONTROLLERS:
        raise UnknownChoice("controller", name, PITCH_CONTROLLERS)
    parts = name.split("+")
    expected_effect = feedforward if feedforward is not None else Feedforward(strength=0.9)
    return PitchControl(
        name=name,
        gains=gains,
        observer="observer" in parts,
        feedforward=expected_effect if "feedforward" in parts else Feedforward(),
        law=find_law(name, "hinged"),
    )
