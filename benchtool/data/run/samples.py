"""samples.csv: every sample of a run, written as it comes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError
from benchtool.core.user_file import open_file
from benchtool.data.columns import SAMPLE_START
from benchtool.data.run.append import AppendFile

Array = NDArray[np.float64]


class SampleWriter:
    """Append samples; a row has reached the operating system when `append` returns.

    Args:
        path: samples.csv of a run; a new file gets its header, an old one must have the same.
        channels: what the device streams, in its order.
    """

    def __init__(self, path: Path, channels: tuple[Channel, ...]) -> None:
        names = [channel.name for channel in channels]
        header = ",".join([*SAMPLE_START, *names]).encode() + b"\n"
        self.file = AppendFile(path)
        if path.stat().st_size == 0:
            self.file.write(header)
            self.file.sync()
            return
        with open_file(path, follow=False) as file:
            if file.readline() != header:
                self.file.close()
                raise FileFormatError(
                    str(path),
                    "this bench streams other channels than the run has on disk; go on with the "
                    "bench that began it, or start a new run",
                )

    @property
    def fragment(self) -> str:
        """The cut line that a killed process left at the end, empty when there was none."""
        return self.file.fragment.decode("utf-8", "replace")

    def append(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples.

        Args:
            point: number of the visit they belong to, 0 for none.
            phase: what the bench was doing, one of `columns.PHASES`.
            time_s: (m,) host time since the run began.
            device_time_us: (m,) the device's own time.
            values: (m, c) in channel order; nan becomes an empty cell.
        """
        middle = f",{point},{phase},"
        lines = [
            "%.6f,%.0f%s%s\n" % (time, device, middle, ",".join(map(repr, row)))  # noqa: UP031
            for time, device, row in zip(
                time_s.tolist(), device_time_us.tolist(), values.tolist(), strict=True
            )
        ]
        self.file.write("".join(lines).replace("nan", "").encode("ascii"))

    def sync(self) -> None:
        """Force what was appended to the disk."""
        self.file.sync()

    def close(self) -> None:
        """Force to the disk and close; safe to call twice."""
        self.file.close()
