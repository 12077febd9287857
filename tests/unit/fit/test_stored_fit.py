"""What a folder keeps of a fit is told in the words and numbers of the fit itself."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchtool.core.errors import FileFormatError
from benchtool.fit.law_scores import LawComparison, LawScore
from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.report.fit.page import write_fit
from benchtool.report.fit.stored_fit import read_stored, stored

FITS = Path(__file__).parents[3] / "fits"


@pytest.fixture(scope="module")
def output() -> FitOutput:
    recipe = read_recipe(FITS / "quad")
    return run_recipe(replace(recipe, methods=("least_squares",), compare=("quad",)))


def test_a_comparison_of_laws_is_kept_with_what_was_not_scored(
    output: FitOutput, tmp_path: Path
) -> None:
    scores = (
        LawScore(law="rotor_images", verdict="best", behind=0.0, losses=(0.0, 0.0)),
        LawScore(law="hayden", verdict="refused", reason="rejected", one_with=("other",)),
    )
    laws = LawComparison(scores=scores, distances=(0.6, 2.0))
    write_fit(tmp_path / "fit", replace(output, laws=laws))
    assert "follows rotor_images; refused: hayden" in laws.sentence
    found = read_stored(tmp_path / "fit")
    assert found.blocks == stored(replace(output, laws=laws)).blocks
    assert found.laws is not None
    assert found.laws.scores[1].one_with == ("other",)
    assert laws.sentence in (tmp_path / "fit" / "report.html").read_text("utf-8")


def test_a_fit_of_an_older_version_is_read() -> None:
    found = read_stored(FITS / "quad")
    assert [result.method for result in found.results] == ["least_squares", "emcee"]
    assert found.simulated
    assert found.comparison is not None
    written = json.loads((FITS / "quad" / "result.json").read_text("utf-8"))
    stated = written["results"]["least_squares"]["estimates"]["R_m"]
    assert found.results[0]["R_m"].value == stated["value"]


def test_a_number_that_does_not_exist_is_none(tmp_path: Path) -> None:
    shutil.copytree(FITS / "quad", tmp_path / "fit")
    path = tmp_path / "fit" / "result.json"
    tables = json.loads(path.read_text("utf-8"))
    tables["results"]["least_squares"]["estimates"]["R_m"]["sd"] = None
    path.write_text(json.dumps(tables), "utf-8")
    found = read_stored(tmp_path / "fit").results[0]["R_m"]
    assert found.sd != found.sd


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"results": {}}, "no method has a result"),
        ({"results": {"least_squares": {}}}, "there is no 'order'"),
        ({"points": 3}, "no result of a fit"),
        ({"format": "x"}, "its format is 'x'"),
    ],
)
def test_a_broken_result_is_told_in_one_sentence(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    tables = json.loads((FITS / "quad" / "result.json").read_text("utf-8")) | change
    (tmp_path / "result.json").write_text(json.dumps(tables), "utf-8")
    with pytest.raises(FileFormatError, match=said):
        read_stored(tmp_path)
