"""TUM's lists: stamps are stamps, whatever they look like; association files in either order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from civil_rgbd.errors import RecordingError
from civil_rgbd.exporters.poses import transform_of

from . import sets

Take = Any


def numbered(folder: Path, first: int) -> Path:
    """Files named from ``first``, stamped in whole seconds from 0: a stamp looks like a name."""
    name = lambda frame: f"{frame + first}"  # noqa: E731  # one line says it
    sets.write_images(folder / "rgb", folder / "depth", scale=5000.0, name=name)
    sets.lab_intrinsics(folder)
    poses = [
        " ".join(map(repr, [frame, *map(float, T[:3, 3]), *sets.quaternion(T)]))
        for frame, T in enumerate(map(sets.pose, range(sets.FRAMES)))
    ]
    (folder / "groundtruth.txt").write_text("\n".join(poses))
    return folder


def test_a_stamp_that_looks_like_another_images_name_is_a_stamp(take: Take, tmp_path: Path) -> None:
    root = numbered(tmp_path / "set", first=1)
    for kind in ("rgb", "depth"):
        rows = [f"{frame} {kind}/{frame + 1}.png" for frame in range(sets.FRAMES)]
        (root / f"{kind}.txt").write_text("\n".join(rows))

    bridge = take(root, "tum")

    assert [row.source_index for row in bridge.rows] == list(range(1, sets.FRAMES + 1))
    for frame, row in enumerate(bridge.rows):
        assert transform_of(row) == pytest.approx(sets.pose(frame), abs=1e-9)


@pytest.mark.parametrize(
    "row", ["{0} depth/{0}.png {0} rgb/{0}.png", "{0} rgb/{0}.png {0} depth/{0}.png"]
)
def test_an_association_file_is_read_in_either_order(row: str, take: Take, tmp_path: Path) -> None:
    root = numbered(tmp_path / "set", first=0)
    rows = [row.format(frame) for frame in range(sets.FRAMES)]
    (root / "associations.txt").write_text("\n".join(rows))

    bridge = take(root, "tum")

    assert len(bridge.rows) == sets.FRAMES
    assert np.array_equal(bridge.read_rgb(bridge.rows[5]), sets.rgb(5))
    assert bridge.rows[5].stamp_ns == 5_000_000_000


def test_a_listed_file_that_is_not_there_is_named(take: Take, tmp_path: Path) -> None:
    root = sets.tum(tmp_path / "set")
    (root / "rgb" / "000003.png").unlink()

    with pytest.raises(RecordingError, match=r"1 listed files are missing, the first is 000003"):
        take(root, "tum")


def test_without_intrinsics_a_size_of_its_own_is_refused(take: Take, tmp_path: Path) -> None:
    root = sets.tum(tmp_path / "set")
    (root / "intrinsics.json").unlink()

    with pytest.raises(RecordingError, match="no camera intrinsics are found") as caught:
        take(root, "tum")

    assert "--intrinsics" in caught.value.fix


def test_a_folder_without_the_benchmarks_lists_is_said_and_has_no_usual_camera(
    take: Take, tmp_path: Path
) -> None:
    root = sets.bridge_rgbd(tmp_path / "set", scale=5000.0)
    bridge = take(root, "tum")
    assert bridge.manifest.warnings[0].startswith("no rgb.txt and depth.txt: images and depth go")
    for path in root.glob("**/*.png"):  # of the benchmark's own size
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        sets.write_png(path, cv2.resize(pixels, (640, 480), interpolation=cv2.INTER_NEAREST))
    for path in root.glob("*intrinsic*"):
        path.unlink()

    with pytest.raises(RecordingError, match="no camera intrinsics are found"):
        take(root, "tum", overwrite=True)


def test_a_folder_that_holds_an_rgb_txt_of_something_else_is_not_looked_into(
    take: Take, tmp_path: Path
) -> None:
    (tmp_path / "etc" / "X11").mkdir(parents=True)
    (tmp_path / "etc" / "X11" / "rgb.txt").write_text("255 250 250 snow\n")

    with pytest.raises(RecordingError, match="no colour and depth images") as caught:
        take(tmp_path / "etc", "tum")
    assert caught.value.where == str(tmp_path / "etc")
