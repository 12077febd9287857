"""Fixtures for every test: measured reference data where there is some, and seeded randomness."""

from __future__ import annotations

import os
import signal
import zlib
from pathlib import Path

import hypothesis
import numpy as np
import pytest

from tests.busy import TooBusy

os.environ.setdefault("MPLBACKEND", "Agg")

# A shell that starts the tests in the background lets them ignore Ctrl-C, and every bench and
# command that they start would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

hypothesis.settings.register_profile("seeded", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("seeded")


def pytest_configure(config: pytest.Config) -> None:
    """Let tests that need real time say "too busy"."""
    config.pluginmanager.register(TooBusy())


@pytest.fixture(scope="session")
def reference_data():
    """Give the folder of measured reference data, or skip the test where there is none."""
    folder = os.environ.get("BENCHTOOL_REFERENCE_DATA")
    if not folder:
        pytest.skip("BENCHTOOL_REFERENCE_DATA is not set to a folder of measured reference data")
    path = Path(folder)
    assert path.is_dir(), f"BENCHTOOL_REFERENCE_DATA names {path}, which is no folder"
    return path


@pytest.fixture
def rng(request):
    """Give a generator seeded from the test's own name, the same on every machine."""
    return np.random.default_rng(zlib.crc32(request.node.name.encode()))


@pytest.fixture(scope="session", autouse=True)
def _own_state(tmp_path_factory):
    """Keep this user's calibrations and bench checks apart from those of the tests."""
    os.environ["BENCHTOOL_LIBRARY"] = str(tmp_path_factory.mktemp("library"))
    os.environ["BENCHTOOL_STATE"] = str(tmp_path_factory.mktemp("state"))


ALONE = ("tests/avr/test_firmware_sweep", "tests/browser/test_axe", "tests/browser/test_stop",
         "tests/proof/presses/", "tests/proof/soak/", "tests/system/test_bench_link",
         "tests/system/test_mavlink", "tests/system/test_pitch_recorded",
         "tests/system/test_sweep_killed", "tests/system/test_sweep_staged")  # fmt: skip
"""Slow suites that talk in real time to processes of their own; others are marked `real_time`."""

SLOW = (*ALONE, "tests/avr/", "tests/browser/", "tests/proof/blind/", "tests/docs/test_docs",
        "tests/system/", "tests/proof/truth/")  # fmt: skip
"""Suites that `make test` leaves out and `make test-all` runs."""

PROOF = (*(f"tests/proof/blind/{name}" for name in ("pitch/", "sweep/", "test_found",
           "test_generators", "test_sweep_format")), "tests/proof/soak/test_link_soak",
         "tests/proof/truth/test_budget_truth")  # fmt: skip
"""Suites that `make proof` runs before a release."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow suites, and what no other test may run beside."""
    for item in items:
        path = item.path.as_posix()
        if any(part in path for part in SLOW):
            item.add_marker(pytest.mark.slow)
        if any(part in path for part in PROOF):
            item.add_marker(pytest.mark.proof)
        if any(part in path for part in ALONE) or item.get_closest_marker("real_time"):
            item.add_marker(pytest.mark.alone)
