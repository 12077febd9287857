"""Tables for people: recordings as pandas data frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchtool.core.recording import Recording
from benchtool.data.columns import WORDS

if TYPE_CHECKING:
    import pandas as pd


def frame(recording: Recording) -> pd.DataFrame:
    """Return a recording as a data frame, words in place of their codes, units in `attrs`."""
    import pandas as pd

    table = pd.DataFrame(recording.values, columns=list(recording.names))
    for name, words in WORDS.items():
        if name in table:
            codes = table[name].to_numpy().astype(int)
            table[name] = pd.Categorical.from_codes(codes, categories=pd.Index(words))
    table.attrs["units"] = {channel.name: channel.unit for channel in recording.channels}
    table.attrs["provenance"] = dict(recording.provenance)
    return table
