"""An answer: an explanation with what it was made from, as files and pages show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import NamedTuple

from benchtool.core.counted import counted
from benchtool.explain.engine.explain import Explanation, explain
from benchtool.explain.engine.search import Progress
from benchtool.explain.engine.verdict import Verdict
from benchtool.explain.request import Request


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Answer:
    """Hold an explanation and where it came from."""

    explanation: Explanation  # the verdict with its curves
    request: Request  # the recordings and the model in question
    seed: int  # of everything random
    seconds: float  # how long it took
    commands: tuple[str, ...] = ()  # as they were typed

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return self.explanation.verdict

    @property
    def simulated(self) -> bool:
        """Whether any recording says that no physical bench made it."""
        return any(source.simulated for source in self.request.sources)

    @property
    def has_model(self) -> bool:
        """Whether there is an effect to add to the model."""
        return bool(self.verdict.effects)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was repaired in the recordings, what they lack, how the model's file was read."""
        found = [line for source in self.request.sources for line in source.remarks]
        return tuple(dict.fromkeys((*found, *self.verdict.remarks, *self.request.loaded.notes)))

    @property
    def caution(self) -> str:
        """What to know of the recordings before the verdict is used; empty without remarks."""
        if not self.remarks:
            return ""
        first, *more = self.remarks
        others = f" ({counted(len(more), 'more remark')} with what was not judged)" if more else ""
        return f"Mind what it rests on: {first.rstrip('.')}{others}."

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of each recording by its name."""
        return {source.name: source.sha256 for source in self.request.sources}


class ChannelWords(NamedTuple):
    """Say how a channel is shown to people: in words, with a factor on stored numbers."""

    title: str
    unit: str
    factor: float = 1.0


_CHANNELS = {
    "theta_rad": ChannelWords("pitch", "deg", degrees(1.0)),
    "gyro_rad_s": ChannelWords("pitch rate", "deg/s", degrees(1.0)),
    "thrust_N": ChannelWords("thrust", "N"),
    "rpm": ChannelWords("rotor speed", "rpm"),
}


def channel_words(channel: str, unit: str) -> ChannelWords:
    """Return how a channel is shown."""
    if channel not in _CHANNELS and channel.startswith("rpm"):
        return ChannelWords(f"speed of rotor {channel.removeprefix('rpm')}", "rpm")
    return _CHANNELS.get(channel, ChannelWords(channel, unit))


def answer_request(
    request: Request,
    *,
    commands: Sequence[str] = (),
    seed: int = 0,
    draws: int = 128,
    bootstrap: int = 0,
    progress: Progress = lambda what, share: None,
) -> Answer:
    """Return the answer to a request; whoever has a clock sets how long it took.

    Args:
        request: everything read that it names.
        commands: as they were typed.
        seed, draws, bootstrap, progress: see `explain`.
    """
    found = explain(
        request.subject(), seed=seed, draws=draws, bootstrap=bootstrap, progress=progress
    )
    return Answer(
        explanation=found, request=request, seed=seed, seconds=0.0, commands=tuple(commands)
    )
