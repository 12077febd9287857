"""What `sweep` takes besides its plan and `calibrate` of its masses, and which rig a bench is."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from benchtool.acquire.plan import Plan
from benchtool.core.air import Air
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from benchtool.core.rig import Rig


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepInputs(Inputs):
    """What `benchtool sweep` takes."""

    address: Annotated[
        str, Input("The bench: sim:pquad, serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")
    ] = ""
    plan_file: Annotated[Path | None, Input("Plan file (TOML).", option="plan")] = None
    rig: Annotated[str | None, Input("Rig by name, or a rig file.")] = None
    plan: Plan = field(default_factory=Plan)
    runs: Annotated[Path, Input("Where run folders are made.")] = Path("runs")
    out: Annotated[Path | None, Input("Exactly this run folder; must be new.")] = None
    operator: Annotated[str, Input("Who measures; the user when left out.", label="Operator")] = ""
    air: Air = field(default_factory=Air)
    calibration: Annotated[
        str | None,
        Input(
            "Calibration file; none to use none.",
            label="Calibration (ID or none)",
            empty="the device's latest",
        ),
    ] = None
    stage: Annotated[
        str | None,
        Input(
            "What moves the plate: device, hand, grbl:PORT?...",
            label="Plate moved by (device, hand, grbl:PORT)",
            empty="as device and rig say",
        ),
    ] = None
    yes: Annotated[bool, Input("No typed arming: simulated or checked today.")] = False
    dry_run: Annotated[bool, Input("Show plan and duration only.")] = False
    resume: Annotated[Path | None, Input("Go on with this run folder.")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MassUncertainty(Inputs):
    """State how well masses, gravity and lever are known: standard uncertainties."""

    mass_u_kg: Annotated[
        float,
        Ge(0.0),
        Le(1.0),
        Input("Standard uncertainty of each mass by itself.", "kg", option="mass-u"),
    ] = 0.0
    mass_scale_u: Annotated[
        float,
        Ge(0.0),
        Le(0.1),
        Input("Relative standard uncertainty that all masses share, as of one scale."),
    ] = 0.0
    gravity_u_m_s2: Annotated[
        float,
        Ge(0.0),
        Le(0.1),
        Input("Standard uncertainty of the local gravity.", "m/s2", option="gravity-u"),
    ] = 0.0
    lever_u: Annotated[
        float, Ge(0.0), Le(10.0), Input("Standard uncertainty of the lever ratio.")
    ] = 0.0


def rig_for(address: str, named: str | None) -> Rig:
    """Return the rig on the bench: as named, or the one that a `sim:` address names."""
    from benchtool.bench.drivers import parse_address
    from benchtool.core.rig_file import rig_named, rig_names

    if named:
        return rig_named(named)
    parsed = parse_address(address)
    if parsed.scheme == "sim":
        return rig_named(parsed.place)
    raise InputError(
        f"which rig stands on {address}? name it with --rig: {', '.join(rig_names())}, or the "
        f"path of a rig file"
    )
