"""What every room's tests share."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

# A script of its own: it looks for its neighbours beside itself.
collect_ignore = ["pixel_hashes.py"]

# Examples are the same in every run: a failure here is a failure everywhere.
settings.register_profile(
    "fixed",
    derandomize=True,
    deadline=None,  # the first call compiles a kernel
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
# For tests/mutations.py: that a test fails is all it asks, not the smallest example.
settings.register_profile("unshrunk", settings.get_profile("fixed"), phases=[Phase.generate])
settings.load_profile(os.environ.get("CIVIL_RGBD_HYPOTHESIS", "fixed"))


GOLDEN = Path(__file__).resolve().parent / "data" / "format_v1"


@pytest.fixture
def golden() -> Path:
    """The golden dataset; read only."""
    return GOLDEN


@pytest.fixture
def golden_copy(tmp_path: Path) -> Path:
    """A copy of the golden dataset, without what made it."""
    copy = tmp_path / "golden"
    shutil.copytree(GOLDEN, copy, ignore=shutil.ignore_patterns("make.py", "__pycache__"))
    return copy


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of other people's recordings beside the repository; most checkouts have none."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs recordings that may not be shipped, in {folder.name!r} beside the repo")
    return folder


@pytest.fixture(scope="module")
def spawned_tests() -> Iterator[None]:
    """Let processes that a test spawns find the test's own functions, however pytest was started.

    A spawned process is told ``sys.path``; the folder above ``tests`` is on it by ``python -m
    pytest`` alone.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).resolve().parents[1]))
        yield
