from __future__ import annotations

import os

import pytest

from benchtool.web.access import Access, host_name, is_loopback
from benchtool.web.serve import build_access, open_page

HERE = "127.0.0.1:8460"


def rejection_of(access, token="", reads_only=True, is_socket=False, **headers):
    names = {"site": "sec-fetch-site", "mode": "sec-fetch-mode"}
    headers = {names.get(name, name): value for name, value in headers.items()}
    return access.find_rejection(headers, token, reads_only=reads_only, is_socket=is_socket)


@pytest.mark.parametrize(
    "request_info",
    [
        {"host": HERE},
        {"host": "localhost:8460", "site": "none", "mode": "navigate"},
        {"host": "LOCALHOST"},
        {"host": "[::1]:8460"},
        {"host": HERE, "site": "cross-site", "mode": "navigate"},
        {"host": HERE, "origin": f"http://{HERE}", "reads_only": False, "is_socket": True},
        {"host": HERE, "origin": f"http://{HERE}", "reads_only": False},
        {"host": HERE, "site": "same-origin", "reads_only": False},
    ],
)
def test_the_page_itself_and_a_typed_address_are_let_in(request_info):
    assert rejection_of(Access(), **request_info) is None


@pytest.mark.parametrize(
    ("request_info", "why"),
    [
        ({"host": "evil.example:8460"}, "is not a name of this server"),
        ({"host": "127.0.0.1.evil.example"}, "is not a name of this server"),
        ({"host": ""}, "is not a name of this server"),
        ({"host": "user@127.0.0.1"}, "is not a name of this server"),
        ({"host": "[::1"}, "is not a name of this server"),
        ({"host": "[[::1]]:1"}, "is not a name of this server"),
        ({"host": HERE, "origin": "http://[::1", "is_socket": True}, "are not allowed"),
        ({"host": "192.168.1.5:8460"}, "is not a name of this server"),
        (
            {"host": HERE, "origin": "http://evil.example", "is_socket": True},
            "are not allowed",
        ),
        (
            {"host": HERE, "origin": "http://127.0.0.1:9999", "is_socket": True},
            "are not allowed",
        ),
        ({"host": HERE, "origin": "null", "is_socket": True}, "are not allowed"),
        ({"host": HERE, "origin": f"ftp://{HERE}", "is_socket": True}, "are not allowed"),
        ({"host": HERE, "is_socket": True, "reads_only": False}, "has no Origin header"),
        ({"host": HERE, "reads_only": False}, "has no Origin header"),
        ({"host": HERE, "site": "cross-site", "mode": "no-cors"}, "from other sites"),
        ({"host": HERE, "site": "same-site", "mode": "cors"}, "from other sites"),
    ],
)
def test_other_names_and_other_pages_are_refused(request_info, why):
    rejection = rejection_of(Access(), **request_info)
    assert rejection is not None
    assert why in rejection


def test_another_bind_wants_the_token_and_takes_numeric_addresses():
    access = build_access("0.0.0.0")
    assert access.token is not None
    assert len(access.token) >= 32
    host = "192.168.1.5:8460"
    for token in ("", "x", access.token[:-1], access.token + "x", "ü"):
        assert "token is missing or wrong" in str(rejection_of(access, token, host=host))
    assert rejection_of(access, access.token, host=host) is None
    rebound = rejection_of(access, access.token, host="evil.example")
    assert "is not a name of this server" in str(rebound)
    assert build_access("0.0.0.0").token != access.token


def test_loopback_needs_no_token_unless_asked_for():
    assert build_access("127.0.0.1").token is None
    assert build_access("127.0.0.1", requires_token=True).token is not None


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.8.0.3", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.5", False),
        ("bench.local", False),
    ],
)
def test_loopback_is_known(host, expected):
    assert is_loopback(host) is expected


PLAIN = "http://127.0.0.1:8460/"


@pytest.mark.skipif(os.name != "posix", reason="permissions of files are those of POSIX")
def test_a_token_stands_in_a_file_of_this_user_and_on_no_command_line(tmp_path):
    addresses: list[str] = []
    umask = os.umask(0)
    try:
        file = open_page(f"{PLAIN}?token=secret", tmp_path, addresses.append)
    finally:
        os.umask(umask)
    assert file is not None
    assert addresses == [file.as_uri()]
    assert "secret" not in addresses[0]
    assert file.stat().st_mode & 0o777 == 0o600
    assert f"url={PLAIN}?token=secret" in file.read_text("utf-8")


def test_a_host_header_is_taken_apart():
    assert host_name("Bench.Local:80") == "bench.local"
    assert host_name("[::1]:8460") == "::1"
    assert host_name("a b") == host_name("a/b") == host_name("") == ""
