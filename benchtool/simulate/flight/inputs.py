"""Inputs of a simulated flight, from the command line, the page or Python."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Gt, Le, Len

from benchtool.core.inputs import Input, Inputs
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.simulate.study_inputs import StudyInputs

if TYPE_CHECKING:
    from benchtool.simulate.flight.setup import FlightSetup
    from benchtool.simulate.flight.vehicle import FlightVehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightInputs(Inputs):
    """Inputs of `benchtool simulate flight`."""

    case: Annotated[
        str, Input("Case: over, edge, oblique, corner, gust, ramp or plate.", label="Flight")
    ] = "over"
    rig: Annotated[str, Input("Rig of the vehicle.")] = "pquad"
    model: Annotated[
        str, Input("Model of the ground effect, or its file.", default_text="eq. (4)")
    ] = ""
    controllers: Annotated[
        tuple[str, ...],
        Len(1),
        Input(
            "Some of pid, observer, feedforward, both; user-defined: module:Class; oge (PID out of "
            "ground effect) in a campaign.",
            label="Controllers",
            comma_separated=True,
            alias="--controller",
            default_text="pid,observer,feedforward; oge,pid in a campaign",
        ),
    ] = ()
    z_over_R: Annotated[
        float,
        Gt(0.0),
        Le(1000.0),
        Input("Height over the obstacle in rotor radii.", option="z-over-r"),
    ] = 2.0
    speed_m_s: Annotated[
        Annotated[float, Ge(0.001), Le(50.0)] | None,
        Input("Speed limit.", "m/s", default_text="of the case"),
    ] = None
    ramp: Annotated[bool, Input("Move the reference, without a speed limit.")] = False
    gyro_noise_rad_s: Annotated[
        Annotated[float, Ge(0.0), Le(10.0)] | None,
        Input(
            "Gyro noise, standard deviation.",
            "rad/s",
            default_text="none; with several seeds 0.015 as in the paper",
            group="Disturbances",
        ),
    ] = None
    map_offset_m: Annotated[
        tuple[float, float, float], Input("Offset X,Y,Z of the feedforward's map; -0.05,0,0.", "m")
    ] = (0.0, 0.0, 0.0)
    map: Annotated[
        Path | None, Input("Map (TOML or CSV) instead of the obstacle of the case.", group="Course")
    ] = None
    goal_m: Annotated[
        tuple[float, float] | None, Input("Goal X,Y instead of that of the case.", "m")
    ] = None
    lag_s: Annotated[
        float, Ge(0.0), Le(10.0), Input("Motor time constant.", "s", group="Vehicle")
    ] = 0.0
    layout: Annotated[Literal["plus", "cross"], Input("plus, or cross: rotated by 45 degrees.")] = (
        "plus"
    )
    study: StudyInputs = field(default_factory=StudyInputs)


def build_setup(
    inputs: FlightInputs, gains: str, permit: CodePermit = check_code_allowed
) -> FlightSetup:
    """Return the flight setup of one gain set."""
    from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S
    from benchtool.simulate.flight.map import read_map
    from benchtool.simulate.flight.setup import FlightSetup, with_changes
    from benchtool.simulate.gain_file import load_gains

    noise_rad_s = inputs.gyro_noise_rad_s
    if noise_rad_s is None:
        noise_rad_s = GYRO_NOISE_RAD_S if inputs.study.campaign.seeds > 1 else 0.0
    setup = FlightSetup(
        case=inputs.case,
        vehicle=_vehicle(inputs, permit),
        gains=load_gains(gains),
        z_over_R=inputs.z_over_R,
        speed_m_s=inputs.speed_m_s,
        duration_s=inputs.study.duration_s,
        goal_m=inputs.goal_m,
        below=None if inputs.map is None else read_map(inputs.map),
        ramp=inputs.ramp,
        gyro_noise_rad_s=noise_rad_s,
        map_offset_m=inputs.map_offset_m,
    )
    return with_changes(setup, inputs.study.settings)


def _vehicle(inputs: FlightInputs, permit: CodePermit) -> FlightVehicle:
    from benchtool.core.rig_file import load_rig_by_name
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.flight.vehicle import FlightVehicle

    rig = load_rig_by_name(inputs.rig)
    vehicle = FlightVehicle.of_rig(rig)
    if inputs.model:
        vehicle = FlightVehicle(model=load_model(inputs.model, rig, permit).model)
    turned_deg = 45.0 if inputs.layout == "cross" else 0.0
    if inputs.lag_s or not inputs.model:
        vehicle = vehicle.with_numbers(lag_s=inputs.lag_s)
    return vehicle.with_numbers(turned_deg=turned_deg)
