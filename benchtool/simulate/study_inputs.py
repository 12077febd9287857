"""Inputs common to all closed-loop simulations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

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
