"""What benchtool remembers between commands on one machine: checked benches, calibrations."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError
from benchtool.core.user_file import user_folder
from benchtool.data.atomic import make_folder, read_json, replace_json


def state_folder() -> Path:
    """Return the folder for lasting state of this user.

    BENCHTOOL_STATE where it is set; else what the system names (`core.user_file.user_folder`).
    """
    if chosen := os.environ.get("BENCHTOOL_STATE"):
        return Path(chosen)
    return user_folder("XDG_STATE_HOME", ".local/state")


def state_file(kind: str, device_id: str) -> Path:
    """Return the file that remembers one kind of thing about one device."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", device_id) or "unnamed"
    return state_folder() / kind / f"{safe}.json"


def store_state(kind: str, device_id: str, facts: dict[str, Any]) -> Path:
    """Keep facts about a device, in place of older ones."""
    path = state_file(kind, device_id)
    try:
        make_folder(path.parent)
        replace_json(path, facts)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}); name another state folder in the "
            f"environment variable BENCHTOOL_STATE"
        ) from error
    return path


def recall_state(kind: str) -> dict[str, str]:
    """Return the files of one kind of thing and their devices, by their names."""
    return {str(path): path.stem for path in sorted((state_folder() / kind).glob("*.json"))}


def recall_latest(kind: str, device_id: str) -> dict[str, Any] | None:
    """Return what is remembered about a device, None when nothing is."""
    path = state_file(kind, device_id)
    return read_json(path) if path.is_file() else None
