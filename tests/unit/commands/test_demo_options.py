"""What `benchtool demo` takes, without running it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands.app import main
from benchtool.commands.demo import free_folder
from benchtool.virtual.devices import LARGEST_SPEED


def test_a_second_demo_goes_into_a_folder_of_its_own(tmp_path: Path) -> None:
    first = tmp_path / "benchtool-demo"
    assert free_folder(first) == first
    first.mkdir()
    assert free_folder(first) == tmp_path / "benchtool-demo-2"
    (tmp_path / "benchtool-demo-2").mkdir()
    assert free_folder(first) == tmp_path / "benchtool-demo-3"


def test_the_greatest_speed_is_that_of_the_virtual_bench(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["demo", "--speed", f"{LARGEST_SPEED + 1.0:g}"])
    assert left.value.code == 2
    assert f"allowed is 1 to {LARGEST_SPEED:,g};" in capsys.readouterr().err
