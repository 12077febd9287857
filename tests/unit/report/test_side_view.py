"""The side view: what the page moves is there, and words are escaped."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest

from benchtool.report.side_view import Scene, Surface, side_view_svg

PLATE = Surface(outline_m=((0.1, -0.2), (0.4, -0.2), (0.4, -0.21)), name="a <b>", moves=True)
GROUND = Surface(outline_m=((0.0, -0.3), (9.0, -0.3), (9.0, -0.4)))
PLUS = ((0.2, 0.0), (0.0, 0.2), (-0.2, 0.0), (0.0, -0.2))
SCENE = Scene(title='"quad"', rotors_m=PLUS, radius_m=0.1, surfaces=(PLATE, GROUND), hinged=True)


def drawn(scene: Scene) -> ET.Element:
    return ET.fromstring(side_view_svg(scene))


def of_class(root: ET.Element, name: str) -> list[ET.Element]:
    return [item for item in root.iter() if item.get("class") == name]


def test_every_part_that_moves_can_be_found() -> None:
    root = drawn(SCENE)
    rotors = of_class(root, "rotor")
    assert sorted(rotor.get("data-rotor") for rotor in rotors) == ["0", "1", "2", "3"]
    for rotor in rotors:
        parts = [item.get("class") for item in rotor]
        assert sorted(filter(None, parts)) == ["added", "own", "tip"]
    assert len(of_class(root, "vehicle")) == len(of_class(root, "world")) == 1
    assert len(of_class(root, "moving")) == 1


def test_words_are_escaped() -> None:
    root = drawn(SCENE)
    assert root.get("aria-label") == '"quad"'
    assert [item.text for item in root.iter("text")] == ["a <b>"]


def test_the_picture_shows_what_the_scene_asks_for() -> None:
    root = drawn(replace(SCENE, width_m=2.0, top_m=0.5, bottom_m=-0.25))
    assert root.get("viewBox") == "-1 -0.5 2 0.75"
    assert float(root.get("data-arrow", "")) == pytest.approx(0.3)


def test_arrows_of_one_disc_stand_side_by_side() -> None:
    root = drawn(replace(SCENE, rotors_m=((0.2, 0.0), (-0.2, 0.0), (0.2, 0.0))))
    places = {rotor.get("data-rotor"): rotor.get("transform") for rotor in of_class(root, "rotor")}
    assert len(set(places.values())) == 3


def test_a_ruler_counts_metres() -> None:
    root = drawn(replace(SCENE, surfaces=(), ruler_m=(-0.6, 2.2)))
    assert [item.text for item in root.iter("text")] == ["0 m", "1 m", "2 m"]
