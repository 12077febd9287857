"""What the tests of this folder share."""

import pytest

from tests.unit.bench.guarded_fake import FakeBench


@pytest.fixture
def fake():
    return FakeBench()
