"""An answer: an explanation with what it was made from, as files and pages show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from benchtool.core.counted import counted
from benchtool.explain.engine.explain import Explanation, explain
from benchtool.explain.engine.search import Progress
from benchtool.explain.engine.verdict import Verdict
from benchtool.explain.recordings import Source
from benchtool.explain.request import Request
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model_file import LoadedModel


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Answer:
    """Hold an explanation and where it came from.

    Attributes:
        explanation: the verdict with its curves.
        loaded: the model in question, with its columns.
        model_file: how the user named it, without folders of one machine.
        model_given: as it was typed, for the next command; `model_file` when empty.
        effects_given: where the user's own effects are, as it was typed; empty without.
        model_sha256: of its file; empty for a shipped one.
        learn, check: recordings.
        seed: of everything random.
        seconds: how long it took.
        commands: as they were typed.
        own_effects: candidates of the user's own.
    """

    explanation: Explanation
    loaded: LoadedModel
    model_file: str
    learn: tuple[Source, ...]
    check: tuple[Source, ...]
    seed: int
    seconds: float
    model_sha256: str = ""
    model_given: str = ""
    effects_given: str = ""
    commands: tuple[str, ...] = ()
    own_effects: tuple[Effect, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return self.explanation.verdict

    @property
    def simulated(self) -> bool:
        """Whether any recording says that no physical bench made it."""
        return any(source.simulated for source in (*self.learn, *self.check))

    @property
    def has_model(self) -> bool:
        """Whether there is an effect to add to the model."""
        return bool(self.verdict.effects)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was repaired in the recordings, what they lack, how the model's file was read."""
        found = [line for source in (*self.learn, *self.check) for line in source.remarks]
        return tuple(dict.fromkeys((*found, *self.verdict.remarks, *self.loaded.notes)))

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
        return {source.name: source.sha256 for source in (*self.learn, *self.check)}


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelWords:
    """Say how a channel is shown to people.

    Attributes:
        title: in words.
        unit: shown.
        factor: turns stored numbers into shown ones.
    """

    title: str
    unit: str
    factor: float = 1.0


_CHANNELS = {
    "theta_rad": ChannelWords(title="pitch", unit="deg", factor=degrees(1.0)),
    "gyro_rad_s": ChannelWords(title="pitch rate", unit="deg/s", factor=degrees(1.0)),
    "thrust_N": ChannelWords(title="thrust", unit="N"),
}


def channel_words(channel: str, unit: str) -> ChannelWords:
    """Return how a channel is shown."""
    if channel in _CHANNELS:
        return _CHANNELS[channel]
    if channel.startswith("rpm"):
        rotor = channel.removeprefix("rpm")
        title = f"speed of rotor {rotor}" if rotor else "rotor speed"
        return ChannelWords(title=title, unit="rpm")
    return ChannelWords(title=channel, unit=unit)


def answer_request(
    question: Request,
    *,
    commands: Sequence[str] = (),
    seed: int = 0,
    draws: int = 128,
    bootstrap: int = 0,
    progress: Progress = lambda what, share: None,
) -> Answer:
    """Return the answer to a question; whoever has a clock says how long it took.

    Args:
        question: everything read that it names.
        commands: as they were typed.
        seed: of everything random.
        draws: of the noise behind the floor.
        bootstrap: simulated records behind p-values; asymptotic ones when 0.
        progress: called with what is being done.
    """
    found = explain(
        question.subject(), seed=seed, draws=draws, bootstrap=bootstrap, progress=progress
    )
    return Answer(
        explanation=found,
        loaded=question.loaded,
        model_file=question.model_file,
        model_sha256=question.model_sha256,
        model_given=question.model_given,
        effects_given=question.effects_given,
        learn=question.learn,
        check=question.check,
        seed=seed,
        seconds=0.0,
        commands=tuple(commands),
        own_effects=question.own,
    )
