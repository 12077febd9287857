"""The paper's figures and claims, redrawn by the scripts of docs/examples/paper on `benchtool`."""

from __future__ import annotations

import ast

import numpy as np
import pytest
from matplotlib.figure import Figure

import benchtool as bt
from tests.docs.examples import EXAMPLES, paper_script

pytestmark = pytest.mark.slow
FORMULAE = {"07", "10", "11", "16", "19", "29"}


def test_the_scripts_use_the_public_interface_only():
    scripts = sorted((EXAMPLES / "paper").rglob("*.py"))
    imported = {
        node.module if isinstance(node, ast.ImportFrom) else alias.name
        for script in scripts
        for node in ast.walk(ast.parse(script.read_text("utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert {name for name in imported if str(name).startswith("benchtool")} == {"benchtool"}


def test_claims_and_their_page():
    claims = paper_script("claims")
    of_paper, of_changes = claims.paper_claims(), claims.sensitivity_claims()
    assert len(of_paper) == 25
    unusual = {
        claim.says[:20]: claim.verdict for claim in of_paper if claim.verdict != claims.HOLDS
    }
    assert unusual == {
        "(the same, of any PI": claims.FAILS,  # a stiff set crosses
        "noise of the gyro am": claims.UNCLEAR,
        "feedforward with a m": claims.CONSTRUCTED,
        "PQUAD and AMUSE beha": claims.UNCLEAR,
        "(which of the two is": claims.UNCLEAR,
    }
    assert len(of_changes) == 22
    assert {claim.verdict for claim in of_changes} == {claims.HOLDS}
    page = claims.PAGE.read_text("utf-8")
    tables = claims.table(of_paper), claims.table(of_changes)
    assert page == claims.with_tables(page, tables), (
        "run: python docs/examples/paper/claims.py --write"
    )


def test_every_figure_is_drawn_and_says_when_it_is_simulated():
    figures = paper_script("figures").FIGURES
    numbers = {name[3:5] for name in figures if name.startswith("fig")}
    assert numbers == {f"{number:02}" for number in range(3, 31)} - {"25"}
    for name, draw in figures.items():
        with bt.figure_style():
            figure: Figure = draw()
        stamped = any(text.get_gid() == "simulated-stamp" for text in figure.texts)
        assert stamped is (name[3:5] not in FORMULAE), name
        assert figure.get_suptitle()
        if name == "fig30-plate-in-flight":
            wanted = [axes.lines[0].get_ydata() for axes in figure.axes]
            assert np.ptp(np.asarray(wanted[0], float)) > 1.0
            assert np.ptp(np.asarray(wanted[2], float)) == 0.0


def test_the_picture_of_the_documentation_is_that_of_the_script(tmp_path):
    name = "fig06-body-lift"
    paper_script("look").save({name: paper_script("ratios").FIGURES[name]}, tmp_path)
    assert (tmp_path / f"{name}.svg").read_bytes().startswith(b"<?xml")
    assert (EXAMPLES.parent / "assets" / f"{name}.svg").is_file()


def test_the_sources_show_no_fountain_and_the_rings_do():
    wake = paper_script("wake")
    heights = np.array([0.25, 0.5, 1.0, 1.5, 1.75, 2.0])
    sources, rings = wake.centre_line(heights).values()
    np.testing.assert_allclose(sources, [-0.014, -0.026, -0.037, -0.013, 0.014, 0.046], atol=6e-4)
    prototype = [0.22, 0.37, 0.46, 0.43, 0.37, 0.28]  # another prescribed wake of the same kind
    np.testing.assert_allclose(rings, prototype, atol=0.08)
    below_a_rotor = np.array([[1.325], [1.325], [1.0]])
    assert -1.4 < wake.vortex_velocity(below_a_rotor)[2, 0] < -1.0
