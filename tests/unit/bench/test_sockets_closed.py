"""A socket that could not be made ready is closed, whatever failed on the way."""

from __future__ import annotations

import socket

import pytest

from benchtool.bench.transport.ports import BUFFER_BYTES, UdpSocket

TIMEOUT_S = 1.0


def _bound() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.settimeout(TIMEOUT_S)
    return opened


@pytest.fixture
def peer():
    with _bound() as opened:
        yield opened


def test_a_stranger_on_the_same_host_is_not_heard(peer):
    link = UdpSocket("127.0.0.1", peer.getsockname()[1], listen=False)
    link.open()
    try:
        link.write(b"hello")
        said, ours = peer.recvfrom(64)
        assert said == b"hello"
        with _bound() as stranger:
            stranger.sendto(b"from a stranger", ours)
            peer.sendto(b"from the peer", ours)
            assert link.read(TIMEOUT_S) == b"from the peer"
            stranger.sendto(b"again", ours)
            assert link.read(0.05) == b""
    finally:
        link.close()


def test_a_flood_does_not_hold_the_reader(monkeypatch):
    class Flood:
        def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
            return b"x" * 1000, ("127.0.0.1", 9)

    link = UdpSocket("127.0.0.1", 9, listen=True)
    monkeypatch.setattr(link, "_socket", Flood())
    assert BUFFER_BYTES <= len(link.read(TIMEOUT_S)) + 2000 < 2 * BUFFER_BYTES
