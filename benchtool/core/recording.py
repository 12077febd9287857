"""Recording: n rows by c channels, with provenance."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.core.units import Array, to_si

_ROTOR = re.compile(r"(?:rpm|pwm)(\d+)(?:_us)?")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Table of channels with units and provenance.

    Attributes:
        channels: (c,) of the columns.
        values: (n, c) float64 in each channel's unit; nan where a channel had no new value.
        provenance: metadata of the source, as text (device, file, hash, repairs, simulated).
        simulated: True for simulated data; figures and tables are marked.
    """

    channels: tuple[Channel, ...]
    values: Array
    provenance: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.channels):
            raise InputError(
                f"a recording of {len(self.channels)} channels needs a table of that many columns, "
                f"but its values have shape {self.values.shape}"
            )
        names = [channel.name for channel in self.channels]
        if len(set(names)) < len(names):
            twice = min(name for name, count in Counter(names).items() if count > 1)
            raise InputError(f"duplicate channel {twice!r} in a recording; rename one")

    def __len__(self) -> int:
        return int(self.values.shape[0])

    @property
    def names(self) -> tuple[str, ...]:
        """The channel names in column order."""
        return tuple(channel.name for channel in self.channels)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def index(self, name: str) -> int:
        """Return the column index of a channel; raise UnknownChoice if there is none."""
        try:
            return self.names.index(name)
        except ValueError:
            raise UnknownChoice("channel", name, self.names) from None

    def column(self, name: str) -> Array:
        """Return one channel (n,) in its stored unit."""
        return self.values[:, self.index(name)]

    def to_si(self, name: str) -> Array:
        """Return one channel (n,) in SI units."""
        index = self.index(name)
        return to_si(self.values[:, index], self.channels[index].unit)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Recording:
        """Return the recording of only those rows."""
        return replace(self, values=self.values[rows])

    def with_column(self, channel: Channel, values: Array) -> Recording:
        """Return the recording with one more column (n,)."""
        return replace(
            self,
            channels=(*self.channels, channel),
            values=np.column_stack([self.values, np.asarray(values, float)]),
        )

    def drop(self, names: Collection[str]) -> Recording:
        """Return the recording without these channels; names that it lacks are ignored."""
        columns = [index for index, name in enumerate(self.names) if name not in names]
        channels = tuple(self.channels[index] for index in columns)
        return replace(self, channels=channels, values=self.values[:, columns])

    @classmethod
    def from_columns(
        cls,
        columns: Sequence[tuple[Channel, Array]],
        provenance: Mapping[str, str] | None = None,
        simulated: bool = False,
    ) -> Recording:
        """Build a recording from (channel, values (n,)) pairs."""
        if not columns:
            raise InputError("a recording needs at least one channel")
        values = np.column_stack([np.asarray(column, float) for _, column in columns])
        channels = tuple(channel for channel, _ in columns)
        return cls(channels, values, dict(provenance or {}), simulated)


def check_rotor_count(recording: Recording, rig: Rig, name: str, *, lacking: bool = False) -> None:
    """Raise InputError for more active rotors than in the rig, or fewer with `lacking`.

    A rotor is active if its pulse or speed changes; a constant channel may be unconnected.
    """
    count, rig_count = 0, len(rig.rotors)
    for channel_name in recording.names:
        if number := _ROTOR.fullmatch(channel_name):
            values = recording.column(channel_name)
            finite = values[np.isfinite(values)]
            if len(finite) and np.ptp(finite) > 0.0:
                count = max(count, int(number[1]))
    if count > rig_count or (lacking and 0 < count < rig_count):
        raise InputError(
            f"{name} has pulses or speeds of {pluralize(count, 'rotor')}, and the model "
            f"{rig_count} (rig {rig.name!r}); name the model of this bench with --model, or map "
            f"the rotors' columns in its [columns]"
        )
