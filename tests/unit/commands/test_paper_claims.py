"""The claims: what comes out, what does not, what cannot be told; and every figure."""

from __future__ import annotations

import csv
import io

import pytest

from benchtool.commands.paper import sensitivity as paper_claims_sensitivity
from benchtool.commands.paper.bench import bench_claims
from benchtool.commands.paper.claims import (
    CONSTRUCTED,
    FAILS,
    HOLDS,
    UNCLEAR,
    VERDICTS,
    Claim,
    Flights,
    claim_csv,
    claim_lines,
)
from benchtool.commands.paper.flight import flight_claims
from benchtool.commands.paper.sensitivity import CHANGES, sensitivity_claims
from benchtool.report.page import FigureBlock
from benchtool.report.paper.page import paper_figures
from benchtool.report.style import SIMULATED_GID


@pytest.fixture(scope="module")
def flights() -> Flights:
    return Flights()


def verdicts(claims: list[Claim]) -> dict[str, str]:
    return {claim.says[:40]: claim.verdict for claim in claims}


def test_flight_claims_and_their_honest_negatives(flights: Flights) -> None:
    claims = flight_claims(flights)
    assert len(claims) == 16
    said = {claim.says: claim for claim in claims}
    unusual = {claim.says[:20]: claim.verdict for claim in claims if claim.verdict != HOLDS}
    assert unusual == {
        "(the same, of any PI": FAILS,  # a stiff set crosses
        "noise of the gyro am": UNCLEAR,
        "feedforward with a m": CONSTRUCTED,
    }
    noise = next(claim for words, claim in said.items() if words.startswith("noise"))
    assert "no amplification to be seen" in noise.found
    early = next(claim for words, claim in said.items() if words.startswith("a map 15 cm"))
    assert early.found.startswith("strikes the obstacle")
    assert {claim.gains for claim in claims} == {"s3", "s1a", "stiff"}


def test_bench_and_attitude_claims() -> None:
    claims = bench_claims()
    assert [claim.verdict for claim in claims].count(UNCLEAR) == 2
    inconsistent = next(claim for claim in claims if claim.where == "2.4 against 3")
    assert inconsistent.verdict == FAILS
    assert "66 mN m" in inconsistent.found
    assert "15.5 with rotors only" in inconsistent.found
    rest = [c for c in claims if c.verdict != UNCLEAR and c is not inconsistent]
    assert {claim.verdict for claim in rest} == {HOLDS}


def test_what_the_claims_depend_on(flights: Flights, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = [change for change in CHANGES if change.name in SOME]
    monkeypatch.setattr(paper_claims_sensitivity, "CHANGES", tuple(kept))
    monkeypatch.setattr(paper_claims_sensitivity, "SETS", 1)
    claims = sensitivity_claims(flights)
    assert len(claims) == len(SOME) + 3
    assert {claim.by for claim in claims} == {"study"}
    changed = {claim.says.split(":")[0]: claim for claim in claims}
    assert {changed[name].verdict for name in SOME} == {HOLDS}
    assert "PID crosses in" in changed["attitude loop stiffer x2"].found
    assert "never crosses" in changed["K_b = 2.5"].found


SOME = ("attitude loop stiffer x2", "body term out of the rotors (eq. 3)", "K_b = 2.5")


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


@pytest.mark.slow
def test_every_figure_is_there_and_says_when_it_is_simulated(flights: Flights) -> None:
    drawn: dict[str, FigureBlock] = dict(paper_figures(flights))
    numbers = {name[3:5] for name in drawn if name.startswith("fig")}
    wanted = "03 04 05 06 07 08 09 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 26 27 28 29 30"
    assert numbers == set(wanted.split())
    assert {name for name in drawn if name.startswith("extra")} == {
        "extra-oblique", "extra-corner", "extra-gust", "extra-ramp",
    }  # fmt: skip
    for name, block in drawn.items():
        stamped = any(text.get_gid() == SIMULATED_GID for text in block.figure.texts)
        from_formulae = name[3:5] in {"03", "04", "06", "07", "08", "10", "11", "16", "19", "29"}
        assert stamped is not from_formulae, name
