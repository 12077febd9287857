"""From files to what a fit takes: points, conditions, errors, and what was left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.error_source import ErrorSource, concatenate_sources
from benchtool.core.errors import EstimationError, FileFormatError, InputError
from benchtool.core.parameter import resolve_name
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.rotor_count import check_rotor_count
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import data_hash
from benchtool.data.column_map import read_column_map
from benchtool.data.columns import word_to_code
from benchtool.data.formats.formats import import_file, is_stand_table
from benchtool.data.run.ratios import ratio_error, ratios, thrust_error
from benchtool.data.run.read import changed_points, is_pitch_run, is_run, read_points
from benchtool.data.table import read_table
from benchtool.fit.data_rig import rig_for_data
from benchtool.fit.recipe import Basis, Recipe
from benchtool.fit.uncertainty.bench_errors import SHOWS, Visits, bench_errors, joined_visits
from benchtool.fit.uncertainty.load_cell import LoadCells, load_cells
from benchtool.fit.uncertainty.zero_drift import add_zero_drift
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model

REFERENCE_Z_OVER_R = (
    9.0  # beyond it eq. (4) leaves below one per cent; tables in papers end at 5 to 6
)
MAX_POINTS = 10_000  # their shared errors take 12 GB of memory; assumed
RATIO_BASIS: Basis = "equal_rpm2"  # the basis of ratios that a table gives without forces
NO_PLATE_Z_OVER_R = (
    1e6  # beyond it stands `OUT_OF_GROUND_EFFECT_M`: a recording without a plate, which is fine
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitData:
    """Hold the points of a fit.

    Attributes:
        groups: (n,) number of the setting that each point repeats; None where nobody numbered them.
        error_sources: what points share, over all n.
        reference: (n,) what each point of a ratio was divided by: the plate where it was parked.
        load_cells: calibrations that the points went through.
    """

    points: Recording  # all that were read (n rows)
    conditions: Conditions  # of all points
    observed: Array  # (n,) thrust in N, or the ratio of the recipe's basis
    standard_error: Array  # (n,) of each point alone; 1 where none is stated
    errors: str  # "within" visits, from their samples; "stated" by a table; or "none"
    used: NDArray[np.bool_]  # (n,) False for points that the fit leaves out
    left_out: tuple[str, ...]  # sentences that say which points and why
    z_over_R: Array  # (n,) least distance over the rig's radius
    groups: NDArray[np.intp] | None
    hashes: Mapping[str, str]  # SHA-256 by data path
    reference: Conditions | None = None
    error_sources: tuple[ErrorSource, ...] = ()
    load_cells: LoadCells = field(default_factory=LoadCells)
    visits: Visits  # what the points have in common (n)
    by_thrust: Array | None = None  # (n, n) change of each ratio by each thrust: 1/N

    def bench_errors(self, model: Model) -> tuple[ErrorSource, ...]:
        """Return the errors of the bench on every observation (n,), at a model's values."""
        found = bench_errors(model, self.conditions, self.visits)
        if self.by_thrust is None:
            return found
        changed = ((one, self.by_thrust @ one.columns) for one in found)
        # A scale of all thrusts is none of their ratios.
        return tuple(
            replace(one, columns=columns)
            for one, columns in changed
            if np.abs(columns[self.used]).max() > SHOWS
        )

    @property
    def rows(self) -> NDArray[np.intp]:
        """Positions of the used points."""
        return np.flatnonzero(self.used)


def recipe_model(recipe: Recipe, permit: CodePermit = check_code_allowed) -> LoadedModel:
    """Return the recipe's model on its data's rig, parameters freed and fixed as it says.

    Raises:
        InputError: no rig known (`rig_for_data`), or a model that holds numbers of another one.
    """
    rig = rig_for_data(recipe.data, recipe.model, recipe.rig)
    loaded = load_model(recipe.model, rig, permit=permit)
    if recipe.columns is not None and not all(map(is_run, recipe.data)):
        columns = {**loaded.columns, **read_column_map(recipe.columns)}
        loaded = replace(loaded, columns=columns)
    named: set[str] = set()
    for typed in (*recipe.free, *recipe.fix, *recipe.hold):
        name = resolve_name(typed, loaded.model.parameters)
        if name in named:
            raise InputError(f"{name} is named twice; free it, or fix it at one value")
        named.add(name)
    model = loaded.model.with_free(*recipe.free)
    for name, value in recipe.fix.items():
        model = model.with_fixed(name, value)
    for name in recipe.hold:
        model = model.with_fixed(name)
    if recipe.basis != "joint":
        # A ratio does not know the thrust coefficient.
        model = model.with_fixed("k")
    return replace(loaded, model=model)


def read_fit_data(recipe: Recipe, loaded: LoadedModel) -> FitData:
    """Read the recipe's data for its model.

    Raises:
        InputError: data that lack what the basis needs, or of which nothing is left.
    """
    hashes = _hashes(recipe.data)
    of_tables = {
        "columns": recipe.columns,
        "calibration": recipe.calibration,
        "where": recipe.where,
    }
    given = [f"--{name}" for name, value in of_tables.items() if value]
    if given and all(map(is_run, recipe.data)):
        raise InputError(
            f"{' and '.join(given)} can be given for a CSV table only: {recipe.data[0]} is a run, "
            f"whose columns and calibration are its own and whose points all count; leave it out"
        )
    parts = [_read_one(path, recipe, loaded) for path in recipe.data]
    rig = loaded.model.rig
    parts = [add_zero_drift(part, path, rig) for part, path in zip(parts, recipe.data, strict=True)]
    points = _joined(parts)
    has_ratios = "thrust_N" not in points and "thrust_ratio" in points
    if has_ratios and recipe.basis != RATIO_BASIS:
        raise InputError(
            f"the data hold ratios of thrust and no thrust_N; fit them with --basis {RATIO_BASIS}"
        )
    if "thrust_N" not in points and not has_ratios:
        raise InputError(
            f"there is no thrust_N to fit, only {', '.join(points.names)}; map it in [columns] of "
            f"the model: thrust_N = {{ column = 'their name', unit = 'gf' }}"
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
    if recipe.basis == "joint":
        observed, error, errors = _thrust_with_error(points, all(map(is_run, recipe.data)))
    elif has_ratios:
        observed, found_error = points.column("thrust_ratio"), ratio_error(points)
        errors = "none" if found_error is None else "stated"
        error = np.ones(len(points)) if found_error is None else found_error
        turning = np.sum(conditions.speed_rad_s**2, axis=0)
        by_thrust = np.diag(1.0 / (model.parameters["k"].value * turning))
        reference = conditions.out_of_ground_effect()
    else:
        # Each run is divided by its own references.
        found = [ratios(part, recipe.basis, model.rig) for part in parts]
        observed = np.concatenate([one.value for one in found])
        error = np.concatenate([one.standard_error for one in found])
        sources = concatenate_sources([one.error_sources for one in found])
        share = block_diag(*(one.share for one in found))
        by_thrust = block_diag(*(one.by_thrust for one in found))
        errors = "within" if np.isfinite(error).any() else "none"
        error = np.where(np.isfinite(error), error, np.nan if errors == "within" else 1.0)
    if not np.any(conditions.speed_rad_s > 0.0) and not has_ratios:
        most = float(np.nanmax(np.abs(points.to_si("thrust_N"))))
        raise InputError(
            f"no rotor turns in {pluralize(len(points), 'point')} while thrust reaches {most:.3g} "
            "N: "
            f"the speed channel is dead, or another column holds the speed; map that one to rpm1"
        )
    turning = np.any(conditions.speed_rad_s > 0.0, axis=0)
    if recipe.basis == "joint" and (negative := observed[turning] < 0.0).mean() > 0.5:
        raise EstimationError(
            f"thrust_N is negative at {negative.sum()} of {pluralize(len(negative), 'point')} with "
            f"turning rotors, as on a pusher mount; reverse it with benchtool import "
            f"{recipe.data[0]} --flip thrust_N and fit the result"
        )
    z_over_R = model.z_over_R(conditions)
    nearest = recipe.min_z_over_R
    nearest = model.nearest_z_over_R if nearest is None else nearest
    used, left_out = _selected(observed, error, conditions.known, z_over_R, nearest)
    if used.any() and z_over_R[used].min() >= NO_PLATE_Z_OVER_R and model.parameters["R_m"].free:
        left_out += (
            "no point has a plate distance, so that R_m cannot be determined; fit the thrust curve "
            "with benchtool motor, or k alone with --fix R_m",
        )
    groups = None
    if recipe.basis != "joint" and not has_ratios:
        parked_m = np.concatenate([_parked_m(part) for part in parts])
        # A load cell drifts between a visit and its references, and reads its tare error in both.
        reference = Conditions.of(
            model.rig,
            speed_rad_s=conditions.speed_rad_s,
            plate_z_m=parked_m,
            voltage_V=conditions.voltage_V,
            elapsed_s=share @ np.nan_to_num(conditions.elapsed_s),
            time_s=share @ np.nan_to_num(conditions.time_s),
        )
        # A reference over itself is 1 by arithmetic and says nothing.
        used = used & (points.column("kind") != word_to_code("kind", "reference"))
    if "setting" in points and np.isfinite(points.column("setting")).all():
        groups = points.column("setting").astype(np.intp)
    return FitData(
        points=points,
        conditions=conditions,
        observed=observed,
        standard_error=error,
        errors=errors,
        used=used,
        left_out=(*left_out, *_suspect(recipe.data, parts)),
        z_over_R=z_over_R,
        groups=groups,
        hashes=hashes,
        reference=reference,
        error_sources=sources,
        load_cells=load_cells(recipe.data, parts, recipe.calibration),
        by_thrust=by_thrust,
        visits=joined_visits(
            [Visits.of(part, Conditions.from_recording(part, rig), rig) for part in parts]
        ),
    )


def _suspect(paths: Sequence[str], parts: Sequence[Recording]) -> Iterator[str]:
    """Yield warnings on data that are fitted: points changed by hand, or with many outliers."""
    for path, part in zip(paths, parts, strict=True):
        yield from changed_points(path)
        if "suspect" in part and (count := int(np.nansum(part.column("suspect")))):
            yield (
                f"{path}: {pluralize(count, 'point')} suspect: too many samples lie apart to be "
                f"outliers, or a rotor's vibration reads as thrust; see the run's events"
            )


def _hashes(paths: Sequence[str]) -> dict[str, str]:
    """Return the hash of every data path; the same data twice would count twice."""
    found: dict[str, str] = {}
    for path in paths:
        digest = data_hash(path)
        for other, known in found.items():
            if known == digest:
                raise InputError(
                    f"{path} holds the same data as {other}; points count once, so name it once"
                )
        found[path] = digest
    return found


def _read_one(path: str, recipe: Recipe, loaded: LoadedModel) -> Recording:
    if is_run(path):
        if is_pitch_run(path):
            raise FileFormatError(
                path,
                "this is a pitch run, from which nothing is fitted; show it with benchtool report, "
                "or find what its model lacks with benchtool explain",
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
    """Return a table whose reference rows without a distance stand far from any plate."""
    if "kind" not in table or "plate_z_m" not in table:
        return table
    z_m = table.column("plate_z_m")
    far = (table.column("kind") == word_to_code("kind", "reference")) & ~np.isfinite(z_m)
    z_m = np.where(far, OUT_OF_GROUND_EFFECT_M, z_m)
    return table.drop(("plate_z_m",)).with_column(Channel("plate_z_m", "m"), z_m)


def _joined(parts: Sequence[Recording]) -> Recording:
    if len(parts) == 1:
        return parts[0]
    names = [name for name in parts[0].names if all(name in part for part in parts)]
    if "thrust_N" not in names:
        raise InputError(
            "the data have no thrust_N in common; fit run folders and foreign tables separately"
        )
    columns = []
    for name in names:
        values = np.concatenate([part.column(name) for part in parts])
        if name == "setting":
            steps = np.cumsum([0.0, *(part.column(name).max() for part in parts[:-1])])
            values = np.concatenate(
                [part.column(name) + step for part, step in zip(parts, steps, strict=True)]
            )
        columns.append((parts[0].channels[parts[0].index(name)], values))
    return Recording.from_columns(
        columns, parts[0].provenance, any(part.simulated for part in parts)
    )


def _thrust_with_error(points: Recording, is_whole_run: bool) -> tuple[Array, Array, str]:
    thrust, found = points.to_si("thrust_N"), thrust_error(points)
    if found is None:
        return thrust, np.ones(len(points)), "none"
    error, of_samples = found
    return thrust, error, "within" if is_whole_run or of_samples else "stated"


def _parked_m(part: Recording) -> Array:
    """Return where one run's plate was parked for its references, for every point (n,): m."""
    parked = part.column("kind") == word_to_code("kind", "reference")
    return np.full(len(part), float(part.to_si("plate_z_m")[parked].mean()))


def _selected(
    observed: Array, error: Array, known: NDArray[np.bool_], z_over_R: Array, nearest: float
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    finite = np.isfinite(observed) & np.isfinite(error) & (error > 0.0) & known
    near = finite & (z_over_R < nearest)
    reasons = []
    if not finite.all():
        reasons.append(
            f"{np.count_nonzero(~finite)} of {len(observed)} points have an empty cell in thrust, "
            f"its error, speed or plate, or an error of 0, and were left out (the first: data row "
            f"{int(np.argmax(~finite)) + 1})"
        )
    if near.any():
        reasons.append(
            f"{np.count_nonzero(near)} of {len(observed)} points lie below z/R = "
            f"{nearest:g}, outside the formulae's validity, and were left out; "
            f"take them in with --min-z-over-r 0"
        )
    used = finite & ~near
    if used.any() and REFERENCE_Z_OVER_R < float(z_over_R[used].min()) < NO_PLATE_Z_OVER_R:
        reasons.append(
            f"the nearest point lies at z/R = {z_over_R[used].min():.3g}, where there is no ground "
            f"effect to fit; check the unit of plate_z_m, or fit the thrust curve of a test "
            f"without a plate with benchtool motor"
        )
    if not used.any():
        raise InputError(
            f"none of {len(observed)} points can be fitted: {'; '.join(reasons) or 'there is none'}"
        )
    return used, tuple(reasons)
