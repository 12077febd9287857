"""Recordings, model and user-defined effects of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError, MissingColumn
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import file_hash
from benchtool.explain.engine.evidence import Subject
from benchtool.explain.engine.explain import explain
from benchtool.explain.pitch.log import pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.recordings import (
    RecordingSource,
    bench_kind,
    find_missing_inputs,
    find_path_error,
    read_sources,
)
from benchtool.explain.result import Explanation
from benchtool.explain.sweep.log import sweep_log
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.fit.nominal import rig_for_data
from benchtool.physics.catalogue import EFFECTS, user_effects
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model_file import LoadedModel, load_model, model_names


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

    @property
    def effects(self) -> dict[str, Effect]:
        """All effects by name: those of the library, and user-defined ones."""
        return {**EFFECTS, **{effect.name: effect for effect in self.user_effects}}

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of each recording by its name."""
        return {source.name: source.sha256 for source in self.sources}

    def subject(self) -> Subject:
        """Return the recordings with the model; InputError if they are insufficient."""
        model, effects = self.loaded.model, [e for e in self.user_effects if self.kind in e.benches]
        if self.kind == "sweep":
            learn, check = (
                [sweep_log(source.recording, model.rig, zero=source.zero) for source in part]
                for part in (self.learn, self.check)
            )
            return SweepSubject(model, learn, check, effects)
        slide_s = self.loaded.plate_slide_s
        training, validation = (
            [pitch_log(source.recording, model.rig, source.name, slide_s) for source in part]
            for part in (self.learn, self.check)
        )
        return PitchSubject(model, training, validation, effects)

    def explain(self, commands: Sequence[str] = (), **options: Any) -> Explanation:
        """Explain the recordings; options as of the engine's `explain`."""
        found = explain(self.subject(), **options)
        remarks = [line for source in self.sources for line in source.remarks]
        return replace(
            found,
            remarks=tuple(dict.fromkeys((*remarks, *found.remarks))),
            source=self,
            commands=tuple(commands),
        )


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
