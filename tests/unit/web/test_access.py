from __future__ import annotations

import os

import pytest

from benchtool.web.access import Access, RequestFacts, host_name, is_loopback
from benchtool.web.serve import access_for, open_page

HERE = "127.0.0.1:8460"


@pytest.mark.parametrize(
    "facts",
    [
        RequestFacts(host=HERE),
        RequestFacts(host="localhost:8460", site="none", mode="navigate"),
        RequestFacts(host="LOCALHOST"),
        RequestFacts(host="[::1]:8460"),
        RequestFacts(host=HERE, site="cross-site", mode="navigate"),
        RequestFacts(host=HERE, origin=f"http://{HERE}", reads_only=False, is_socket=True),
        RequestFacts(host=HERE, origin=f"http://{HERE}", reads_only=False),
        RequestFacts(host=HERE, site="same-origin", reads_only=False),
    ],
)
def test_the_page_itself_and_a_typed_address_are_let_in(facts):
    assert Access().refusal(facts) is None


@pytest.mark.parametrize(
    ("facts", "why"),
    [
        (RequestFacts(host="evil.example:8460"), "none of its names"),
        (RequestFacts(host="127.0.0.1.evil.example"), "none of its names"),
        (RequestFacts(host=""), "none of its names"),
        (RequestFacts(host="user@127.0.0.1"), "none of its names"),
        (RequestFacts(host="[::1"), "none of its names"),
        (RequestFacts(host="[[::1]]:1"), "none of its names"),
        (RequestFacts(host=HERE, origin="http://[::1", is_socket=True), "may not use this one"),
        (RequestFacts(host="192.168.1.5:8460"), "none of its names"),
        (
            RequestFacts(host=HERE, origin="http://evil.example", is_socket=True),
            "may not use this one",
        ),
        (
            RequestFacts(host=HERE, origin="http://127.0.0.1:9999", is_socket=True),
            "may not use this one",
        ),
        (RequestFacts(host=HERE, origin="null", is_socket=True), "may not use this one"),
        (RequestFacts(host=HERE, origin=f"ftp://{HERE}", is_socket=True), "may not use this one"),
        (RequestFacts(host=HERE, is_socket=True, reads_only=False), "does not state"),
        (RequestFacts(host=HERE, reads_only=False), "does not state"),
        (RequestFacts(host=HERE, site="cross-site", mode="no-cors"), "another site's page"),
        (RequestFacts(host=HERE, site="same-site", mode="cors"), "another site's page"),
    ],
)
def test_other_names_and_other_pages_are_refused(facts, why):
    refusal = Access().refusal(facts)
    assert refusal is not None
    assert why in refusal


def test_another_bind_wants_the_token_and_takes_numeric_addresses():
    access = access_for("0.0.0.0")
    assert access.token is not None
    assert len(access.token) >= 32
    facts = RequestFacts(host="192.168.1.5:8460")
    assert "token is missing or wrong" in str(access.refusal(facts))
    for token in ("x", access.token[:-1], access.token + "x", "ü"):
        wrong = RequestFacts(host="192.168.1.5:8460", token=token)
        assert "token is missing or wrong" in str(access.refusal(wrong))
    assert access.refusal(RequestFacts(host="192.168.1.5:8460", token=access.token)) is None
    bent = RequestFacts(host="evil.example", token=access.token)
    assert "none of its names" in str(access.refusal(bent))
    assert access_for("0.0.0.0").token != access.token


def test_loopback_needs_no_token_unless_asked_for():
    assert access_for("127.0.0.1").token is None
    assert access_for("127.0.0.1", wants_token=True).token is not None


@pytest.mark.parametrize(
    ("host", "known"),
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
def test_loopback_is_known(host, known):
    assert is_loopback(host) is known


PLAIN = "http://127.0.0.1:8460/"


@pytest.mark.skipif(os.name != "posix", reason="permissions of files are those of POSIX")
def test_a_token_stands_in_a_file_of_this_user_and_on_no_command_line(tmp_path):
    opened: list[str] = []
    old = os.umask(0)
    try:
        file = open_page(f"{PLAIN}?token=secret", tmp_path, opened.append)
    finally:
        os.umask(old)
    assert file is not None
    assert opened == [file.as_uri()]
    assert "secret" not in opened[0]
    assert file.stat().st_mode & 0o777 == 0o600
    assert f"url={PLAIN}?token=secret" in file.read_text("utf-8")


def test_a_host_header_is_taken_apart():
    assert host_name("Bench.Local:80") == "bench.local"
    assert host_name("[::1]:8460") == "::1"
    assert host_name("a b") == host_name("a/b") == host_name("") == ""
