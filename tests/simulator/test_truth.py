"""The truth lies beside the recording and says what the recording does not."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from civil_rgbd.errors import OutputError
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.simulator.camera import true_camera_pose, true_depth
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.truth import remove_truth, write_truth
from civil_rgbd.simulator.walk import image_instants_ns

SPEC = ScanSpec(seconds=0.4, image_scale=0.1, point_rate_hz=600, seed=5, camera_time_offset_s=3.0)
CAMERA = PinholeCamera(16, 12, 10.0, 10.0, 7.5, 5.5)


def test_it_holds_true_poses_dimensions_and_depth(tmp_path: Path) -> None:
    folder = write_truth(tmp_path / "raw.mcap", SPEC, depth_camera=CAMERA)

    scene = json.loads((folder / "scene.json").read_text())
    assert folder == tmp_path / "raw.truth"
    assert scene["spec"]["seed"] == 5
    assert scene["dimensions_m"]["girder_soffit_z_m"] == 5.0
    assert scene["spalls"] == []
    images = np.loadtxt(folder / "images.csv", delimiter=",", skiprows=1)
    assert [
        int(line.split(",")[0]) for line in (folder / "images.csv").read_text().split()[1:]
    ] == (image_instants_ns(SPEC).tolist())
    T = true_camera_pose(SPEC, 2)
    np.testing.assert_array_equal(images[2, 1:4], T[:3, 3])
    np.testing.assert_allclose(
        Rotation.from_quat(images[2, 4:]).as_matrix(), T[:3, :3], rtol=0, atol=1e-12
    )
    depth = np.load(folder / "depth" / "000002.npy")
    np.testing.assert_array_equal(depth, true_depth(SPEC, 2, CAMERA))
    assert len(list((folder / "depth").iterdir())) == 4
    assert trimesh.load(folder / "scene.ply").bounds[1, 2] > 7.0


def test_writing_again_replaces_it_whole(tmp_path: Path) -> None:
    write_truth(tmp_path / "raw.mcap", SPEC, depth_camera=CAMERA)
    folder = write_truth(tmp_path / "raw.mcap", SPEC)

    assert not (folder / "depth").exists()
    assert [entry.name for entry in tmp_path.iterdir()] == ["raw.truth"]


def test_what_a_killed_run_left_is_in_nobodys_way(tmp_path: Path) -> None:
    left = tmp_path / f".raw.truth.{os.getpid()}.partial"
    left.mkdir()
    (left / "scene.json").write_text("half")

    write_truth(tmp_path / "raw.mcap", SPEC)

    assert (left / "scene.json").read_text() == "half"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [left.name, "raw.truth"]


def test_removing_it_twice_is_no_fault(tmp_path: Path) -> None:
    folder = write_truth(tmp_path / "raw.mcap", SPEC)

    remove_truth(tmp_path / "raw.mcap")
    remove_truth(tmp_path / "raw.mcap")

    assert not folder.exists()


def test_a_place_that_cannot_be_written_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    with pytest.raises(OutputError, match="cannot write the truth") as caught:
        write_truth(tmp_path / "file" / "raw.mcap", SPEC)
    assert caught.value.where.endswith("raw.truth")
