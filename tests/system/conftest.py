"""What every test of the installed command line takes."""

from __future__ import annotations

import pytest

from tests.system.served import environment_of


@pytest.fixture
def environment(tmp_path):
    """Give the environment of commands that remember nothing outside of this test."""
    return environment_of(tmp_path)
