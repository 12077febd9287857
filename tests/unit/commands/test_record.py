"""`benchtool record --dry-run`: what the address names is looked up, and nothing is opened."""

from __future__ import annotations

import pytest

from benchtool.commands.app import main

DRY = ("--rig", "pquad", "--dry-run")


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("sim:pquad?mode=pitch&schedule=zz", "unknown schedule (and no file of that name) 'zz'"),
        ("sim:pquad?mode=pitch&controller=pdi", "did you mean 'pid'"),
        ("sim:pquad?mode=pitch&gains=s4", "'s4'"),
        ("tcp:here", "needs host and port"),
    ],
)
def test_a_dry_run_refuses_an_address_that_no_bench_answers(
    address: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["record", address, *DRY])
    assert left.value.code == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("address", ["sim:pquad?mode=pitch&schedule=steps", "serial:/dev/none"])
def test_a_dry_run_opens_nothing(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["record", address, *DRY])
    assert left.value.code == 0
    assert "nothing was opened, nothing spins" in capsys.readouterr().out
