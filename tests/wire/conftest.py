"""Recorded conversations with real devices."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def recordings(reference_data):
    """Give the folder of recorded Grbl conversations, or skip the test where there is none."""
    folder = reference_data.parent / "peers" / "grbl"
    if not folder.is_dir():
        pytest.skip(f"no recorded Grbl conversations in {folder}")
    return folder
