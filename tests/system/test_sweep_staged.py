"""A sweep whose plate hangs on a G-code stage beside the bench, both on pseudo-terminals."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.system.served import run, serving

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals"),
    pytest.mark.real_time(deadline_s=0.1),
]
SMALL = ["--rig", "pquad_single", "--repeats", "1", "--z-over-r", "0.5,1", "--sample-s", "1"]


def test_a_stage_moves_the_plate_and_no_sample_is_lost(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    bench, stage, out = (tmp_path / name for name in ("bench", "stage", "run"))
    served = ["--rig", "pquad_single", "--speed", "20", "--symlink", str(bench), "--grbl"]
    with serving("pty", environment, *served, str(stage)) as address:
        words = ["sweep", address, *SMALL, "--yes", "--out", str(out)]
        unmoved = run(words, environment)
        assert unmoved.returncode == 2
        assert "this device does not move the plate; give --stage hand" in unmoved.stderr
        # Its address is another device's, as far as a bench is concerned.
        mistaken = run(["sweep", f"serial:{stage}", *words[2:]], environment)
        assert mistaken.returncode == 3
        assert "it is a G-code stage; give it as --stage grbl:" in mistaken.stderr
        moved = run([*words, "--stage", f"grbl:{stage}?zero_mm=1500"], environment)
        assert moved.returncode == 0, moved.stderr
    points = read_points(out)
    thrust_N, pulse = points.column("thrust_N"), points.column("pwm1_us") == 1590.0
    near, far = points.column("plate_z_m") < 0.07, points.column("plate_z_m") > 1.0
    # In ground effect at z/R = 0.5 thrust is a third above that far away, as on every bench.
    ratio = thrust_N[near & pulse].mean() / thrust_N[far & pulse].mean()
    assert ratio == pytest.approx(1.33, abs=0.02)
    # The plate of the bench's own world stands where the stage says.
    assert np.nanmin(read_samples(out).column("plate_z_m")) == pytest.approx(0.06, abs=1e-4)
    facts = Run.open(out).metadata
    assert facts["state"] == "ended"
    assert facts["link"]["lost"] == 0
