"""Inputs of `sweep`, `record` and `calibrate`, and the rig and plate stage of a bench."""

from __future__ import annotations

import getpass
from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, radians, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Gt, Le

from benchtool.acquire.plan import Plan
from benchtool.core.air import Air
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from benchtool.bench.drivers import GrblAddress
    from benchtool.bench.guard import GuardedBench
    from benchtool.bench.stage.stage import PlateStage
    from benchtool.core.rig import Rig

GRAVITY_M_S2 = 9.81  # as in the simulated pitch bench


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepInputs(Inputs):
    """Inputs of `benchtool sweep`."""

    address: Annotated[
        str, Input("Bench: sim:pquad, serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")
    ] = ""
    plan_file: Annotated[
        Path | None, Input("Plan file (TOML), or steps, ramp, response, endurance.", option="plan")
    ] = None
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    plan: Plan = field(default_factory=Plan)
    runs: Annotated[Path, Input("Parent folder of the runs.", group="Run folder")] = Path("runs")
    out: Annotated[Path | None, Input("New run folder.")] = None
    operator: Annotated[str, Input("Operator.", default_text="user name")] = ""
    air: Air = field(default_factory=Air)
    calibration: Annotated[
        str | None,
        Input(
            "Calibration file, or none.",
            label="Calibration (ID or none)",
            default_text="latest of the device",
            group="Bench",
        ),
    ] = None
    stage: Annotated[
        str | None,
        Input(
            "Plate stage: device, hand, grbl:PORT?..., none.",
            label="Plate moved by (device, hand, grbl:PORT)",
            default_text="from device or rig",
        ),
    ] = None
    yes: Annotated[
        bool, Input("Skip arming confirmation: simulated or checked today.", group="This run")
    ] = False
    dry_run: Annotated[bool, Input("Print plan and duration only.")] = False
    resume: Annotated[Path | None, Input("Run folder to resume.")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordInputs(Inputs):
    """Inputs of `benchtool record`."""

    address: Annotated[
        str, Input("Bench: sim:pquad?mode=pitch, serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")
    ]
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    seconds: Annotated[
        float, Gt(0.0), Le(3600.0), Input("Duration in bench time.", "s", label="Duration, s")
    ] = 40.0
    collective: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Collective pulse width.", "us", default_text="hover", label="Collective, us"),
    ] = None
    plate_z_m: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Plate distance.", "m", label="Plate distance, m", default_text="unchanged"),
    ] = None
    limit_deg: Annotated[
        float,
        Gt(0.0),
        Le(90.0),
        Input("Pitch angle limit; stops the motors.", "deg", label="Stop beyond, deg"),
    ] = 45.0
    schedule: Annotated[
        str, Input("Schedule of the device, for the metadata.", default_text="as reported")
    ] = ""
    name: Annotated[str, Input("Name of the run.", label="Name of the run", group="Run folder")] = (
        "pitch"
    )
    runs: Annotated[Path, Input("Parent folder of the runs.")] = Path("runs")
    out: Annotated[Path | None, Input("New run folder.")] = None
    operator: Annotated[str, Input("Operator.", default_text="user name")] = ""
    yes: Annotated[
        bool, Input("Skip arming confirmation: simulated or checked today.", group="This run")
    ] = False
    dry_run: Annotated[bool, Input("Print the experiment only; no motor turns.")] = False

    @property
    def pitch_limit_rad(self) -> float:
        """Pitch angle that stops the motors."""
        return radians(self.limit_deg)

    def collective_us(self, rig: Rig) -> float:
        """Return the pulse of every motor that arms the device; its control loop adds to it."""
        return hover_pulse_us(rig) if self.collective is None else self.collective

    def plan_text(self, rig: Rig) -> str:
        """Return the text of plan.toml."""
        lines = [
            "[record]",
            f"seconds = {self.seconds!r}",
            f"collective_us = {self.collective_us(rig)!r}",
            f"pitch_limit_deg = {degrees(self.pitch_limit_rad)!r}",
        ]
        if self.plate_z_m is not None:
            lines.append(f"plate_z_m = {self.plate_z_m!r}")
        if self.schedule:
            lines.append("schedule = '" + self.schedule.replace("'", "") + "'")
        return "\n".join(lines) + "\n"


def hover_pulse_us(rig: Rig) -> float:
    """Return the hover pulse out of ground effect, rounded: us."""
    p = rig.propulsion
    thrust_N = rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
    speed_rad_s = sqrt(thrust_N / p.thrust_coefficient_N_s2)
    return float(round(p.pwm_start_us + speed_rad_s / p.speed_per_us_rad_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class MassUncertainty(Inputs):
    """Standard uncertainties of masses, gravity and lever ratio."""

    mass_u_kg: Annotated[
        float,
        Ge(0.0),
        Le(1.0),
        Input(
            "Standard uncertainty of each mass.", "kg", option="mass-u", label="Each mass +-, kg"
        ),
    ] = 0.0
    mass_scale_u: Annotated[
        float,
        Ge(0.0),
        Le(0.1),
        Input(
            "Relative standard uncertainty common to all masses.", label="All masses +-, relative"
        ),
    ] = 0.0
    gravity_u_m_s2: Annotated[
        float,
        Ge(0.0),
        Le(0.1),
        Input(
            "Standard uncertainty of the local gravity.",
            "m/s2",
            option="gravity-u",
            label="Gravity +-, m/s2",
        ),
    ] = 0.0
    lever_u: Annotated[
        float,
        Ge(0.0),
        Le(10.0),
        Input("Standard uncertainty of the lever ratio.", label="Lever +-"),
    ] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighingInputs(Inputs):
    """Inputs for calibration masses on a load cell."""

    TITLE = "Masses"

    lever_ratio: Annotated[
        float,
        Ge(0.01),
        Le(100.0),
        Input("Force on load cell / force at rotor.", label="Lever ratio"),
    ] = 1.0
    gravity: Annotated[
        float, Ge(9.76), Le(9.84), Input("Local gravity.", "m/s2", label="Gravity, m/s2")
    ] = 9.80665
    uncertainty: MassUncertainty = field(default_factory=MassUncertainty)
    operator: Annotated[str, Input("Operator.", label="Operator", default_text="user name")] = ""
    certificate: Annotated[
        str, Input("Calibration certificate of the masses.", label="Certificate")
    ] = ""


BENCH_KEYS: tuple[str, ...] = (  # limits that a rig must state before its motors turn
    "limits.load_cell_rating_N",
    *(f"propulsion.pwm_{name}_us" for name in ("stop", "start", "max")),
)


def resolve_rig(address: str, name: str | None) -> Rig:
    """Return the named rig, or that of a `sim:` address.

    Raises:
        InputError: no rig given, or one without required values (`BENCH_KEYS`).
    """
    from benchtool.bench.drivers import SimAddress, parse_address
    from benchtool.core.rig_file import load_rig_by_name, require_values, rig_names

    parsed = parse_address(address)
    if isinstance(parsed, SimAddress):
        return load_rig_by_name(name or parsed.rig)
    if name:
        rig = load_rig_by_name(name)
        require_values(rig, BENCH_KEYS, "a bench")
        return rig
    raise InputError(
        f"no rig for {address}; name it with --rig: {', '.join(rig_names())}, or a rig file"
    )


def check_stage(option: str | None, *, plate: bool) -> GrblAddress | str:
    """Return the parsed `--stage`; raise InputError before a bench is opened."""
    from benchtool.bench.drivers import parse_stage

    if option == "none" and plate:
        raise InputError(
            "--stage none cannot move the plate, but the plan has plate distances; use "
            "--stage hand, --stage grbl:PORT, or a plan without a plate (--plan steps)"
        )
    return parse_stage(option or "device")


def select_stage(
    option: str | None, bench: GuardedBench, rig: Rig, ask: Callable[[str], str], *, plate: bool
) -> PlateStage:
    """Return the plate stage, not yet open.

    Args:
        option: `device`, `hand`, `none` (plan without a plate), or
            `grbl:PORT?axis=Z&zero_mm=1500&direction=1`; default: from device and rig.
        plate: whether the plan has plate distances; if not, only the device can move the plate.
    """
    from benchtool.bench.stage.stage import DeviceStage, HandStage, PlateStage

    default = rig.plate.moved_by if plate else "none"
    name = option or ("device" if bench.identity.moves_plate else default)
    stage = check_stage(name, plate=plate)
    if name == "none":
        return PlateStage()
    if name == "device":
        if not bench.identity.moves_plate:
            raise InputError(
                "this device does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        return DeviceStage(bench, rig.plate)
    if bench.identity.moves_plate:
        raise InputError(
            f"{bench.identity.address} moves the plate, so a second stage is not possible; omit "
            f"--stage {name.partition('?')[0]}"
        )
    if isinstance(stage, str):
        return HandStage(ask, rig.plate, bench)
    from benchtool.bench.stage.grbl import GrblStage
    from benchtool.bench.transport.ports import SerialPort

    def discard_samples(duration_s: float) -> None:
        bench.read(duration_s)

    port = SerialPort(stage.port, stage.baud)
    return GrblStage(port, stage, rig.plate, bench, discard_samples)


def user_name() -> str:
    """Return the name of the logged-in user."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "unknown"
