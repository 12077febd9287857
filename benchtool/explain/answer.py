"""Request and result of an explanation, with provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import NamedTuple

from benchtool.core.errors import InputError, MissingColumn
from benchtool.core.text import pluralize
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import file_hash
from benchtool.explain.engine.evidence import Subject
from benchtool.explain.engine.explain import NO_BOOTSTRAP, Explanation, explain
from benchtool.explain.engine.hypotheses import Bootstrap
from benchtool.explain.engine.judgement import Progress
from benchtool.explain.engine.verdict import SURE, Verdict
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.recordings import (
    RecordingSource,
    bench_kind,
    find_missing_inputs,
    find_path_error,
    read_sources,
)
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.fit.data_rig import rig_for_data
from benchtool.physics.catalogue import EFFECTS, user_effects
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model_file import LoadedModel, load_model, model_names


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExplainResult:
    """Explanation with its request and provenance."""

    explanation: Explanation
    request: Request
    seed: int  # of all random draws
    seconds: float  # computing time
    commands: tuple[str, ...] = ()  # as typed

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return self.explanation.verdict

    @property
    def simulated(self) -> bool:
        """True if any recording is simulated."""
        return any(source.simulated for source in self.request.sources)

    def find_title(self, name: str) -> str:
        """Return an effect's title, or the name if it has no title ("none")."""
        effects = {**EFFECTS, **{effect.name: effect for effect in self.request.user_effects}}
        return effects[name].title if name in effects else name

    @property
    def has_model(self) -> bool:
        """True if an effect can be added to the model."""
        return bool(self.verdict.effects)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Repairs of the recordings, and missing columns."""
        lines = [line for source in self.request.sources for line in source.remarks]
        return tuple(dict.fromkeys((*lines, *self.verdict.remarks)))

    @property
    def caution(self) -> str:
        """Caution about the recordings; empty without warnings."""
        if not self.remarks:
            return ""
        first, *others = self.remarks
        hint = f" ({pluralize(len(others), 'more remark')} in the list of unjudged effects)"
        return f"Caution: {first.rstrip('.')}{hint if others else ''}."

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of each recording by its name."""
        return {source.name: source.sha256 for source in self.request.sources}


class ChannelLabel(NamedTuple):
    """Display title and unit of a channel, with a factor on stored values."""

    title: str
    unit: str
    factor: float = 1.0


_CHANNELS = {
    "theta_rad": ChannelLabel("pitch", "deg", degrees(1.0)),
    "gyro_rad_s": ChannelLabel("pitch rate", "deg/s", degrees(1.0)),
    "thrust_N": ChannelLabel("thrust", "N"),
    "rpm": ChannelLabel("rotor speed", "rpm"),
}


def find_channel_label(channel: str, unit: str) -> ChannelLabel:
    """Return display title, unit and factor of a channel."""
    if channel not in _CHANNELS and channel.startswith("rpm"):
        return ChannelLabel(f"speed of rotor {channel.removeprefix('rpm')}", "rpm")
    return _CHANNELS.get(channel, ChannelLabel(channel, unit))


def answer_request(
    request: Request,
    *,
    commands: Sequence[str] = (),
    seed: int = 0,
    draws: int = 128,
    bootstrap: Bootstrap = NO_BOOTSTRAP,
    sure: float = SURE,
    minutes: float | None = None,
    progress: Progress = lambda what, share: None,
) -> ExplainResult:
    """Explain the recordings of a request; the caller sets `seconds`."""
    explanation = explain(
        request.subject(),
        seed=seed,
        draws=draws,
        bootstrap=bootstrap,
        sure=sure,
        minutes=minutes,
        progress=progress,
    )
    return ExplainResult(
        explanation=explanation, request=request, seed=seed, seconds=0.0, commands=tuple(commands)
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Request:
    """Recordings, model and user-defined effects, all read."""

    loaded: LoadedModel
    model_file: str  # name in the library or name of the model file
    model_given: str  # as typed, for the next command
    rig_given: str = ""  # as typed
    effects_given: str  # source of user-defined effects, as typed; empty without
    model_sha256: str  # of the model file; empty for a library model
    effects_file: Path | None  # Python file of user-defined effects
    user_effects: tuple[Effect, ...]  # user-defined effects
    learn: tuple[RecordingSource, ...]
    check: tuple[RecordingSource, ...]

    @property
    def sources(self) -> tuple[RecordingSource, ...]:
        """All recordings."""
        return (*self.learn, *self.check)

    @property
    def kind(self) -> BenchKind:
        """Bench of the recordings."""
        return bench_kind(self.learn[0])

    def subject(self) -> Subject:
        """Return the recordings with the model; InputError if they are insufficient."""
        model, effects = self.loaded.model, [e for e in self.user_effects if self.kind in e.benches]
        if self.kind == "sweep":
            learn, check = ([s.recording for s in part] for part in (self.learn, self.check))
            return SweepSubject(model, learn, check, effects)
        return PitchSubject(model, self._logs(self.learn), self._logs(self.check), effects)

    def _logs(self, sources: Sequence[RecordingSource]) -> list[PitchLog]:
        rig = self.loaded.model.rig
        slide_s = self.loaded.plate_slide_s
        return [pitch_log(source.recording, rig, source.name, slide_s) for source in sources]


def read_request(
    learn: Sequence[str],
    check: Sequence[str],
    model: str,
    effects: str | None = None,
    permit: CodePermit = check_code_allowed,
    rig: str | None = None,
) -> Request:
    """Read recordings, model and user-defined effects; report all missing inputs together.

    Args:
        model: name in the library or path of a model file.
        rig: name or path of a rig file, for recordings without one.
    """
    missing = find_missing_inputs(learn, check)
    if not learn:
        raise missing[0]
    errors = [error for path in (*learn, *check) if (error := find_path_error(path)) is not None]
    loaded: LoadedModel | None = None
    user_defined: tuple[Effect, ...] = ()
    try:
        if not model:
            names = [name for name in model_names() if not name.startswith("virtual_")]
            raise InputError(
                f"no model; use --model with the path of a model file or one of: {', '.join(names)}"
            )
        readable = () if errors else (*learn, *check)
        loaded = load_model(model, rig_for_data(readable, model, rig), permit=permit)
    except InputError as error:
        errors.append(error)
    try:
        user_defined = user_effects(effects, permit) if effects else ()
    except InputError as error:
        errors.append(error)
    errors += missing
    if errors or loaded is None:
        if len(errors) == 1:
            raise errors[0]
        listed = " ".join(f"({number}) {error}." for number, error in enumerate(errors, 1))
        raise InputError(f"{len(errors)} problems: {listed.removesuffix('.')}")
    file = Path(model) if Path(model).suffix == ".toml" and Path(model).is_file() else None
    effects_path = Path(effects) if effects and effects.endswith(".py") else None
    if effects_path is None and loaded.effects_file and file is not None:
        effects_path = file.parent / loaded.effects_file
    try:
        sources, checks = read_sources(learn, check, loaded)
    except MissingColumn as error:
        raise error.with_map_file(file.name if file is not None else model) from None
    return Request(
        loaded=loaded,
        model_file=file.name if file is not None else model,
        model_given=model,
        rig_given=rig or "",
        effects_given=effects or "",
        model_sha256=file_hash(file) if file is not None else "",
        effects_file=effects_path,
        user_effects=user_defined,
        learn=tuple(sources),
        check=tuple(checks),
    )
