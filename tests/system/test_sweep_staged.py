"""A sweep whose plate hangs on a G-code stage beside the bench, both on pseudo-terminals."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import ServerOptions, virtual_server
from benchtool.virtual.links import PtyLink
from benchtool.virtual.server import DeviceLink
from tests.doubles.grbl import CarriedPlate, stage_option
from tests.system.served import run

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals"),
    pytest.mark.real_time(deadline_s=0.1),
]
SMALL = ["--rig", "pquad_single", "--repeats", "1", "--z-over-r", "0.5,1", "--sample-s", "1"]


@contextmanager
def serving_staged(bench: Path, stage: Path) -> Iterator[str]:
    """Serve a bench whose plate hangs on a stage; give the `--stage` of a host."""
    rig = load_rig_by_name("pquad_single")
    links = PtyLink(bench), PtyLink(stage)
    options = ServerOptions(
        speed=10.0,
        protocol=lambda firmware: CarriedPlate(DeviceLink(firmware), firmware, links[1], rig.plate),
    )
    server = virtual_server(rig, load_model("single", rig).model, links[0], options)
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(lambda: not ended.is_set(),))
    thread.start()
    try:
        yield stage_option(str(stage), rig.plate)
    finally:
        ended.set()
        thread.join()
        for link in links:
            link.close()


def test_a_stage_moves_the_plate_and_no_sample_is_lost(tmp_path, environment):
    bench, stage, out = (tmp_path / name for name in ("bench", "stage", "run"))
    with serving_staged(bench, stage) as option:
        words = ["sweep", f"serial:{bench}", *SMALL, "--yes", "--out", str(out)]
        unmoved = run(words, environment)
        assert unmoved.returncode == 2
        assert "this device does not move the plate; give --stage hand" in unmoved.stderr
        # Its address is another device's, as far as a bench is concerned.
        mistaken = run(["sweep", f"serial:{stage}", *words[2:]], environment)
        assert mistaken.returncode == 3
        assert "it is a G-code stage; use --stage grbl:" in mistaken.stderr
        moved = run([*words, "--stage", option], environment)
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
