"""The page on the real drive says what is measured."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DRIVE = ROOT.parent / "shared/data/kitti_bridge_drive/kitti_20frames.mcap"
PAGE = ROOT / "docs" / "real_drive.md"


@pytest.mark.skipif(
    not DRIVE.exists(), reason="the real drive (../shared/data/kitti_bridge_drive) is not here"
)
def test_the_page_gives_the_figures_as_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import real_drive

    monkeypatch.delitem(sys.modules, "real_drive")
    frames = real_drive.judged_frames(DRIVE)

    assert len(frames) == 17
    assert "\n".join(real_drive.table(frames)) in PAGE.read_text(encoding="utf-8")


@pytest.mark.skipif(
    not DRIVE.exists(), reason="the real drive (../shared/data/kitti_bridge_drive) is not here"
)
def test_pixels_are_judged_by_the_scan_of_their_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import numpy as np
    import real_drive

    monkeypatch.delitem(sys.modules, "real_drive")
    depth_m = np.array([[0.0, 5.0, 5.3, 4.7, 5.0]], dtype=np.float32)
    now = np.array([[5.0, 5.0, 5.0, 5.0, np.inf]]), np.array([[5.0, 5.0, 5.0, 5.0, 0.0]])

    kinds = real_drive._kinds(depth_m, now)

    assert [real_drive.KINDS[k] if k >= 0 else "" for k in kinds[0]] == [
        "", "agree", "behind", "in front", "not judged",
    ]  # fmt: skip
