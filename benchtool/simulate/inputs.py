"""Inputs of closed-loop simulations, and what the set-ups of hinged and free bodies share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le, Len

from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs, items, with_changes
from benchtool.tasks import Cluster

MAX_DURATION_S = 3600.0  # per simulation; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignInputs(Inputs):
    """Inputs of a campaign."""

    TITLE = "Campaign"

    vary: Annotated[
        tuple[str, ...], Input("NAME=FROM:TO:COUNT: a campaign over a grid; needs --out.")
    ] = ()
    seeds: Annotated[int, Ge(1), Input("Seeds per point of a campaign.")] = 1
    samples: Annotated[int, Ge(0), Input("Random points instead of the grid.")] = 0
    measure: Annotated[str, Input("Measure whose mean is printed; default: the main one.")] = ""
    cluster: Cluster = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyInputs(Inputs):
    """Inputs common to all closed-loop simulations."""

    gains: Annotated[
        tuple[str, ...],
        Len(1),
        Input(
            "Gain set (s3, s1a, stiff) or its file; several in a campaign.",
            label="Gains",
            comma_separated=True,
        ),
    ] = ("s3",)
    duration_s: Annotated[
        Annotated[float, Gt(0.0), Le(MAX_DURATION_S)] | None,
        Input("Duration.", "s", default_text="of the schedule or flight"),
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of the noise.")] = 1
    settings: Annotated[
        Mapping[str, float],
        Input(
            "NAME=VALUE, such as gains.attitude=1.2 (a factor) or gains.attitude.k_q_per_s=8.",
            label="Numbers, as gains.attitude=1.2",
            option="set",
        ),
    ] = field(default_factory=dict)
    campaign: CampaignInputs = CampaignInputs()
    out: Annotated[
        Path | None,
        Input(
            "Folder for recordings, table and figure.", label="Name of the folder", group="Results"
        ),
    ] = None

    def gain_set(self) -> str:
        if len(self.gains) > 1:
            raise InputError(
                f"{len(self.gains)} gain sets ({', '.join(self.gains)}) need a campaign; add "
                f"--vary or name one gain set"
            )
        return self.gains[0]

    def check_no_campaign(self) -> None:
        if campaign_values := with_changes(self.campaign):
            option = next(
                item.option for item in items(CampaignInputs) if item.name in campaign_values
            )
            raise InputError(
                f"{option} needs a campaign; add --vary NAME=FROM:TO:COUNT or remove {option}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchInputs(Inputs):
    """Inputs of `benchtool simulate pitch`."""

    rig: Annotated[
        str | None, Input("Rig on the hinge.", default_text="of the model; pquad without a model")
    ] = None
    model: Annotated[str, Input("Model or its file.", default_text="pitch model of the rig")] = ""
    controllers: Annotated[
        tuple[str, ...],
        Len(1),
        Input(
            "Comma-separated; user-defined: module:Class.",
            comma_separated=True,
            alias="--controller",
            label="Controllers",
        ),
    ] = ("pid", "feedforward", "observer")
    schedule: Annotated[str, Input("Schedule, or its file.")] = "plate"
    study: StudyInputs = field(default_factory=StudyInputs)


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


Row = Mapping[str, float | str]
Point = Mapping[str, float]

CONTROL_HZ = (1.0, 1e5)  # range of control rates: up to 1000 times that of an autopilot; assumed


class Setup(ABC):
    """Set-up of a simulation by names and numbers."""

    measures: ClassVar[Mapping[str, str]]  # label with unit by column; the main measure first

    @property
    @abstractmethod
    def campaign_title(self) -> str:
        """Title of a campaign."""

    @abstractmethod
    def to_metadata(self) -> dict[str, str]:
        """Return the settings as text by name."""

    @abstractmethod
    def with_number(self, name: str, value: float) -> Self:
        """Return the set-up with one number changed, by name."""

    def with_changes(self, values: Mapping[str, float]) -> Self:
        """Return the set-up with some numbers changed, by name."""
        setup = self
        for name, value in values.items():
            setup = setup.with_number(name, float(value))
        return setup

    @abstractmethod
    def check_point(self, point: Point, varied: Sequence[str], seeds: int, controller: str) -> None:
        """Raise for a point of a campaign that cannot be run."""

    @abstractmethod
    def build_run(self, controller: str, point: Point) -> Any:
        """Return a run at a point, for `measure_runs` with any seed."""

    @staticmethod
    @abstractmethod
    def measure_runs(
        runs: Iterator[tuple[Any, int]], seed: int, threads: int | None
    ) -> Iterator[Row]:
        """Yield the measures of pairs of run and seed number, counted from `seed`, in order."""


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError if a number is outside its range or NaN."""
    if not low <= value <= high:
        raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g}")
