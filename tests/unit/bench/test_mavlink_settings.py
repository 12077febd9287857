from __future__ import annotations

from hashlib import sha256

import pytest

from benchtool.bench.drivers import MavlinkAddress
from benchtool.bench.mavlink.settings import (
    parse_settings,
    read_key,
)
from benchtool.core.errors import InputError


def test_listening_wider_than_this_computer_is_said_aloud():
    def warning(place: str) -> str:
        return parse_settings(MavlinkAddress.parse(f"mavlink:{place}")).warning

    assert warning("udpin:14550") == warning("udpin:localhost:14550") == ""
    assert warning("udpout:192.168.4.1:14550") == ""
    assert warning("udpin:0.0.0.0:14550").startswith("listening on 0.0.0.0: any computer")


def test_keys(tmp_path):
    path, key = tmp_path / "key", bytes(range(32))
    for data, read in (
        (key, key),
        (key.hex().encode() + b"\n", key),
        (b"correct horse\n", sha256(b"correct horse").digest()),
    ):
        path.write_bytes(data)
        assert read_key(path) == read
    path.write_text("\n")
    with pytest.raises(InputError, match="is empty"):
        read_key(path)
