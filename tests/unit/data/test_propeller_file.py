"""Propellers by name, size and file; the user's own library."""

from __future__ import annotations

import shutil

import pytest

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.rig_file import load_rig_by_name, rig_to_toml
from benchtool.core.user_file import LIBRARY, user_library_folder
from benchtool.data.propeller_file import load_propeller, propeller_names, read_propeller


@pytest.mark.parametrize("name", sorted(path.stem for path in (LIBRARY / "propellers").iterdir()))
def test_every_shipped_propeller_reads_and_each_number_has_a_source(name):
    propeller, sources = read_propeller(name)
    assert propeller.name == name
    assert {"diameter_m", "pitch_m", "blades"} <= set(sources)
    assert all(len(source) > 10 for source in sources.values())


def test_chords_are_those_of_the_maker_s_stations_at_three_quarters_of_the_radius():
    # 1.0446 in at 3.6440 in and 1.0118 in at 3.7627 in of the 10x7SF: 1.01531 in at 3.75 in.
    by_hand = (1.0446 - (3.75 - 3.6440) / (3.7627 - 3.6440) * (1.0446 - 1.0118)) * 0.0254
    assert load_propeller("apc_10x7sf").chord_m == pytest.approx(by_hand, rel=2e-4)


def test_a_size_is_diameter_pitch_and_blades_in_inches():
    propeller = load_propeller("10x4.5x3")
    assert propeller.diameter_m == pytest.approx(0.254)
    assert propeller.pitch_m == pytest.approx(0.1143)
    assert (propeller.blades, load_propeller("5x4").blades) == (3, None)
    assert propeller.chord_m is None


@pytest.fixture
def library(tmp_path, monkeypatch):
    """Give an empty library of the user's own."""
    monkeypatch.setenv("BENCHTOOL_LIBRARY", str(tmp_path))
    for kind in ("propellers", "rigs"):
        (tmp_path / kind).mkdir()
    assert user_library_folder() == tmp_path
    return tmp_path


def test_a_file_in_the_user_s_library_is_known_by_its_name(library):
    text = 'name = "mine"\nsource = "ruler"\ndiameter_m = 0.2\n'
    (library / "propellers" / "mine.toml").write_text(text)
    assert load_propeller("mine").diameter_m == 0.2
    assert "mine" in propeller_names()
    (library / "rigs" / "my_rig.toml").write_text(rig_to_toml(load_rig_by_name("pquad_single")))
    assert load_rig_by_name("my_rig").name == "pquad_single"
    with pytest.raises(UnknownChoice, match="my_rig"):
        load_rig_by_name("other_rig")


def test_a_number_without_a_source_is_refused(library):
    (library / "propellers" / "bare.toml").write_text('name = "bare"\ndiameter_m = 0.2\n')
    with pytest.raises(FileFormatError, match="diameter_m has no source"):
        load_propeller("bare")


@pytest.mark.parametrize("text", ["0x4", "5x4x0", "5x4x21"])
def test_a_size_that_no_propeller_has_is_refused(text):
    with pytest.raises(InputError, match=f"propeller size {text}"):
        load_propeller(text)


def test_a_file_of_one_s_own_by_a_shipped_name_is_refused(library):
    shutil.copy(LIBRARY / "propellers" / "apc_10x7sf.toml", library / "propellers")
    with pytest.raises(FileFormatError, match="rename your file"):
        load_propeller("apc_10x7sf")
    (library / "rigs" / "pquad.toml").write_text(rig_to_toml(load_rig_by_name("beam")))
    with pytest.raises(FileFormatError, match="rename your file"):
        load_rig_by_name("pquad")
