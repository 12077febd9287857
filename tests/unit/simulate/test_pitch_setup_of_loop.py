"""What a loop is made of: effects of one's own, feedforward's sources, what must be shared."""

from __future__ import annotations

import importlib
import sys
from functools import lru_cache

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import PlateVisit
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import Effect
from benchtool.physics.fold import source_key
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import Feedforward
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchLoop
from benchtool.simulate.pitch.simulate import simulate_pitch
from tests.unit.simulate.own_effect import MAGNET, SLUGGISH
from tests.unit.simulate.pitching import job, quiet_bench, sampled, soft

VISIT = (PlateVisit(z_over_R=1.0, in_s=1.0, out_s=1e6, move_s=0.5),)


def with_effect(effect: Effect, **values: float) -> PitchBench:
    model = Model.single(load_rig_by_name("beam")).with_effect("viscous_friction", damping_Nms=0.5)
    return PitchBench.from_model(model.with_effect(effect, **values), sensors={})


def test_an_effect_that_is_not_in_the_catalogue_acts_without_any_change_elsewhere():
    run = simulate_pitch(job(with_effect(MAGNET)), sampled(8.0))
    assert run.column("true_theta_rad")[-1] == pytest.approx(0.1, abs=1e-3)


def test_any_effect_may_lag_but_only_one():
    """It stands in the place of the rig's own motor lag."""
    slow = with_effect(SLUGGISH, tau_s=0.05)
    assert slow.model.lag_s == 0.05
    usual = with_effect(EFFECTS["motor_lag"], tau_s=0.05)
    first, second = (simulate_pitch(job(bench), sampled(0.1)).log for bench in (slow, usual))
    np.testing.assert_array_equal(first, second)
    with pytest.raises(InputError, match="'sluggish' of model 'single' both have the hook lag_s"):
        PitchBench.from_model(usual.model.with_effect(SLUGGISH), sensors={})


def peak(feedforward: Feedforward, bench: PitchBench | None = None) -> float:
    used = quiet_bench("pquad") if bench is None else bench
    run = simulate_pitch(job(used, soft("feedforward", feedforward)), sampled(4.0, plate=VISIT))
    return float(np.max(np.abs(run.column("true_theta_rad"))))


@lru_cache
def unaided() -> float:
    """Return the peak without any feedforward."""
    return peak(Feedforward(strength=0.0))


def test_a_feedforward_that_knows_everything_leaves_nothing():
    """What is left while the plate moves in is the rotors' lag."""
    assert unaided() > np.radians(5.0)
    assert peak(Feedforward(strength=1.0)) < 0.15 * unaided()
    exact = soft("feedforward", Feedforward(strength=1.0))
    run = simulate_pitch(job(quiet_bench("pquad"), exact), sampled(6.0, plate=VISIT))
    assert abs(run.column("true_theta_rad")[-1]) < 1e-5
    half = peak(Feedforward(strength=0.5))
    assert 0.4 * unaided() < half < 0.6 * unaided()


def test_what_lanes_must_share_is_said():
    jobs = [job(quiet_bench("pquad"), soft()), job(quiet_bench("pquad"), soft("observer"))]
    with pytest.raises(InputError, match="must share rig, rates, delays"):
        PitchLoop(jobs, sampled(0.1), 0, [0, 1])


def test_an_edit_of_one_s_own_effect_is_noticed(tmp_path, monkeypatch):
    """What was compiled before an edit must not be taken for the new effect."""
    monkeypatch.syspath_prepend(str(tmp_path))
    found = []
    for stiffness in ("1.0", "2.0"):
        (tmp_path / "edited_effect.py").write_text(
            "from benchtool.physics.expression import expression\n\n\n@expression\n"
            f"def torque(p, i, flow):\n    return {stiffness} * p.k_Nm_per_rad\n",
            encoding="utf-8",
        )
        sys.modules.pop("edited_effect", None)
        importlib.invalidate_caches()
        module = importlib.import_module("edited_effect")
        found.append(source_key(module.torque))
    sys.modules.pop("edited_effect", None)
    assert found[0] != found[1]
