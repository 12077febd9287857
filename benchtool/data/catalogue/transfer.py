"""Copies of runs in any place that fsspec knows: a folder, an S3-compatible store, SSH.

Beside each copied entry a manifest.json names every file with its size and SHA-256. It is written
again after every file, so that a copy that was broken off goes on where it ended.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.parsed_text import parse_json
from benchtool.core.toml_text import build
from benchtool.data.atomic import data_hash, file_hash, make_folder, sync_folder
from benchtool.data.catalogue.entry import Entry
from benchtool.data.catalogue.extra import load_extra
from benchtool.data.run.closing import has_rows
from benchtool.data.run.labels import LABELS_FILE
from benchtool.data.run.runs_folder import RunsFolder

MANIFEST = "manifest.json"
FORMAT = "benchtool-manifest-1"

MAY_CHANGE = ("metadata.json", "settings.csv", "samples.parquet", "events.jsonl", LABELS_FILE)
"""Files of a run that closing and labels change; what differs in another is another run."""

STORES = ("s3", "s3a", "gs", "gcs", "abfs", "az", "memory")
"""Protocols where a file appears whole or not at all; elsewhere it gets its name when it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredFile:
    """State size (bytes) and SHA-256 of a file."""

    size: Annotated[int, Ge(0)]
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Hold what a copy consists of.

    Attributes:
        complete: whether every file of it has arrived.
        files: by path below the entry, parts separated by "/".
    """

    files: dict[str, StoredFile]
    complete: bool = False
    format: str = FORMAT

    def text(self) -> str:
        files = {name: {"size": one.size, "sha256": one.sha256} for name, one in self.files.items()}
        data = {"format": self.format, "complete": self.complete, "files": files}
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Copied:
    """Say what was done to one entry: files and bytes that went over, files that were there."""

    name: str
    sent: int
    size: int
    present: int


class CopyPlace:
    """Hold copies of entries at an address of fsspec.

    Args:
        url: as ``s3://bucket/lab``, ``ssh://host/folder`` or a path.

    Raises:
        InputError: an address that nothing understands, or a package for it that is not installed.
    """

    def __init__(self, url: str, **options: Any) -> None:
        core = load_extra("fsspec.core", "catalogue", "a copy of runs")
        self.url = url
        if url.startswith("ssh://"):
            options = {"known_hosts": (), **options}  # ~/.ssh/known_hosts; sshfs checks no host key
        with self._faults():
            self._fs, root = core.url_to_fs(url, **options)
        self._root = str(root).rstrip("/")
        named = self._fs.protocol
        self._whole = not {*STORES}.isdisjoint([named] if isinstance(named, str) else named)

    def names(self) -> tuple[str, ...]:
        """Return the names of the copies that are there, complete or not."""
        with self._faults():
            found = self._fs.find(self._root)
        end = f"/{MANIFEST}"
        return tuple(
            sorted(path[len(self._root) + 1 : -len(end)] for path in found if path.endswith(end))
        )

    def manifest(self, name: str) -> Manifest | None:
        """Return what a copy consists of, None where there is none."""
        path = self._path(name, MANIFEST)
        with self._faults():
            if not self._fs.exists(path):
                return None
            text = self._fs.cat_file(path).decode("utf-8", "replace")
        where = f"{self.url}/{name}/{MANIFEST}"
        found = build(Manifest, parse_json(text, where), where)
        if found.format != FORMAT:
            raise FileFormatError(where, f"its format is {found.format!r}, not {FORMAT!r}")
        return found

    def push(self, path: Path, entry: Entry, *, read_back: bool = True) -> Copied:
        """Copy one entry there; what is there already and is the same is not sent again.

        Args:
            read_back: read each file that was sent, and compare its hash.

        Raises:
            InputError: it is being measured, another one of its name is there, or the place
                refuses.
        """
        if entry.state == "running":
            raise InputError(f"{path} is being measured; push it when it has ended")
        if not path.is_dir():
            raise InputError(f"{path} is one file; push folders: runs, fits, explanations")
        own, there = manifest_of(path), self.manifest(entry.name)
        known = there.files if there else {}
        changed = [name for name in own if name in known and known[name] != own[name]]
        if there and there.complete and (other := [n for n in changed if n not in MAY_CHANGE]):
            raise InputError(
                f"{self.url} holds another {entry.name}: {other[0]} differs, and nothing was "
                f"overwritten; push to another place, or rename the run"
            )
        arrived = {name: one for name, one in known.items() if own.get(name) == one}
        arrived = {
            name: one for name, one in arrived.items() if self._size(entry, name) == one.size
        }
        present, size = len(arrived), 0
        if len(arrived) == len(own) and there and there.complete:
            return Copied(name=entry.name, sent=0, size=0, present=present)
        for name in (name for name in own if name not in arrived):
            self._send(path / name, self._path(entry.name, name))
            if read_back and self._hash(self._path(entry.name, name)) != own[name].sha256:
                raise InputError(
                    f"{entry.name}/{name} arrived at {self.url} otherwise than it was sent (its "
                    f"SHA-256 differs); push again"
                )
            arrived[name] = own[name]
            size += own[name].size
            self._note(entry.name, Manifest(files=arrived))
        self._note(entry.name, Manifest(files=arrived, complete=True))
        return Copied(name=entry.name, sent=len(own) - present, size=size, present=present)

    def pull(self, name: str, root: Path) -> Copied:
        """Copy one entry from there into a folder of runs; each file's hash is checked.

        Raises:
            InputError: no such copy, one that is not complete, another one of its name is here, or
                a file that is not what the manifest says.
        """
        there = self.manifest(name)
        if there is None:
            raise UnknownChoice(f"copy at {self.url}", name, self.names())
        if not there.complete:
            raise InputError(f"{self.url}/{name} is not complete; push it again first")
        place = RunsFolder(root).inside(name)
        if os.path.lexists(place):
            self._compare(place, there)
            return Copied(name=name, sent=0, size=0, present=len(there.files))
        beside = place.with_name(f".{place.name}.pull")
        present = size = 0
        for each, stated in there.files.items():
            path = RunsFolder(beside).inside(each)
            if path.is_file() and _stored(path) == stated:
                present += 1
                continue
            make_folder(path.parent)
            with self._faults():
                self._fs.get_file(self._path(name, each), str(path))
            if _stored(path) != stated:
                path.unlink()
                raise InputError(
                    f"{self.url}/{name}/{each} is not what its manifest says (size or SHA-256 "
                    f"differ); nothing of it was put into {root}; restore it there"
                )
            size += stated.size
        os.rename(beside, place)
        sync_folder(place.parent)
        return Copied(name=name, sent=len(there.files) - present, size=size, present=present)

    def check(self, name: str) -> list[str]:
        """Return what of a copy is not as its manifest says, every file read."""
        there = self.manifest(name)
        if there is None or not there.complete:
            return ["there is no complete copy"]
        return [
            f"{each} is missing or differs"
            for each, stated in there.files.items()
            if self._hash(self._path(name, each)) != stated.sha256
        ]

    def _compare(self, place: Path, there: Manifest) -> None:
        own = manifest_of(place)
        differing = [name for name, one in there.files.items() if own.get(name) != one]
        if other := [name for name in differing if name not in MAY_CHANGE or name not in own]:
            raise InputError(
                f"{place} is there and differs from the copy in {other[0]}; nothing was "
                f"overwritten; rename it, or pull into another --folder"
            )

    def _path(self, name: str, file: str) -> str:
        return f"{self._root}/{name}/{file}"

    def _size(self, entry: Entry, name: str) -> int:
        with self._faults():
            path = self._path(entry.name, name)
            return int(self._fs.size(path)) if self._fs.exists(path) else -1

    def _hash(self, path: str) -> str:
        with self._faults():
            if not self._fs.exists(path):
                return ""
            with self._fs.open(path, "rb") as file:
                total = hashlib.sha256()
                while part := file.read(1 << 22):
                    total.update(part)
        return total.hexdigest()

    def _send(self, source: Path, path: str) -> None:
        with self._faults():
            if self._whole:
                self._fs.put_file(str(source), path)
                return
            self._fs.makedirs(path.rpartition("/")[0], exist_ok=True)
            self._fs.put_file(str(source), f"{path}.part")
            self._fs.mv(f"{path}.part", path)

    def _note(self, name: str, manifest: Manifest) -> None:
        path, data = self._path(name, MANIFEST), manifest.text().encode()
        with self._faults():
            if self._whole:
                self._fs.pipe_file(path, data)
            else:
                self._fs.pipe_file(f"{path}.part", data)
                self._fs.mv(f"{path}.part", path)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Turn what a place raises into one sentence."""
        foreign = [
            getattr(sys.modules[module], name)
            for module, name in (
                ("botocore.exceptions", "BotoCoreError"), ("botocore.exceptions", "ClientError"),
                ("asyncssh", "Error"),
            )
            if module in sys.modules
        ]  # fmt: skip
        try:
            yield
        except ImportError as error:
            raise InputError(
                f"{self.url}: {error}; install it beside benchtool[catalogue]"
            ) from error
        except (OSError, ValueError, *foreign) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"{self.url} cannot be used: {reason}; check address and rights"
            ) from error


def manifest_of(folder: Path) -> dict[str, StoredFile]:
    """Return size and hash of every file of an entry; hidden ones and links are left out."""
    files = {}
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not path.is_symlink() and not any(p.startswith(".") for p in parts):
            files["/".join(parts)] = _stored(path)
    return files


def _stored(path: Path) -> StoredFile:
    return StoredFile(size=path.stat().st_size, sha256=file_hash(path, follow=False))


def verify_run(path: Path) -> list[str]:
    """Return what of a run or fit is not as its own files say, empty where all is.

    Hashes are those of metadata.json. The Parquet of the samples alone is enough.
    """
    from benchtool.data.run.entry import entry_of
    from benchtool.data.run.facts import read_metadata
    from benchtool.data.run.read import is_run, parts_of

    entry = entry_of(RunsFolder(path.resolve().parent), path.resolve().name)
    if entry.problem:
        return [entry.problem]
    if not is_run(path):
        return []
    facts = read_metadata(path)
    problems = _differing(path, facts)
    if merged := facts.get("merged_from"):
        problems += [
            f"{Path(part).name}: {problem}"
            for part, one in zip(parts_of(path), merged, strict=True)
            for problem in verify_run(Path(part))
            or (["its data have changed"] if data_hash(part) != one["sha256"] else ())
        ]
    elif entry.state == "running":
        return ["it is being measured, or its program died; then: benchtool runs close"]
    return problems


def _differing(path: Path, facts: Mapping[str, Any]) -> list[str]:
    """Return which points and samples of a run are not those of its hashes."""
    points, samples = facts.get("points") or {}, facts.get("samples") or {}
    hashes = {
        "points.csv": points.get("csv_sha256"),
        "samples.csv": samples.get("csv_sha256"),
        "samples.parquet": samples.get("parquet_sha256"),
    }
    found = []
    for name, stated in hashes.items():
        file = path / name
        if stated and not file.is_file():
            found.append(f"{name} is missing")
        elif stated and file_hash(file, follow=False) != stated:
            found.append(f"{name} has changed since the run was closed")
        elif not stated and name == "samples.csv" and has_rows(file):
            found.append(f"metadata.json states no hash of {name}: benchtool runs close")
    # The Parquet contains every sample, so the CSV may be left out.
    return [] if found == ["samples.csv is missing"] and hashes["samples.parquet"] else found


def copied_line(copied: Copied, done: str) -> str:
    """Return a line for people on one entry."""
    if not copied.sent:
        return f"{copied.name}: there already, {copied.present} files"
    return f"{copied.name}: {done} {copied.sent} files, {copied.size / 1e6:.1f} MB" + (
        f"; {copied.present} were there" if copied.present else ""
    )
