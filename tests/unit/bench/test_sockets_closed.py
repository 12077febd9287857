"""A socket that could not be made ready is closed, whatever failed on the way."""

from __future__ import annotations

import gc
import socket
import warnings
from collections.abc import Callable, Iterator

import pytest

from benchtool.bench.transport.sockets import BUFFER_BYTES, TcpSocket, UdpSocket
from benchtool.core.errors import InputError, LinkError
from benchtool.virtual.links import TcpLink, UdpLink

NAME_TOO_LONG = "x" * 70  # a label of a host's name has at most 63 letters: UnicodeError


def left_open(action: Callable[[], object]) -> list[str]:
    """Run what must fail with one of our errors; return the sockets that nobody closed."""
    failed = False
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            action()
        except (LinkError, InputError):
            failed = True
        gc.collect()
    assert failed
    return [str(item.message) for item in seen if item.category is ResourceWarning]


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield server


def broken(*_: object) -> None:
    raise OSError(22, "Invalid argument")


def test_the_check_sees_a_socket_that_is_left_open() -> None:
    def leaks() -> None:
        opened = socket.socket()
        assert opened
        raise InputError("left")

    assert len(left_open(leaks)) == 1


@pytest.mark.parametrize("fails", ["setsockopt", "setblocking"])
def test_tcp_and_udp_ends_of_a_driver(
    fails: str, listener: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = listener.getsockname()[1]
    monkeypatch.setattr(socket.socket, fails, broken)
    assert left_open(TcpSocket("127.0.0.1", port).open) == []
    assert left_open(UdpSocket("127.0.0.1", 0, listen=True).open) == []


@pytest.mark.parametrize("fails", ["bind", "listen", "setblocking"])
def test_tcp_and_udp_links_of_a_server(fails: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket.socket, fails, broken)
    assert left_open(lambda: TcpLink("127.0.0.1", 0)) == []
    if fails != "listen":
        assert left_open(lambda: UdpLink("127.0.0.1", 0, listen=True)) == []


def test_a_host_name_that_is_none() -> None:
    assert left_open(TcpSocket(NAME_TOO_LONG, 5000).open) == []
    assert left_open(UdpSocket(NAME_TOO_LONG, 5000, listen=False).open) == []
    assert left_open(lambda: TcpLink(NAME_TOO_LONG, 5000)) == []
    assert left_open(lambda: UdpLink(NAME_TOO_LONG, 5000, listen=False)) == []


def test_a_client_that_left_at_once_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    link = TcpLink("127.0.0.1", 0)
    port = int(link.address.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)):
        with warnings.catch_warnings(record=True) as seen, monkeypatch.context() as patch:
            warnings.simplefilter("always")
            patch.setattr(socket.socket, "setblocking", broken)
            for _ in range(20):
                assert link.read() == b""
            gc.collect()
        assert [str(item.message) for item in seen] == []
    link.close()


TIMEOUT_S = 1.0


def _bound() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.settimeout(TIMEOUT_S)
    return opened


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with _bound() as opened:
        yield opened


def test_a_stranger_on_the_same_host_is_not_heard(peer: socket.socket) -> None:
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


def test_a_flood_does_not_hold_the_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    class Flood:
        def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
            return b"x" * 1000, ("127.0.0.1", 9)

    link = UdpSocket("127.0.0.1", 9, listen=True)
    monkeypatch.setattr(link, "_socket", Flood())
    assert BUFFER_BYTES <= len(link.read(TIMEOUT_S)) + 2000 < 2 * BUFFER_BYTES
