"""The exported OpenFOAM case, meshed and run for a few iterations where OpenFOAM is installed."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchtool.library import rig_named
from benchtool.studies.flow_case import FlowCase, write_case

pytestmark = pytest.mark.skipif(
    shutil.which("simpleFoam") is None, reason="OpenFOAM is not installed (no simpleFoam)"
)

CASE = FlowCase.of_rig(rig_named("pquad"), 2.0, cells_per_radius=3, iterations=40)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Give the folder of a case that has run, and what the programs said."""
    folder = tmp_path_factory.mktemp("flow") / "case"
    write_case(folder, CASE)
    done = subprocess.run(
        [str(folder / "Allrun")], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-2000:]
    return folder, done.stdout + done.stderr


def test_it_meshes_and_runs_without_a_warning(ran: tuple[Path, str]) -> None:
    _, said = ran
    assert "FOAM Warning" not in said
    assert "FOAM FATAL" not in said
    assert said.count("\nTime = ") >= CASE.iterations
    disc = re.search(r"cellZoneSet disc now size (\d+)", said)
    kept = re.search(r"Subset (\d+) of (\d+) cells", said)
    assert disc is not None
    assert int(disc.group(1)) > 20
    assert kept is not None
    assert int(kept.group(1)) < int(kept.group(2))  # the body has been cut out


def test_air_sinks_through_the_disc_and_rises_between_the_rotors(ran: tuple[Path, str]) -> None:
    folder, _ = ran
    table = np.loadtxt(folder / f"postProcessing/centreLine/{CASE.iterations}/centre_U.xy")
    # 81 points up to the rotors' height, but those inside the body, which is solid.
    assert 60 < len(table) < 81
    assert table[-1, 0] < CASE.height_m - 0.12 * CASE.radius_m
    upward = table[:, 3] / CASE.velocity_m_s
    assert 0.1 < upward.max() < 1.2  # a fountain; no faster than the air that feeds it
    text = (folder / str(CASE.iterations) / "U").read_text("ascii")
    field = text.split("boundaryField")[0]
    sinking = [float(v) for v in re.findall(r"^\(\S+ \S+ (\S+)\)$", field, re.MULTILINE)]
    assert min(sinking) == pytest.approx(-CASE.velocity_m_s, rel=0.25)
    # The disc's cells; the pressure's correction moves them a little from what is prescribed.
    assert np.isclose(sinking, -CASE.velocity_m_s, rtol=0.1).sum() > 20
