"""Copies of runs: in a folder, in an S3 store that moto serves, and over SSH, both on loopback."""

from __future__ import annotations

import asyncio
import gc
import shutil
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.data.catalogue.index import catalogued
from benchtool.data.catalogue.transfer import MANIFEST, Copied, CopyPlace, manifest_of, verify_run
from benchtool.data.run.labels import label
from tests.unit.data.run_of import small_run


@pytest.fixture(scope="module")
def served() -> Iterator[str]:
    """Give the address of an S3-compatible server."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int]]:
    """Serve SFTP: the home of a user whose key the server knows, and the port."""
    asyncssh = pytest.importorskip("asyncssh")
    home, ready, loop = tmp_path_factory.mktemp("home"), threading.Event(), asyncio.new_event_loop()
    user, host = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
    (home / ".ssh").mkdir()
    user.write_private_key(home / ".ssh" / "id_ed25519")
    user.write_public_key(home / "authorized")
    ports, done = [], asyncio.Event()

    async def serve() -> None:
        server = await asyncssh.listen(
            "127.0.0.1", 0, server_host_keys=[host], sftp_factory=True,
            authorized_client_keys=str(home / "authorized"),
        )  # fmt: skip
        ports.append(server.get_port())
        ready.set()
        await done.wait()
        server.close()
        await server.wait_closed()
        if left := asyncio.all_tasks() - {asyncio.current_task()}:
            await asyncio.wait(left, timeout=10.0)

    def run() -> None:
        loop.run_until_complete(serve())
        loop.close()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(20.0)
    key = host.export_public_key().decode().strip()
    (home / ".ssh" / "known_hosts").write_text(f"[127.0.0.1]:{ports[0]} {key}\n")
    yield home, ports[0]
    loop.call_soon_threadsafe(done.set)
    thread.join(20.0)


@pytest.fixture(params=["folder", "s3", "ssh"])
def place(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    if request.param == "folder":
        yield str(tmp_path / "copies")
        return
    if request.param == "ssh":
        home, port = request.getfixturevalue("home")
        monkeypatch.setenv("HOME", str(home))
        monkeypatch.setenv("USER", "lab")
        yield f"ssh://lab@127.0.0.1:{port}{tmp_path}/copies"
        sys.modules["sshfs"].SSHFileSystem.clear_instance_cache()
        gc.collect()  # closes the connections
        return
    import s3fs

    monkeypatch.setenv("AWS_ENDPOINT_URL", request.getfixturevalue("served"))
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem.clear_instance_cache()
    bucket = f"lab-{tmp_path.name.lower().replace('_', '-')[-40:]}".strip("-")
    s3fs.S3FileSystem().mkdir(bucket)
    yield f"s3://{bucket}/runs"
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "runs"
    for name in ("2026/one", "two"):
        run = small_run(root / name)
        run.update_metadata(state="ended")
        run.close()
    return root


def push(target: CopyPlace, root: Path, **options: Any) -> dict[str, Copied]:
    return {one.name: target.push(root / one.name, one, **options) for one in catalogued(root)}


def test_what_was_pushed_comes_back_the_same(place: str, root: Path, tmp_path: Path) -> None:
    target = CopyPlace(place)
    sent = push(target, root)
    assert {name: (one.sent, one.present) for name, one in sent.items()} == {
        "2026/one": (7, 0),
        "two": (7, 0),
    }
    assert [(one.sent, one.present) for one in push(target, root).values()] == [(0, 7)] * 2
    assert target.names() == ("2026/one", "two")
    back = tmp_path / "back"
    for name in target.names():
        assert target.pull(name, back).sent == 7
        assert manifest_of(back / name) == manifest_of(root / name)
        assert verify_run(back / name) == []
        assert target.check(name) == []
        assert target.pull(name, back).sent == 0


@pytest.mark.filterwarnings("ignore::benchtool.core.errors.DataWarning")
def test_labels_follow_and_other_data_are_refused(place: str, root: Path) -> None:
    target = CopyPlace(place)
    push(target, root)
    label(root / "two", add=["good"])
    assert [(one.sent, one.present) for one in push(target, root).values()] in (
        [(1, 7), (0, 7)],
        [(0, 7), (1, 7)],
    )
    with (root / "two" / "points.csv").open("a") as changed:
        changed.write("\n")
    entry = next(one for one in catalogued(root) if one.name == "two")
    with pytest.raises(InputError, match=r"holds another two: points.csv differs, and nothing was"):
        target.push(root / "two", entry)
    with pytest.raises(InputError, match=r"differs from the copy in points.csv; nothing was"):
        target.pull("two", root)


def test_a_copy_that_was_broken_off_goes_on(
    place: str, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, whole, sent = CopyPlace(place), CopyPlace._send, list[str]()

    def cut(self: CopyPlace, source: Path, path: str) -> None:
        if len(sent) == 3:
            raise InputError("the line is dead")
        sent.append(source.name)
        whole(self, source, path)

    monkeypatch.setattr(CopyPlace, "_send", cut)
    entry = next(one for one in catalogued(root) if one.name == "two")
    with pytest.raises(InputError, match="the line is dead"):
        target.push(root / "two", entry)
    with pytest.raises(InputError, match="is not complete; push it again first"):
        target.pull("two", tmp_path / "back")
    assert target.check("two") == ["there is no complete copy"]
    monkeypatch.setattr(CopyPlace, "_send", whole)
    again = CopyPlace(place).push(root / "two", entry)
    assert (again.sent, again.present) == (4, 3)
    beside = tmp_path / "back" / ".two.pull"
    beside.mkdir(parents=True)
    shutil.copy(root / "two" / "samples.csv", beside)  # as a broken pull leaves them
    (beside / "points.csv").write_text("half")
    fetched = target.pull("two", tmp_path / "back")
    assert (fetched.sent, fetched.present) == (6, 1)
    assert manifest_of(tmp_path / "back" / "two") == manifest_of(root / "two")


def test_a_copy_that_changed_is_refused(place: str, root: Path, tmp_path: Path) -> None:
    target = CopyPlace(place)
    push(target, root)
    size = (root / "two" / "points.csv").stat().st_size
    target._fs.pipe_file(target._path("two", "points.csv"), b"x" * size)
    assert target.check("two") == ["points.csv is missing or differs"]
    with pytest.raises(InputError, match=r"points.csv is not what its manifest says"):
        target.pull("two", tmp_path / "back")
    assert not (tmp_path / "back" / "two").exists()


def test_what_arrives_otherwise_is_seen(
    place: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = CopyPlace(place)
    monkeypatch.setattr(CopyPlace, "_hash", lambda self, path: "0")
    with pytest.raises(InputError, match=r"arrived at .* otherwise than it was sent"):
        push(target, root)


def test_a_server_that_is_not_known_gets_nothing(
    home: tuple[Path, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another key in known_hosts, as where somebody stands between."""
    other = shutil.copytree(home[0], tmp_path / "home")
    key = sys.modules["asyncssh"].generate_private_key("ssh-ed25519").export_public_key().decode()
    (other / ".ssh" / "known_hosts").write_text(f"[127.0.0.1]:{home[1]} {key}")
    monkeypatch.setenv("HOME", str(other))
    monkeypatch.setenv("USER", "lab")
    with pytest.raises(InputError, match=r"cannot be used: Host key is not trusted"):
        CopyPlace(f"ssh://lab@127.0.0.1:{home[1]}{tmp_path}/copies")
    gc.collect()


@pytest.mark.parametrize("name", ["../out", "/out", ".hidden", "a\\b", "metadata.json/.."])
def test_a_manifest_leads_nowhere_else(tmp_path: Path, root: Path, name: str) -> None:
    target = CopyPlace(str(tmp_path / "copies"))
    push(target, root)
    manifest = tmp_path / "copies" / "two" / MANIFEST
    text = manifest.read_text("utf-8").replace('"points.csv"', f'"{name}"'.replace("\\", "\\\\"))
    manifest.write_text(text, "utf-8")
    with pytest.raises(InputError, match="leads out of"):
        target.pull("two", tmp_path / "back" / "deep")
    assert not (tmp_path / "back" / "out").exists()


@pytest.mark.parametrize(
    ("url", "said"),
    [("s4://x/y", "Protocol not known: s4"), ("gs://x/y", "install")],
)
def test_a_place_that_nothing_reaches_is_one_sentence(url: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        CopyPlace(url)


def test_a_run_that_is_measured_is_not_pushed(root: Path, tmp_path: Path) -> None:
    run = small_run(root / "live")
    run.update_metadata(state="running")
    entry = next(one for one in catalogued(root) if one.name == "live")
    with pytest.raises(InputError, match="is being measured; push it when it has ended"):
        CopyPlace(str(tmp_path / "copies")).push(run.path, entry)


def test_verify_finds_what_changed(root: Path) -> None:
    run = root / "two"
    assert verify_run(run) == []
    with (run / "samples.parquet").open("ab") as changed:
        changed.write(b"x")
    assert verify_run(run) == ["samples.parquet has changed since the run was closed"]
    (run / "samples.csv").unlink()
    assert verify_run(run)[0] == "samples.csv is missing"
    (run / "points.csv").write_text("point,kind\n1,bogus\n")
    assert "bogus" in verify_run(run)[0]
    with pytest.raises(BenchtoolError):
        verify_run(root / "none")
