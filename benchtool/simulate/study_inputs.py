"""What every closed-loop simulation takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le, Len

from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs, items, with_changes
from benchtool.tasks import Cluster

LONGEST_S = 3600.0  # longest simulation; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignInputs(Inputs):
    """What makes many runs of one."""

    TITLE = "Campaign"

    vary: Annotated[
        tuple[str, ...], Input("NAME=FROM:TO:COUNT: campaign over a grid; needs --out.")
    ] = ()
    seeds: Annotated[int, Ge(1), Input("Seeds per point of a campaign.")] = 1
    samples: Annotated[int, Ge(0), Input("Random points instead of the grid.")] = 0
    measure: Annotated[str, Input("Measure to print the mean of.", default_text="main measure")] = (
        ""
    )
    cluster: Cluster = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyInputs(Inputs):
    """What every closed-loop simulation takes."""

    gains: Annotated[
        tuple[str, ...],
        Len(1),
        Input(
            "Gain set (s3, s1a, stiff) or file; several in a campaign.",
            label="Gains",
            comma_separated=True,
        ),
    ] = ("s3",)
    duration_s: Annotated[
        Annotated[float, Gt(0.0), Le(LONGEST_S)] | None,
        Input("Duration.", "s", default_text="as in case or schedule"),
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of the noise.")] = 1
    settings: Annotated[
        Mapping[str, float],
        Input(
            "NAME=VALUE, e.g. gains.attitude=1.2 (factor); repeatable.",
            label="Numbers, as gains.attitude=1.2",
            option="set",
        ),
    ] = field(default_factory=dict)
    campaign: CampaignInputs = CampaignInputs()
    out: Annotated[
        Path | None,
        Input(
            "Folder for recordings, table and figure.",
            label="Name of the folder",
            group="Results",
        ),
    ] = None

    def gain_set(self) -> str:
        if len(self.gains) > 1:
            raise InputError(
                f"{len(self.gains)} gain sets ({', '.join(self.gains)}) are for a campaign; add "
                f"--vary, or name one"
            )
        return self.gains[0]

    def refuse_campaign(self) -> None:
        if given := with_changes(self.campaign):
            option = next(item.option for item in items(CampaignInputs) if item.name in given)
            raise InputError(
                f"{option} is for a campaign; add --vary NAME=FROM:TO:COUNT or leave it out"
            )
