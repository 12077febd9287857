"""Laws of thrust against distance on held-out distances, against known truths."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.fit.compare_laws import LawComparison, compare_laws, distance_groups
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import Problem
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

SINGLE = load_rig_by_name("pquad_single")
FROM_HALF = (0.5, 0.6, 0.75, 0.9, 1.1, 1.4, 1.8, 2.5, 4.0, 8.0)
REPEATS = 3


def asked(rig: Rig = SINGLE) -> Model:
    """Return eq. (2) with k and R free, as a user starts."""
    return Model.single(rig, "asked").with_free("k", "R_m")


def compared(
    truth: Model,
    *,
    sd: float,
    at: tuple[float, ...] = FROM_HALF,
    bump: float = 0.0,
    scatter: float = 0.0,
) -> LawComparison:
    """Compare all laws on a simulated sweep of a truth, errors relative and stated.

    Above 0 `scatter` is that of visits in stated errors, whose scale is then free.

    `bump` raises the thrust by that share at z/R 1.1 only.
    """
    z_over_R = np.repeat(np.array(at), REPEATS)
    rig = truth.rig
    conditions = Conditions.build(
        rig,
        speed_rad_s=np.full((rig.n_rotors, len(z_over_R)), 550.0),
        plate_z_m=z_over_R * rig.propulsion.radius_m,
    )
    thrust = np.asarray(truth.thrust_N(conditions))
    error = sd * thrust
    observed = thrust * (1.0 + bump * (z_over_R == 1.1))
    observed = observed + (scatter or 1.0) * error * np.random.default_rng(1).standard_normal(
        len(error)
    )

    def problem_of(model: Model) -> Problem:
        return problem_from_model(model, conditions, observed, error)

    model = asked(rig)
    return compare_laws(model.with_free("noise.scale") if scatter else model, problem_of, z_over_R)


@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("rotor_images", {}),
        ("exponential_law", {"Ca": 0.8, "Cb": 1.5}),
        ("power_law", {"a": 0.09, "p": 1.3}),
        ("hayden", {}),
    ],
)
def test_the_law_that_made_the_data_is_the_one_that_the_bench_follows(law, values):
    found = compared(asked().with_law(law, **values), sd=3e-4)
    assert found.scores[0].law == law
    assert found.scores[0].behind == 0.0
    told_apart = [score for score in found.scores[1:] if score.verdict in ("behind", "refused")]
    assert len(told_apart) >= 6


def test_what_the_scatter_hides_is_not_told_apart():
    found = compared(asked(), sd=0.01, at=(1.0, 1.5, 2.0, 3.0, 5.0))
    assert found.find_laws("refused") == []
    assert len(found.find_laws("indistinguishable")) >= 5


def test_a_law_that_misses_more_than_repeats_scatter_is_refused_with_a_free_scale():
    """chi2/dof at the stated errors is below 16, which a free scale would take for scatter."""
    found = compared(asked(), sd=2.5e-3, scatter=1.0)
    rational = next(score for score in found.scores if score.law == "rational_law")
    assert 2.0 < rational.chi2_per_dof < 16.0
    assert rational.verdict == "refused"
    assert found.scores[0].law == "rotor_images"
    # The same chi2/dof is scatter where repeats scatter as much.
    apart = compared(asked(), sd=2.5e-3, scatter=3.0)
    true = next(score for score in apart.scores if score.law == "rotor_images")
    assert 5.0 < true.chi2_per_dof < 16.0
    assert true.verdict in ("best", "indistinguishable")


def test_a_bench_that_follows_no_formula_follows_the_table_or_none():
    found = compared(asked(), sd=3e-4, bump=0.01)
    assert found.find_laws("best") in ([], ["monotone_table"])
    assert "follows no" in found.sentence
    assert "rotor_images" in found.find_laws("refused")


def test_nearer_than_half_a_radius_only_laws_that_are_finite_there_are_tried():
    truth = asked().with_law("exponential_law", Ca=0.8, Cb=1.5)
    found = compared(truth, sd=3e-4, at=(0.1, 0.3, *FROM_HALF))
    assert set(found.find_laws("not applied")) == {"rotor_images", "hayden", "power_law"}
    reasons = {score.reason for score in found.scores if score.verdict == "not applied"}
    assert reasons == {"points at z/R 0.1, valid from 0.5"}
    assert found.scores[0].law == "exponential_law"


def test_distances_are_grouped_within_two_per_cent_and_a_plate_gone_is_none():
    z_over_R = np.array([1.0, 0.5, 1.005, 8.0, 1e7, 0.505])
    assert distance_groups(z_over_R).tolist() == [1, 0, 1, 2, -1, 0]
    with pytest.raises(
        InputError, match="3 plate distances are too few to compare laws; minimum: 4"
    ):
        compared(asked(), sd=1e-3, at=(0.6, 1.0, 2.0))


def test_an_error_of_a_loss_counts_that_folds_overlap():
    """The paired losses' standard error times sqrt(1 + J/(J - 1)), J distances."""
    found = compared(asked(), sd=3e-3)
    for score in found.scores[1:]:
        if score.losses:
            spread = np.std(score.losses, ddof=1)
            assert score.behind == pytest.approx(np.mean(score.losses))
            assert score.behind_se == pytest.approx(spread * np.sqrt(1 / 10 + 1 / 9))
    assert found.scores[1].losses
