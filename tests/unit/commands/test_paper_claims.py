"""The claims: what comes out, what does not, what cannot be told; and every figure."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from benchtool.commands import paper_claims as module
from benchtool.commands.paper_claims import (
    COMES_OUT,
    CONSTRUCTED,
    FAILS,
    HOLDS,
    UNCLEAR,
    VERDICTS,
    Claim,
    Flights,
    claim_csv,
    claim_lines,
    paper_claims,
    sensitivity_claims,
)
from benchtool.report.figure import drawn
from benchtool.report.page import FigureBlock
from benchtool.report.paper.flights import paper_figures
from benchtool.report.paper.layouts import fits_of
from benchtool.report.style import SIMULATED_GID

FITS = Path(__file__).parents[3] / "fits"


@pytest.fixture(scope="module")
def flights() -> Flights:
    return Flights()


def test_claims_and_their_honest_negatives(flights: Flights) -> None:
    claims = paper_claims(flights)
    assert len(claims) == len(COMES_OUT) == 25
    unusual = {claim.says[:20]: claim.verdict for claim in claims if claim.verdict != HOLDS}
    assert unusual == {
        "(the same, of any PI": FAILS,  # a stiff set crosses
        "noise of the gyro am": UNCLEAR,
        "feedforward with a m": CONSTRUCTED,
        "PQUAD and AMUSE beha": UNCLEAR,
        "(which of the two is": UNCLEAR,
    }
    found = {claim.says[:20]: claim.found for claim in claims}
    assert "no amplification to be seen" in found["noise of the gyro am"]
    assert found["a map 15 cm early is"].startswith("strikes the obstacle")
    assert "9.5 mN m at 5 deg, 19.2 at 10 deg" in found["(compared with the p"]
    assert "15.7 with rotors only, 14.4 projected" in found["(compared with the p"]
    assert "T = m g/4" in found["(compared with the p"]
    assert "one rotor wholly covered gives 12.3, three 82" in found["(compared with the p"]
    assert "friction holds the hinge" in found["feedforward holds th"]
    assert "alone leaves -0.17 deg" in found["feedforward holds th"]
    gains = {"s3", "s1a", "stiff", "none", "s3, s3 + slow integral"}
    assert {claim.gains for claim in claims} == gains


def test_what_the_claims_depend_on(flights: Flights, monkeypatch: pytest.MonkeyPatch) -> None:
    changes = [change for change in module._texts()["change"] if change["name"] in SOME]
    monkeypatch.setattr(module, "_texts", lambda: {"change": changes})
    monkeypatch.setattr(module, "SETS", 1)
    claims = sensitivity_claims(flights)
    assert len(claims) == len(SOME) + 1
    assert {claim.by for claim in claims} == {"study"}
    changed = {claim.says.split(":")[0]: claim for claim in claims}
    assert {changed[name].verdict for name in SOME} == {HOLDS}
    assert "PID crosses in" in changed["attitude loop stiffer x2"].found
    assert "never crosses" in changed["K_b = 2.5"].found


SOME = (
    *("attitude loop stiffer x2", "body term out of the rotors (eq. 3)", "K_b = 2.5"),
    "arm 0.2 m",
)


def test_the_table_as_text_and_as_csv() -> None:
    claim = Claim(where="3.2", says="it flies", found="it does, " * 30, gains="s3", verdict=HOLDS)
    lines = list(claim_lines([claim]))
    assert lines[0].startswith(" 1  COMES OUT")
    assert max(map(len, lines)) <= 110
    assert lines[-1] == (
        "1 row: 1 comes out, 0 does not come out, 0 not distinguishable, 0 by construction"
    )
    rows = list(csv.reader(io.StringIO(claim_csv([claim]))))
    assert rows[1] == ["3.2", "paper", "it flies", claim.found, "s3", HOLDS]
    assert len(VERDICTS) == 4


def test_points_of_runs_are_drawn_over_the_model_curves() -> None:
    fits = fits_of(
        {"single": FITS / "single_rotor", "second": None, "three": FITS / "three_rotors"}
    )
    for name, curves, series in (("fig03-single-rotor", 1, 1), ("fig08-three-rotors", 3, 1)):
        shown = drawn("paper", Flights(fits=fits), [name])[name].figure
        (axes,) = shown.axes
        assert len(axes.containers) == series
        assert sum(line.get_linestyle() != "None" and len(line.get_xdata()) > 100
                   for line in axes.lines) == curves  # fmt: skip
        assert any(text.get_gid() == SIMULATED_GID for text in shown.texts)
    bare = drawn("paper", Flights(), ["fig03-single-rotor"])["fig03-single-rotor"].figure
    assert bare.axes[0].containers == []
    assert all(text.get_gid() != SIMULATED_GID for text in bare.texts)


def test_the_plate_in_flight_has_its_reference(flights: Flights) -> None:
    shown = drawn("paper", flights, ["fig30-plate-in-flight"])["fig30-plate-in-flight"].figure
    wanted = [
        next(line for line in axes.lines if line.get_label() == "wanted") for axes in shown.axes
    ]
    widths = [np.ptp(np.asarray(line.get_ydata(), float)) for line in wanted]
    assert widths[0] > 1.0
    assert widths[2:] == [0.0, 0.0]
    assert "dry friction" in shown.axes[-1].get_xlabel()


@pytest.mark.slow
def test_every_figure_is_there_and_says_when_it_is_simulated(flights: Flights) -> None:
    shown: dict[str, FigureBlock] = dict(paper_figures(flights))
    numbers = {name[3:5] for name in shown if name.startswith("fig")}
    wanted = "03 04 05 06 07 08 09 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 26 27 28 29 30"
    assert numbers == set(wanted.split())
    assert {name for name in shown if name.startswith("extra")} == {
        "extra-oblique", "extra-corner", "extra-gust", "extra-ramp",
    }  # fmt: skip
    for name, block in shown.items():
        stamped = any(text.get_gid() == SIMULATED_GID for text in block.figure.texts)
        from_formulae = name[3:5] in {"03", "04", "06", "07", "08", "10", "11", "16", "19", "29"}
        assert stamped is not from_formulae, name
