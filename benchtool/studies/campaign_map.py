"""From a campaign's table to its map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchtool.studies.campaign import Vary

if TYPE_CHECKING:
    from benchtool.report.files import Figure


def campaign_map(table: Path, varied: Sequence[Vary], measure: str = "rms_deg") -> Figure:
    """Draw a measure over the first two varied numbers, one panel per controller."""
    from benchtool.report.campaign import CampaignPanel, campaign_figure
    from benchtool.store.campaign import read_campaign

    names = [each.name for each in varied][:2]
    columns = read_campaign(table, [*names, "controller", measure])
    controllers = list(dict.fromkeys(columns["controller"].tolist()))
    panels = []
    for controller in controllers:
        own = columns["controller"] == controller
        panels.append(
            CampaignPanel(
                label=controller,
                x=columns[names[0]][own].astype(float),
                y=columns[names[1]][own].astype(float) if len(names) == 2 else None,
                measure=np.asarray(columns[measure][own], float),
            )
        )
    return campaign_figure(
        panels, names, "RMS error of pitch [deg]", title="RMS error of pitch, mean over seeds"
    )
