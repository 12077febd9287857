from __future__ import annotations

import socket
from pathlib import Path

import pytest

from benchtool.acquire.stop_listener import StopListener, StopReport, announce, find_benches


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "0.0.0.0"])
def test_a_bench_is_reached_at_the_host_where_it_listens(
    host: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path))
    try:
        listening = socket.create_server((host, 0))
    except OSError:
        pytest.skip(f"this system has no address {host}")
    stops: list[str] = []
    report = StopReport(True, "rotor 1 was seen to stand")
    listener = StopListener(listening, "token", stops.append, lambda: report)
    with listener, announce("serial:a", listener):
        (bench,) = find_benches()
        assert bench.address == "serial:a"
        assert bench.stop() == report
        assert stops == ["benchtool stop"]
    assert find_benches() == []
