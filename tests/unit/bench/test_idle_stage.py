"""A stage of its own moves only when the bench says that it may."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import IdleStage
from benchtool.core.errors import StageError
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.simulated import SimulatedBench
from tests.unit.bench.test_one_sided_stage import Listed, pause


def test_it_stays_above_idle_and_inside_the_gap() -> None:
    rig = rig_named("pquad")
    bare = SimulatedBench("sim:pquad", rig, load_model("quad_body_lift").model)
    inner = Listed()
    with GuardedBench(bare, rig) as bench:
        stage = IdleStage(inner, bench)
        bare.move_plate(0.3)
        assert stage.move(0.3, 0.0, 0.0, pause) == 0.3
        with pytest.raises(StageError, match=r"outside 0\.05 to 1\.5 m"):
            stage.move(0.04, 0.0, 0.0, pause)
        with pytest.raises(StageError, match=r"sideways to 1 m, limit 0\.945 m"):
            stage.move(0.3, 1.0, 0.0, pause)
        bench.set_pwm(np.full(4, 1500.0))
        with pytest.raises(StageError, match="above idle"):
            stage.move(0.3, 0.0, 0.0, pause)
    assert inner.sent == [0.3]
