"""Persistent state of one machine: checked benches and calibrations."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError
from benchtool.core.user_file import user_folder
from benchtool.data.atomic import make_folder, read_json, replace_json


def state_folder() -> Path:
    """Return this user's state folder: BENCHTOOL_STATE, else that of `user_folder`."""
    if path := os.environ.get("BENCHTOOL_STATE"):
        return Path(path)
    return user_folder("XDG_STATE_HOME", ".local/state")


def state_file(kind: str, device_id: str) -> Path:
    """Return the path of a state file: one per kind and device."""
    safe_name = re.sub(r"[^A-Za-z0-9._-]", "_", device_id) or "unnamed"
    return state_folder() / kind / f"{safe_name}.json"


def store_state(kind: str, device_id: str, facts: dict[str, Any]) -> Path:
    """Write the state of a device, replacing the previous one."""
    path = state_file(kind, device_id)
    try:
        make_folder(path.parent)
        replace_json(path, facts)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}); set the environment variable "
            f"BENCHTOOL_STATE to another folder"
        ) from error
    return path


def list_state_files(kind: str) -> dict[str, str]:
    """Return the state files of one kind with their devices, sorted by name."""
    return {str(path): path.stem for path in sorted((state_folder() / kind).glob("*.json"))}


def load_state(kind: str, device_id: str) -> dict[str, Any] | None:
    """Return the state of a device, None if there is none."""
    path = state_file(kind, device_id)
    return read_json(path) if path.is_file() else None
