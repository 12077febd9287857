"""A run played back: every sample once, in its own time, and no command taken."""

import numpy as np
import pytest

from benchtool.bench.drivers import open_bench

HEADER = "time_s,device_time_us,point,phase,pwm1_us,rpm1,thrust_N,thrust_raw,torque_Nm"


@pytest.fixture
def run(tmp_path):
    rows = [
        f"{10.0 + 0.005 * i:.6f},{5000 * i},1,sample,1500,{4000 + i},"
        f"{'' if i % 2 else 9.5},{'' if i % 2 else 9500},-0.01"
        for i in range(1, 401)
    ]
    (tmp_path / "samples.csv").write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    (tmp_path / "metadata.json").write_text('{"simulated": true, "device_id": "v-1"}')
    return tmp_path


def test_samples_come_back_in_their_own_time(run):
    with open_bench(f"replay:{run}") as bench:
        first, second = bench.read(0.1), bench.read(0.995)
    assert (len(first), len(second)) == (21, 199)
    assert first.time_s[0] == pytest.approx(10.005)
    assert second.time_s[0] == pytest.approx(first.time_s[-1] + 0.005)
    assert np.array_equal(first.values[:2, 1], [4001.0, 4002.0])
    assert np.isnan(first.values[0, 2])
    assert first.values[1, 2] == 9.5
