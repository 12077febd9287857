"""Rigs are read strictly, and every number of them has a source."""

from __future__ import annotations

import math

import pytest

from benchtool.acquire.inputs import BENCH_KEYS, resolve_rig
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.rig import Motor
from benchtool.core.rig_file import (
    load_rig_by_name,
    parse_rig,
    require_values,
    rig_names,
    rig_to_toml,
)
from benchtool.core.user_file import read_library_file
from tests.unit.physics.blades import MOTOR, bladed


@pytest.fixture
def text():
    return read_library_file("rig", "rigs", "pquad")[0]


@pytest.mark.parametrize("name", rig_names())
def test_a_shipped_rig_has_a_source_for_every_number(name):
    rig = load_rig_by_name(name)
    assert rig.name == name
    assert all(rig.sources.values())
    assert len(rig.sources) > 30
    assert set(rig.assumed) <= set(rig.sources)
    assert "propulsion.radius_m" not in rig.assumed


def test_the_numbers_of_the_paper():
    pquad, amuse = load_rig_by_name("pquad"), load_rig_by_name("amuse")
    assert (pquad.propulsion.radius_m, pquad.body.mass_kg, pquad.n_rotors) == (0.12, 1.4, 4)
    assert (amuse.propulsion.radius_m, amuse.body.mass_kg, amuse.n_rotors) == (0.205, 12.0, 8)
    assert (pquad.n_discs, amuse.n_discs) == (4, 4)
    assert pquad.disc_distances_m[0, 1] == pytest.approx(0.318, abs=5e-4)


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("mass_kg", "mas_kg", UnknownChoice, r"\[body\].*'mas_kg'; did you mean 'mass_kg'"),
        ("radius_m", "radius_cm", UnknownChoice, "did you mean 'radius_m'"),
        ("{ noise", "{ nois", UnknownChoice, "known: flicker, noise, quantum, rate_Hz"),
        ("value = 0.12,", "value = -0.12,", FileFormatError, "radius_m is -0.12: .*greater than 0"),
        ("lag_s = 0.05", 'lag_s = "0.05"', FileFormatError, "lag_s is .*valid number"),
        ("radius_m = { value", "lag_s = { value", FileFormatError, "TOML"),
        ("thrust_N = 45.0", "thrust_N = 60.0", FileFormatError, "60 N, above .* 50 N"),
        ("= 1.035e-5", "== 1", FileFormatError, "not valid TOML: .*line"),
        ("[limits]", '[motor]\nsource = "a"\nKv_rpm_V = 9\n[limits]', FileFormatError, "Kv_rpm_V"),
        ("[limits]", "[blade]\nsolidity = 0.1\n[limits]", FileFormatError, "solidity has no"),
        ('name = "pquad"', 'name = "pquad\\u202e"', InputError, "cannot name a rig in"),
        ('name = "pquad"', 'name = "the quad"', InputError, "'the quad' cannot name a rig"),
        ('[limits]\nsource = "', '[limits]\nsource = ["a"] # "', FileFormatError, "has no source"),
    ],
)
def test_what_is_wrong_is_said(text, old, new, error, words):
    assert old in text
    with pytest.raises(error, match=words):
        parse_rig(text.replace(old, new, 1), "pquad.toml")


@pytest.mark.parametrize("motor", [MOTOR, Motor(governed=True), None])
def test_blades_and_motors_are_read_back(motor):
    rig = bladed("pquad", motor)
    again = parse_rig(rig_to_toml(rig), "again.toml")
    assert (again.blade, again.motor) == (rig.blade, motor)


LEAST = """
name = "mine"

[propulsion]
radius_m = { value = 0.127, source = "ruler" }
"""


def test_a_rig_of_a_radius_alone_has_typical_numbers_that_say_so():
    rig = parse_rig(LEAST, "mine.toml")
    assert (rig.n_rotors, rig.propulsion.radius_m, rig.limits.current_A) == (1, 0.127, 1000.0)
    # T = C_T rho n^2 D^4 at 100 turns a second, by hand.
    thrust = 0.11 * 1.225 * 100.0**2 * 0.254**4
    k = rig.propulsion.thrust_coefficient_N_s2
    assert k * (2.0 * math.pi * 100.0) ** 2 == pytest.approx(thrust, rel=1e-12)
    assert set(rig.sources) - rig.not_stated == {"propulsion.radius_m"}
    assert rig.assumed == ()
    assert parse_rig(rig_to_toml(rig), "copy") == rig
    assert rig_to_toml(rig).count("value") == 1


def test_a_bench_needs_numbers_that_only_its_owner_knows(tmp_path):
    rig = parse_rig(LEAST, "mine.toml")
    with pytest.raises(InputError, match=r"does not state limits\.load_cell_rating_N, propulsion"):
        require_values(rig, BENCH_KEYS, "a bench")
    (path := tmp_path / "mine.toml").write_text(LEAST)
    with pytest.raises(InputError, match="which a bench needs; add it to the rig's file"):
        resolve_rig("tcp:127.0.0.1:1", str(path))
    assert resolve_rig(f"sim:{path}", None) == rig
    assert resolve_rig("tcp:127.0.0.1:1", "pquad_single").name == "pquad_single"


def test_a_rig_without_a_radius_is_refused():
    with pytest.raises(FileFormatError, match=r"propulsion\.radius_m is missing"):
        parse_rig('name = "mine"\n', "mine.toml")
