"""The golden bridge, read; and what is wrong with a broken one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.index import read_index, write_index
from civil_rgbd.format.reader import PoseMismatchWarning, read_bridge
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import quaternion_from_matrix

from ..data.format_v1 import make


def test_the_golden_bridge_reads_as_it_was_made(golden: Path) -> None:
    bridge = read_bridge(golden / "bridges" / "B1")

    assert bridge.camera == PinholeCamera(32, 24, 20.0, 20.5, 15.375, 11.625)
    assert bridge.manifest.info.name == "Golden Bridge"
    assert [row.frame_id for row in bridge.rows] == ["000000", "000007", "000012"]
    for row in bridge.rows:
        frame = make.frame(row.source_index)
        assert np.array_equal(bridge.read_depth(row), frame.depth_m)
        assert np.abs(bridge.read_rgb(row).astype(int) - frame.rgb).max() <= 6
        assert row.stamp_ns == frame.stamp_ns
        assert [row.tx, row.ty, row.tz] == frame.T_map_camera[:3, 3].tolist()
        q = quaternion_from_matrix(frame.T_map_camera[:3, :3])
        assert np.abs(q - [row.qx, row.qy, row.qz, row.qw]).max() < 1e-15
    assert bridge.read_defects() == (make.defect(),)


@pytest.mark.parametrize("name", ["intrinsics.json", "poses.json", "frames.parquet"])
def test_a_missing_document_is_named(golden_copy: Path, name: str) -> None:
    bridge = golden_copy / "bridges" / "B1"
    (bridge / name).unlink()

    with pytest.raises(FormatError, match="the file is missing") as caught:
        read_bridge(bridge)
    assert caught.value.where == str(bridge / name)
    assert "again" in caught.value.fix


@pytest.mark.parametrize("name", ["rgb/000007.jpg", "depth/000007.exr"])
def test_a_missing_or_cut_image_is_named(golden_copy: Path, name: str) -> None:
    bridge = read_bridge(golden_copy / "bridges" / "B1")
    path = bridge.folder / name
    read = bridge.read_rgb if name.startswith("rgb") else bridge.read_depth

    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(FormatError, match="not a whole") as caught:
        read(bridge.rows[1])
    assert caught.value.where == str(path)

    path.unlink()
    with pytest.raises(FormatError, match="the file is missing") as caught:
        read(bridge.rows[1])
    assert "validate" in caught.value.fix


def test_images_of_another_size_are_refused(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "intrinsics.json"
    path.write_text(path.read_text().replace('"width_px": 32', '"width_px": 33'))

    bridge = read_bridge(path.parent)

    with pytest.raises(FormatError, match="32 x 24 pixels; the camera has 33 x 24"):
        bridge.read_rgb(bridge.rows[0])
    with pytest.raises(FormatError, match="32 x 24 pixels; the camera has 33 x 24"):
        bridge.read_depth(bridge.rows[0])


def test_poses_json_is_the_law(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "poses.json"
    document = json.loads(path.read_text())
    document["frames"][1]["T_map_camera"]["translation_m"] = [1.0, 2.0, 3.0]
    path.write_text(json.dumps(document))

    with pytest.warns(PoseMismatchWarning, match="for 1 frames, the first is 000007"):
        bridge = read_bridge(path.parent)

    assert [(row.tx, row.ty, row.tz) for row in bridge.rows][1] == (1.0, 2.0, 3.0)
    assert bridge.rows[0].tx == 540000.5


def test_other_frames_in_poses_json_are_refused(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "poses.json"
    document = json.loads(path.read_text())
    document["frames"][1]["stamp_ns"] += 1
    path.write_text(json.dumps(document))

    with pytest.raises(FormatError, match="do not hold the same frames with the same stamps"):
        read_bridge(path.parent)


@pytest.mark.parametrize(
    "path", ["../../etc/passwd", "/etc/passwd", "rgb/../../x.jpg", "rgb/000007.exe", "C:\\x.jpg"]
)
def test_a_path_out_of_the_folder_is_refused(golden_copy: Path, path: str) -> None:
    index = golden_copy / "bridges" / "B1" / "frames.parquet"
    rows = list(read_index(index))
    write_index(index, [dataclasses.replace(rows[0], rgb_path=path), *rows[1:]])

    with pytest.raises(FormatError, match="frame 000000 has paths"):
        read_bridge(index.parent)


def test_other_ids_in_poses_json_are_refused(golden_copy: Path) -> None:
    path = golden_copy / "bridges" / "B1" / "poses.json"
    path.write_text(path.read_text().replace('"000007"', '"000008"'))

    with pytest.raises(FormatError, match="do not hold the same frames"):
        read_bridge(path.parent)


def test_two_frames_of_one_instant_are_refused(golden_copy: Path) -> None:
    index = golden_copy / "bridges" / "B1" / "frames.parquet"
    rows = list(read_index(index))
    write_index(index, [rows[0], dataclasses.replace(rows[1], stamp_ns=rows[0].stamp_ns), rows[2]])

    with pytest.raises(FormatError, match="ids and stamps do not ascend"):
        read_bridge(index.parent)


def test_frames_out_of_order_are_refused(golden_copy: Path) -> None:
    index = golden_copy / "bridges" / "B1" / "frames.parquet"
    write_index(index, read_index(index)[::-1])

    with pytest.raises(FormatError, match="ids and stamps do not ascend"):
        read_bridge(index.parent)
