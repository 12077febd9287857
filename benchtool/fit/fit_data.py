"""Input data of a fit: points, conditions, errors and excluded points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchtool.core.channel import Channel
from benchtool.core.error_source import ErrorSource
from benchtool.core.errors import EstimationError, FileFormatError, InputError
from benchtool.core.parameter import resolve_name
from benchtool.core.recording import Recording, check_rotor_count
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import data_hash
from benchtool.data.column_map import read_column_map
from benchtool.data.columns import word_to_code
from benchtool.data.formats.formats import import_file, is_stand_table
from benchtool.data.run.ratios import ratio_error, ratios, thrust_error
from benchtool.data.run.read import changed_points, is_pitch_run, is_run, read_points
from benchtool.data.table import read_table
from benchtool.fit.nominal import rig_for_data
from benchtool.fit.recipe import Basis, Recipe
from benchtool.fit.uncertainty.bench_errors import (
    MIN_EFFECT,
    Visits,
    bench_errors,
    concatenate_visits,
)
from benchtool.fit.uncertainty.load_cell import ScaleError, find_scale_errors, run_zero_noise
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model

REFERENCE_Z_OVER_R = 9.0  # ground effect of eq. (4) is below 1 %; tables in papers end at 5 to 6
MAX_POINTS = 10_000  # their shared errors take 12 GB of memory; assumed
RATIO_BASIS: Basis = "equal_rpm2"  # basis of ratios in a table without forces
NO_PLATE_Z_OVER_R = 1e6  # recordings without a plate are beyond it (`OUT_OF_GROUND_EFFECT_M`)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitData:
    """Points of a fit."""

    points: Recording  # all points (n rows)
    conditions: Conditions  # of all points
    observed: Array  # (n,) thrust in N, or the ratio of the recipe's basis
    standard_error: Array  # (n,) of each point alone; 1 where none is stated
    errors: str  # "within" visits, from their samples; "stated" by a table; or "none"
    used: NDArray[np.bool_]  # (n,) False for excluded points
    left_out: tuple[str, ...]  # messages: excluded points and reasons
    z_over_R: Array  # (n,) least distance over the rig's radius
    hashes: Mapping[str, str]  # SHA-256 by data path
    reference: Conditions | None = None  # (n,) of each ratio: the parked plate
    error_sources: tuple[ErrorSource, ...] = ()  # shared by points (n)
    scale_errors: tuple[ScaleError, ...]  # of load cell calibrations
    calibration_warnings: Sequence[str]  # on old or missing calibrations
    visits: Visits  # visits of the points (n)
    by_thrust: Array | None = None  # (n, n) change of each ratio by each thrust: 1/N

    def shared_errors(self, model: Model) -> tuple[ErrorSource, ...]:
        """Return the errors shared by the used points, at a model's values."""
        sources = bench_errors(model, self.conditions, self.visits)
        if self.by_thrust is not None:
            changed_sources = ((source, self.by_thrust @ source.columns) for source in sources)
            # A scale error common to all thrusts cancels in their ratios.
            sources = tuple(
                replace(source, columns=columns)
                for source, columns in changed_sources
                if np.abs(columns[self.used]).max() > MIN_EFFECT
            )
        return tuple(source.select(self.rows) for source in (*self.error_sources, *sources))

    @property
    def groups(self) -> NDArray[np.intp] | None:
        """Setting number of each point (n,); None if the data do not number settings."""
        if "setting" not in self.points or not np.isfinite(self.points.column("setting")).all():
            return None
        return self.points.column("setting").astype(np.intp)

    @property
    def rows(self) -> NDArray[np.intp]:
        """Indices of the used points."""
        return np.flatnonzero(self.used)


def recipe_model(recipe: Recipe, permit: CodePermit = check_code_allowed) -> LoadedModel:
    """Return the recipe's model on the rig of its data, with parameters freed and fixed.

    Raises:
        InputError: the rig is unknown (`rig_for_data`), or the model belongs to another rig.
    """
    rig = rig_for_data(recipe.data, recipe.model, recipe.rig)
    loaded = load_model(recipe.model, rig, permit=permit)
    if recipe.columns is not None and not all(map(is_run, recipe.data)):
        columns = {**loaded.columns, **read_column_map(recipe.columns)}
        loaded = replace(loaded, columns=columns)
    names: set[str] = set()
    for entry in (*recipe.free, *recipe.fix, *recipe.hold):
        name = resolve_name(entry, loaded.model.parameters)
        if name in names:
            raise InputError(f"duplicate parameter {name}; free it, or fix it at one value")
        names.add(name)
    model = loaded.model.with_free(*recipe.free)
    for name, value in recipe.fix.items():
        model = model.with_fixed(name, value)
    for name in recipe.hold:
        model = model.with_fixed(name)
    if recipe.basis != "joint":
        # The thrust coefficient cancels in a ratio.
        model = model.with_fixed("k")
    return replace(loaded, model=model)


def read_fit_data(recipe: Recipe, loaded: LoadedModel) -> FitData:
    """Read the recipe's data for its model.

    Raises:
        InputError: data that lack a channel the basis needs, or have no usable point.
    """
    hashes = _hashes(recipe.data)
    options = ("columns", "calibration", "where")
    table_arguments = [f"--{name}" for name in options if getattr(recipe, name)]
    if table_arguments and all(map(is_run, recipe.data)):
        raise InputError(
            f"{' and '.join(table_arguments)} can be given for a CSV table only: {recipe.data[0]} "
            f"is a run, which defines its columns, calibration and points; omit the option"
        )
    parts = [_read_file(path, recipe, loaded) for path in recipe.data]
    rig = loaded.model.rig
    points = _concatenate(parts)
    has_ratios = "thrust_N" not in points and "thrust_ratio" in points
    if has_ratios and recipe.basis != RATIO_BASIS:
        raise InputError(
            f"the data contain thrust ratios and no thrust_N; fit them with --basis {RATIO_BASIS}"
        )
    if "thrust_N" not in points and not has_ratios:
        raise InputError(
            f"there is no thrust_N to fit, only {', '.join(points.names)}; map it in [columns] of "
            f"the model: thrust_N = {{ column = 'column name', unit = 'gf' }}"
        )
    if len(points) > MAX_POINTS:
        raise InputError(
            f"{len(points):,} points are too many; allowed: {MAX_POINTS:,}; average or filter rows"
        )
    model = loaded.model
    for path, part in zip(recipe.data, parts, strict=True):
        check_rotor_count(part, model.rig, path)
    conditions = Conditions.from_recording(points, model.rig)
    sources: tuple[ErrorSource, ...] = ()
    by_thrust: Array | None = None
    reference: Conditions | None = None
    error: Array | None
    if recipe.basis == "joint":
        observed = points.to_si("thrust_N")
        error, is_from_samples = thrust_error(points) or (None, False)
        is_within = is_from_samples or all(map(is_run, recipe.data))
        errors = "within" if is_within else "stated"
    elif has_ratios:
        observed, error, errors = points.column("thrust_ratio"), ratio_error(points), "stated"
        turning = np.sum(conditions.speed_rad_s**2, axis=0)
        by_thrust = np.diag(1.0 / (model.parameters["k"].value * turning))
        reference = conditions.out_of_ground_effect()
    else:
        # Each run is divided by its own references.
        run_ratios = [ratios(part, recipe.basis, model.rig) for part in parts]
        observed = np.concatenate([ratio.value for ratio in run_ratios])
        error = np.concatenate([ratio.standard_error for ratio in run_ratios])
        sources = tuple(  # independent draws for each run
            replace(
                same[0],
                sd=float(np.sqrt(np.mean([source.sd**2 for source in same]))),
                columns=block_diag(*(source.columns for source in same)),
            )
            for same in zip(*(ratio.error_sources for ratio in run_ratios), strict=True)
        )
        share = block_diag(*(ratio.reference_weights for ratio in run_ratios))
        by_thrust = block_diag(*(ratio.thrust_jacobian for ratio in run_ratios))
        errors = "within" if np.isfinite(error).any() else "none"
        error = np.where(np.isfinite(error), error, np.nan if errors == "within" else 1.0)
        is_parked = [part.column("kind") == word_to_code("kind", "reference") for part in parts]
        parked_m = [
            np.full(len(part), float(part.to_si("plate_z_m")[rows].mean()))
            for part, rows in zip(parts, is_parked, strict=True)
        ]
        # The load cell drifts between a visit and its references; the tare error is in both.
        reference = Conditions.build(
            model.rig,
            speed_rad_s=conditions.speed_rad_s,
            plate_z_m=np.concatenate(parked_m),
            voltage_V=conditions.voltage_V,
            elapsed_s=share @ np.nan_to_num(conditions.elapsed_s),
            time_s=share @ np.nan_to_num(conditions.time_s),
        )
    if error is None:
        error, errors = np.ones(len(points)), "none"
    if not np.any(conditions.speed_rad_s > 0.0) and not has_ratios:
        max_thrust_N = float(np.nanmax(np.abs(points.to_si("thrust_N"))))
        raise InputError(
            f"speed is 0 in all {len(points)} points, but thrust reaches {max_thrust_N:.3g} N: the "
            f"speed channel has failed, or speed is in another column; map that column to rpm1"
        )
    turning = np.any(conditions.speed_rad_s > 0.0, axis=0)
    if recipe.basis == "joint" and (negative := observed[turning] < 0.0).mean() > 0.5:
        raise EstimationError(
            f"thrust_N is negative at {negative.sum()} of {pluralize(len(negative), 'point')} with "
            f"turning rotors, as on a pusher mount; reverse it with benchtool import "
            f"{recipe.data[0]} --flip thrust_N and fit the result"
        )
    z_over_R = model.z_over_R(conditions)
    nearest = model.nearest_z_over_R if recipe.min_z_over_R is None else recipe.min_z_over_R
    used, left_out = _select_points(observed, error, conditions.is_complete, z_over_R, nearest, rig)
    if used.any() and z_over_R[used].min() >= NO_PLATE_Z_OVER_R and model.parameters["R_m"].free:
        left_out += (
            "no point has a plate distance, so that R_m cannot be determined; fit the thrust curve "
            "with benchtool motor, or k alone with --fix R_m",
        )
    if recipe.basis != "joint" and not has_ratios:
        # A reference over itself is 1 and carries no information.
        used = used & (points.column("kind") != word_to_code("kind", "reference"))
    scale_errors, calibration_warnings = find_scale_errors(recipe.data, parts, recipe.calibration)
    visits = [
        Visits.of(part, Conditions.from_recording(part, rig), rig, run_zero_noise(path, rig))
        for path, part in zip(recipe.data, parts, strict=True)
    ]
    return FitData(
        points=points,
        conditions=conditions,
        observed=observed,
        standard_error=error,
        errors=errors,
        used=used,
        left_out=(*left_out, *_data_warnings(recipe.data, parts)),
        z_over_R=z_over_R,
        hashes=hashes,
        reference=reference,
        error_sources=sources,
        scale_errors=scale_errors,
        calibration_warnings=calibration_warnings,
        by_thrust=by_thrust,
        visits=concatenate_visits(visits),
    )


def _data_warnings(paths: Sequence[str], parts: Sequence[Recording]) -> Iterator[str]:
    """Yield warnings on the data: points edited by hand, or with many outliers."""
    for path, part in zip(paths, parts, strict=True):
        yield from changed_points(path)
        if "suspect" in part and (count := int(np.nansum(part.column("suspect")))):
            yield (
                f"{path}: {pluralize(count, 'point')} suspect: too many samples deviate to be "
                f"outliers, or rotor vibration is read as thrust; see the run's events"
            )


def _hashes(paths: Sequence[str]) -> dict[str, str]:
    """Return the hash of every data path; raise for duplicate data."""
    hashes: dict[str, str] = {}
    for path in paths:
        digest = data_hash(path)
        for other, other_digest in hashes.items():
            if other_digest == digest:
                raise InputError(f"duplicate data: {path} and {other} are identical; remove one")
        hashes[path] = digest
    return hashes


def _read_file(path: str, recipe: Recipe, loaded: LoadedModel) -> Recording:
    if is_run(path):
        if is_pitch_run(path):
            raise FileFormatError(
                path,
                "this is a pitch run, which cannot be fitted; show it with benchtool report, "
                "or find missing effects of its model with benchtool explain",
            )
        return read_points(path)
    columns = loaded.columns
    where = [*(f"{key}={value}" for key, value in loaded.row_filter.items()), *recipe.where]
    if not columns and Path(path).name == "points.csv":
        return read_points(path)
    if not columns and not where and Path(path).is_file() and is_stand_table(path):
        return import_file(path).recording
    return _with_references(read_table(path, columns, where))


def _with_references(table: Recording) -> Recording:
    """Return a table whose reference rows without a distance are out of ground effect."""
    if "kind" not in table or "plate_z_m" not in table:
        return table
    z_m = table.column("plate_z_m")
    is_far = (table.column("kind") == word_to_code("kind", "reference")) & ~np.isfinite(z_m)
    z_m = np.where(is_far, OUT_OF_GROUND_EFFECT_M, z_m)
    return table.drop(("plate_z_m",)).with_column(Channel("plate_z_m", "m"), z_m)


def _concatenate(parts: Sequence[Recording]) -> Recording:
    if len(parts) == 1:
        return parts[0]
    names = [name for name in parts[0].names if all(name in part for part in parts)]
    if "thrust_N" not in names:
        raise InputError(
            "the data have no thrust_N in common; fit run folders and foreign tables separately"
        )
    columns = []
    for name in names:
        arrays = [part.column(name) for part in parts]
        if name == "setting":
            steps = np.cumsum([0.0, *(array.max() for array in arrays[:-1])])
            arrays = [array + step for array, step in zip(arrays, steps, strict=True)]
        columns.append((parts[0].channels[parts[0].index(name)], np.concatenate(arrays)))
    return Recording.from_columns(
        columns, parts[0].provenance, any(part.simulated for part in parts)
    )


def _select_points(
    observed: Array,
    error: Array,
    is_known: NDArray[np.bool_],
    z_over_R: Array,
    nearest: float,
    rig: Rig,
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    finite = np.isfinite(observed) & np.isfinite(error) & (error > 0.0) & is_known
    near = finite & (z_over_R < nearest)
    reasons = []
    radius_m = rig.propulsion.radius_m
    plate_m = radius_m * z_over_R[finite & (z_over_R < NO_PLATE_Z_OVER_R)]
    scale_text = (
        f"distances {plate_m.min(initial=np.inf):.2g} to {plate_m.max(initial=0.0):.2g} m, rotor "
        f"radius {radius_m:.4g} m; check both units (--radius 4in, --z-unit cm), or"
    )
    if not finite.all():
        reasons.append(
            f"{np.count_nonzero(~finite)} of {len(observed)} points have an empty cell in thrust, "
            f"its error, speed or plate, or an error of 0, and were left out (the first: data row "
            f"{int(np.argmax(~finite)) + 1})"
        )
    if near.any():
        text = ", outside the formulae's validity, and were left out;"
        if 2 * np.count_nonzero(near) > len(observed):
            text = f": {scale_text}"
        reasons.append(
            f"{np.count_nonzero(near)} of {len(observed)} points lie below z/R = {nearest:g}{text} "
            f"include them with --min-z-over-r 0"
        )
    used = finite & ~near
    if used.any() and REFERENCE_Z_OVER_R < float(z_over_R[used].min()) < NO_PLATE_Z_OVER_R:
        reasons.append(
            f"the nearest point is at z/R = {z_over_R[used].min():.3g}, too far for ground effect: "
            f"{scale_text} fit the thrust curve of a test without a plate with benchtool motor"
        )
    if not used.any():
        raise InputError(
            f"none of {len(observed)} points can be fitted: {'; '.join(reasons) or 'there is none'}"
        )
    return used, tuple(reasons)
