"""What a folder keeps of a fit is told in the words and numbers of the fit itself."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.core.errors import FileFormatError
from benchtool.fit.result_file import read_fit

FITS = Path(__file__).parents[3] / "fits"


def test_a_number_that_does_not_exist_is_none(tmp_path):
    shutil.copytree(FITS / "quad", tmp_path / "fit")
    path = tmp_path / "fit" / "result.json"
    tables = json.loads(path.read_text("utf-8"))
    tables["results"]["least_squares"]["estimates"]["R_m"]["sd"] = None
    path.write_text(json.dumps(tables), "utf-8")
    found = read_fit(tmp_path / "fit").results[0]["R_m"]
    assert found.sd != found.sd


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"results": {}}, "results are empty"),
        ({"results": {"least_squares": {}}}, "key 'order' is missing"),
        ({"points": 3}, "invalid fit result"),
        ({"format": "x"}, "format 'x' is not supported"),
    ],
)
def test_a_broken_result_is_told_in_one_sentence(tmp_path, change, said):
    tables = json.loads((FITS / "quad" / "result.json").read_text("utf-8")) | change
    (tmp_path / "result.json").write_text(json.dumps(tables), "utf-8")
    with pytest.raises(FileFormatError, match=said):
        read_fit(tmp_path)
