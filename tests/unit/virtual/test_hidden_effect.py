"""A virtual pitch bench has what its address hides, and refuses what no effect knows."""

from __future__ import annotations

import pytest

from benchtool.bench.drivers import open_bench
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import EXAMPLE, pitch_plant, with_hidden


def test_numbers_are_changed_and_effects_added() -> None:
    model = load_model("pitch_beam").model
    hides = with_hidden(model, f"{EXAMPLE},gyro_bias.bias_rad_s:-0.02")
    assert hides.parameters["coulomb_friction.torque_Nm"].value == 0.012
    assert hides.parameters["gyro_bias.bias_rad_s"].value == -0.02
    assert "gyro_bias.bias_rad_s" not in model.parameters


def test_the_plant_of_a_device_has_it() -> None:
    plant = pitch_plant(rig_named("beam"), gains="stiff", hidden=EXAMPLE)
    assert plant.job.bench.model.parameters["coulomb_friction.torque_Nm"].value == 0.012


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("coulomb.torque_Nm:1", "unknown effect 'coulomb'"),
        ("coulomb_friction.torque:1", "unknown parameter of effect 'coulomb_friction' 'torque'"),
        ("coulomb_friction.torque_Nm", "ends in no number; write for example"),
        ("coulomb_friction.torque_Nm:-1", "outside its bounds"),
    ],
)
def test_what_cannot_be_hidden_is_refused(text: str, said: str) -> None:
    with pytest.raises(BenchtoolError, match=said):
        open_bench(f"sim:beam?mode=pitch&hidden={text}")


def test_a_thrust_bench_hides_nothing() -> None:
    with pytest.raises(InputError, match="is for mode=pitch"):
        open_bench(f"sim:pquad?hidden={EXAMPLE}")
