"""Several rigs pooled: against independent computations, and counted over seeds."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from scipy.stats import norm

import benchtool.api as bt
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.units import Array
from benchtool.fit.pool import RigValues, pool_rigs
from benchtool.fit.result_file import write_result
from tests.proof.truth.budgets import budget_sweep

EIGHT_SCHOOLS = (  # effects and standard errors (Rubin 1981, table 1)
    (28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0),
    (15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0),
)


def rig(
    name: str, values: Array, covariance: Array, names: tuple[str, ...] = ("K_b",)
) -> RigValues:
    return RigValues(name=name, names=names, values=values, covariance=covariance)


def schools() -> list[RigValues]:
    return [
        rig(str(k), np.array([y]), np.array([[sd**2]]))
        for k, (y, sd) in enumerate(zip(*EIGHT_SCHOOLS, strict=True))
    ]


def test_one_parameter_is_as_integrated_on_a_grid_of_mean_and_spread():
    """Nothing is integrated by formula here: mu and tau on a grid, densities multiplied."""
    y, sd = (np.array(each) for each in EIGHT_SCHOOLS)
    s = np.sqrt(8.0 / np.sum(sd**-2))
    u = (np.arange(1200) + 0.5) / 1200
    tau = s * u / (1.0 - u)
    mu = np.linspace(-60.0, 80.0, 1401)
    spread = np.hypot(sd, tau[:, None])[:, None, :]  # (tau, 1, schools)
    density = np.exp(norm.logpdf(y, mu[:, None], spread).sum(-1))
    weight = density / density.sum()
    mean = float((weight.sum(0) * mu).sum())
    shrink = tau[:, None] ** 2 / (tau[:, None] ** 2 + sd**2)
    own = mu[:, None] + shrink[:, None, :] * (y - mu[:, None])
    first = float((weight * own[:, :, 0]).sum())
    at = weight.sum(1).cumsum()
    quantiles = np.interp([0.25, 0.5, 0.75, 0.9], at, tau)
    zero = np.exp(norm.logpdf(y, mu[:, None], sd).sum(-1)).sum() / density.sum(1).mean()

    found = pool_rigs(schools(), ["K_b"])
    assert found.scale == pytest.approx([s])
    assert found.mean.mean() == pytest.approx(mean, abs=0.15)
    assert found.rig_values[:, 0, 0].mean() == pytest.approx(first, abs=0.2)
    np.testing.assert_allclose(np.quantile(found.tau, [0.25, 0.5, 0.75, 0.9]), quantiles, rtol=0.05)
    assert found.identical_probability[0] == pytest.approx(zero / (1.0 + zero), rel=0.02)


def test_a_shared_parameter_is_the_weighted_mean_and_sharpens_the_others():
    covariance = np.array([[1.0, 0.9], [0.9, 1.0]])
    rigs = [rig(str(k), np.array([0.5 * k, 3.0 * k]), covariance, ("a", "b")) for k in range(3)]
    apart, together = (pool_rigs(rigs, ["a", "b"], shared) for shared in ((), ("a",)))
    assert np.all(together.tau[:, 0] == 0.0)
    assert np.nanmax(np.ptp(together.rig_values[:, :, 0], axis=1)) < 1e-9
    sure, unsure = (each.differences["b"][0] for each in (together, apart))
    assert sure.is_significant
    # Two values of variance 1 - 0.9^2 where a is known, hardly pooled at so wide a spread.
    assert sure.sd == pytest.approx(np.sqrt(2.0 * (1.0 - 0.9**2)), rel=0.05)
    assert sure.sd < unsure.sd
    assert np.isnan(together.identical_probability[0])


def test_a_parameter_that_one_rig_lacks_is_pooled_of_the_others():
    whole = [rig(str(k), np.array([k, 9.0 + k]), np.eye(2), ("a", "b")) for k in range(3)]
    lacks = [*whole[:2], rig("2", np.array([2.0]), np.eye(1), ("a",))]
    found, alone = pool_rigs(lacks, ["a", "b"]), pool_rigs(whole[:2], ["b"])
    assert np.isnan(found.rig_values[:, 2, 1]).all()
    assert found.rig_values[:, 0, 1].mean() == pytest.approx(
        alone.rig_values[:, 0, 0].mean(), abs=0.1
    )
    assert len(found.differences["a"]) == 3
    assert len(found.differences["b"]) == 1
    with pytest.raises(InputError, match="b is in 1 fit of 2; pooling needs 2"):
        pool_rigs([whole[0], lacks[2]], ["a", "b"])


@pytest.fixture(scope="module")
def fits(tmp_path_factory):
    """Fit three benches alike and one whose R is a tenth larger."""
    folder = tmp_path_factory.mktemp("rigs")
    for k in range(4):
        fixed = {"R_m": 0.12 if k < 3 else 0.132, "body_lift.K_b": 1.9}
        budget_sweep(80 + k, folder / f"{k}.csv", fixed)
        output = bt.fit(folder / f"{k}.csv", "quad_bench", rig="pquad").found
        (folder / f"bench{k}").mkdir()
        write_result(folder / f"bench{k}", output)
    return [folder / f"bench{k}" for k in range(4)]


def test_fits_of_several_benches_are_pooled(fits):
    result = bt.pool(fits)
    assert result.found.pooled.names == ("body_lift.K_b", "R_over_rotor_radius")
    table = result.to_dataframe("differences")
    real = table[table["real"]]
    assert set(real["parameter"]) == {"R_over_rotor_radius"}
    assert all("bench3" in {one.rig, one.other} for one in real.itertuples())
    assert len(real) == 3
    assert "significant differences: 3 of 6 pairs" in result.summary()
    shared = bt.pool(fits, of=["R_over_rotor_radius"], shared=["K_b"])
    assert shared.to_dataframe("rigs")["pooled_sd"].max() < table["sd"].max()


def test_what_cannot_be_pooled_is_refused(fits, tmp_path):
    assert bt.pool(fits, of=["k"]).found.units == {"k": "N/(rad/s)2"}
    with pytest.raises(InputError, match="are the same quantity"):
        bt.pool(fits, of=["R_m", "R_over_rotor_radius"])
    with pytest.raises(UnknownChoice, match="unknown fitted parameter 'K_c'"):
        bt.pool(fits, of=["K_c"])
    with pytest.raises(InputError, match="duplicate fit"):
        bt.pool([fits[0], fits[0]])
    with pytest.raises(InputError, match="contains no fit"):
        bt.pool([fits[0], tmp_path])
    copy = tmp_path / "copy"
    shutil.copytree(fits[0], copy)
    with pytest.raises(InputError, match="fit copy has the same data as bench0"):
        bt.pool([fits[0], copy])
    text = (copy / "result.json").read_text()
    (copy / "result.json").write_text(
        text.replace('"verdict": "consistent"', '"verdict": "rejected"')
    )
    with pytest.raises(InputError, match="fit copy has a rejected model"):
        bt.pool([fits[1], copy])
    with pytest.raises(InputError, match="1 fit given"):
        bt.pool(fits[:1])
