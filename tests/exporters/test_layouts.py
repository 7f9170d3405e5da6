"""What other programs read out of an export, read here as they do, by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.exporters.registry import export
from civil_rgbd.exporters.report import ExportOptions, ExportReport
from civil_rgbd.exporters.selection import choose

from .conftest import CAMERA, INDICES, STAMPS, depth_m, pose, rgb


def write(dataset: Path, name: str, folder: Path, **options: Any) -> ExportReport:
    bridges, split = options.pop("bridges", ("B3",)), options.pop("split", None)
    chosen, splits = choose(dataset, bridges=bridges, split=split)
    return export(chosen, name, folder, ExportOptions(splits=splits, **options))


def png16(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert pixels.dtype == np.uint16
    return pixels.astype(float)


def colour(path: Path) -> np.ndarray:
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def points_map(place: int, *, furthest_m: float = 1e9) -> tuple[np.ndarray, np.ndarray]:
    """Points and colours of a frame, by the textbook."""
    z = depth_m(place).astype(float)
    v, u = np.nonzero((z > 0) & (z < furthest_m))
    K = np.array([[CAMERA.fx_px, 0, CAMERA.cx_px], [0, CAMERA.fy_px, CAMERA.cy_px], [0, 0, 1]])
    rays = np.linalg.solve(K, np.stack([u, v, np.ones_like(u)]).astype(float))
    T = pose(place)
    return (T[:3, :3] @ (rays * z[v, u])).T + T[:3, 3], rgb(place)[v, u]


# --- KITTI --------------------------------------------------------------------------------------


def as_bts_does(folder: Path, name: str) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Image, depth and focal length, by the words of a line, as BTS and ZoeDepth take them."""
    samples = []
    for line in (folder / name).read_text().splitlines():
        words = line.split()
        assert len(words) == 3
        assert not words[0].startswith("/")
        image, depth = (folder / word for word in words[:2])
        samples.append((colour(image), png16(depth) / 256.0, float(words[2])))
    return samples


def test_kitti_lists_lead_to_images_depth_and_focal_length(dataset: Path, tmp_path: Path) -> None:
    report = write(dataset, "kitti", tmp_path / "kitti", bridges=())

    samples = as_bts_does(tmp_path / "kitti", "all_files_with_gt.txt")
    assert len(samples) == 8
    for place in range(4):
        image, depth, focal = samples[4 + place]
        expected = np.where(depth_m(place) > 255.99, 0, depth_m(place))
        assert np.array_equal(image, rgb(place))
        assert np.array_equal(depth == 0, expected == 0)
        assert np.abs(depth - expected).max() <= 1 / 512
        assert focal == pytest.approx(CAMERA.fx_px, abs=5e-5)
    assert "8 depths lie beyond the range and are written as none" in report.losses
    assert any("rounded, by at most 1.95 mm" in loss for loss in report.losses)


def test_kitti_has_a_list_a_split(dataset: Path, tmp_path: Path) -> None:
    write(dataset, "kitti", tmp_path / "kitti", bridges=())

    lists = {path.name for path in (tmp_path / "kitti").glob("*_files_with_gt.txt")}
    assert lists == {f"{split}_files_with_gt.txt" for split in ("all", "train", "test")}
    train = (tmp_path / "kitti/train_files_with_gt.txt").read_text().split()
    assert [word.rpartition("/")[2] for word in train[0::3]] == [
        *(f"{index:010d}.png" for index in INDICES),
        *("0000000003.png", "0000000008.png"),
    ]
    (test,) = (tmp_path / "kitti/test_files_with_gt.txt").read_text().splitlines()
    assert test.startswith("B3/image_02/data/0000000021.png B3/proj_depth/groundtruth/image_02/")
    readme = (tmp_path / "kitti/README.txt").read_text()
    assert "--filenames_file HERE/train_files_with_gt.txt" in readme
    assert "--input_height 32 --input_width 32 " in readme  # multiples of 32
    assert f"{CAMERA.width_px} x {CAMERA.height_px} will not do" in readme


def test_one_split_alone_is_written(dataset: Path, tmp_path: Path) -> None:
    report = write(dataset, "kitti", tmp_path / "kitti", bridges=(), split="test")

    assert report.frames == {"B3": 1}
    assert len(as_bts_does(tmp_path / "kitti", "test_files_with_gt.txt")) == 1
    assert not (tmp_path / "kitti/B1").exists()


# --- COLMAP, nerfstudio ---------------------------------------------------------------------------


def test_colmap_projects_map_points_onto_their_pixels(dataset: Path, tmp_path: Path) -> None:
    write(dataset, "colmap", tmp_path / "colmap")

    model = tmp_path / "colmap" / "sparse" / "0"
    (camera,) = data_lines(model / "cameras.txt")
    words = camera.split()
    assert words[:4] == ["1", "PINHOLE", "40", "30"]
    fx, fy, cx, cy = map(float, words[4:])
    lines = (model / "images.txt").read_text().splitlines()[1:]
    assert lines[1::2] == [""] * 4
    for place, line in enumerate(lines[0::2]):
        number, *numbers, camera_id, name = line.split()
        assert (int(number), camera_id, name) == (place + 1, "1", f"{INDICES[place]:06d}.png")
        qw, qx, qy, qz, *t = map(float, numbers)
        R = Rotation.from_quat([qx, qy, qz, qw]).as_matrix()
        X = (points_map(place)[0] @ R.T) + t
        v, u = np.nonzero(depth_m(place))
        # COLMAP: the centre of the pixel (0, 0) is (0.5, 0.5).
        assert np.abs(fx * X[:, 0] / X[:, 2] + cx - (u + 0.5)).max() < 1e-6
        assert np.abs(fy * X[:, 1] / X[:, 2] + cy - (v + 0.5)).max() < 1e-6
        assert np.array_equal(colour(tmp_path / "colmap/images" / name), rgb(place))
    assert all(len(line.split()) == 8 for line in data_lines(model / "points3D.txt"))


def data_lines(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def test_nerfstudio_looks_along_minus_z_with_y_up(dataset: Path, tmp_path: Path) -> None:
    write(dataset, "nerfstudio", tmp_path / "nerf")

    document = json.loads((tmp_path / "nerf/transforms.json").read_text())
    assert (document["w"], document["h"]) == (40, 30)
    assert document["cx"] == CAMERA.cx_px + 0.5
    assert document["cy"] == CAMERA.cy_px + 0.5
    for place, frame in enumerate(document["frames"]):
        T_opengl_map = np.linalg.inv(np.array(frame["transform_matrix"]))
        X = points_map(place)[0] @ T_opengl_map[:3, :3].T + T_opengl_map[:3, 3]
        v, u = np.nonzero(depth_m(place))
        assert (X[:, 2] < 0).all()
        column = document["fl_x"] * X[:, 0] / -X[:, 2] + document["cx"]
        row = document["fl_y"] * -X[:, 1] / -X[:, 2] + document["cy"]
        assert np.abs(column - (u + 0.5)).max() < 1e-6
        assert np.abs(row - (v + 0.5)).max() < 1e-6
        depth = png16(tmp_path / "nerf" / frame["depth_file_path"]) * 0.001
        kept = depth_m(place) < 65
        assert np.abs(depth - depth_m(place))[kept].max() <= 0.0005 + 1e-9
        assert np.array_equal(colour(tmp_path / "nerf" / frame["file_path"]), rgb(place))


# --- clouds -------------------------------------------------------------------------------------


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    data = path.read_bytes()
    head, _, body = data.partition(b"end_header\n")
    words = [line.split() for line in head.decode().splitlines()]
    names = [word[-1] for word in words if word[0] == "property"]
    assert names == ["x", "y", "z", "red", "green", "blue"]
    (count,) = [int(word[2]) for word in words if word[:2] == ["element", "vertex"]]
    kinds = {"double": "<f8", "uchar": "u1"}
    dtype = [(word[2], kinds[word[1]]) for word in words if word[0] == "property"]
    vertices = np.frombuffer(body, dtype=dtype)
    assert len(vertices) == count
    return (
        np.stack([vertices[axis] for axis in "xyz"], axis=1),
        np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1),
    )


def test_ply_holds_every_measured_pixel_with_its_colour(dataset: Path, tmp_path: Path) -> None:
    write(dataset, "ply", tmp_path / "ply")

    points, colours = read_ply(tmp_path / "ply/points.ply")
    expected = [points_map(place) for place in range(4)]
    assert points == pytest.approx(np.concatenate([p for p, _ in expected]), abs=1e-9)
    assert np.array_equal(colours, np.concatenate([c for _, c in expected]))


def test_cubes_keep_the_mean_of_their_points(dataset: Path, tmp_path: Path) -> None:
    write(dataset, "ply", tmp_path / "ply", voxel_m=20.0)

    points, colours = read_ply(tmp_path / "ply/points.ply")
    everything = [points_map(place) for place in range(4)]
    xyz, rgbs = (np.concatenate([pair[i] for pair in everything]) for i in (0, 1))
    cubes: dict[tuple[int, ...], list[int]] = {}
    for place, cube in enumerate(np.floor(xyz / 20.0).astype(int)):
        cubes.setdefault(tuple(cube), []).append(place)
    expected = sorted(tuple(xyz[some].mean(axis=0)) for some in cubes.values())
    assert len(points) == len(cubes) < len(xyz) / 4
    assert np.array(sorted(map(tuple, points))) == pytest.approx(np.array(expected), abs=1e-6)
    brightest = max(cubes.values(), key=len)
    nearest = np.abs(points - xyz[brightest].mean(axis=0)).sum(axis=1).argmin()
    assert np.abs(colours[nearest] - rgbs[brightest].mean(axis=0)).max() <= 0.5 + 1e-9


def test_las_holds_the_same_points_to_a_tenth_of_a_millimetre(
    dataset: Path, tmp_path: Path
) -> None:
    laspy = pytest.importorskip("laspy", reason="needs the extra `las`")
    write(dataset, "las", tmp_path / "las")

    cloud = laspy.read(tmp_path / "las/points.las")
    expected = [points_map(place) for place in range(4)]
    points = np.concatenate([p for p, _ in expected])
    assert np.abs(cloud.xyz - points).max() <= 0.5e-4 + 1e-9
    colours = np.stack([cloud.red, cloud.green, cloud.blue], axis=1)
    assert np.array_equal(colours, np.concatenate([c for _, c in expected]).astype(int) * 257)


# --- TUM ----------------------------------------------------------------------------------------


def test_tum_lists_have_stamps_poses_and_files(dataset: Path, tmp_path: Path) -> None:
    report = write(dataset, "tum", tmp_path / "tum")

    for place, line in enumerate(data_lines(tmp_path / "tum/groundtruth.txt")):
        stamp, *numbers = line.split()
        assert stamp == f"{STAMPS[place] // 10**9}.{STAMPS[place] % 10**9:09d}"
        t, q = [float(n) for n in numbers[:3]], [float(n) for n in numbers[3:]]
        assert t == pose(place)[:3, 3].tolist()
        assert Rotation.from_quat(q).as_matrix() == pytest.approx(pose(place)[:3, :3], abs=1e-12)
    rows = [line.split() for line in data_lines(tmp_path / "tum/depth.txt")]
    depth = png16(tmp_path / "tum" / rows[1][1]) / 5000
    kept = depth_m(1) < 13.1
    assert np.abs(depth - depth_m(1))[kept].max() <= 1e-4 + 1e-9
    assert not depth[depth_m(1) > 13.11].any()
    assert any("depths lie beyond the range" in loss for loss in report.losses)


def test_several_bridges_go_to_a_folder_each(dataset: Path, tmp_path: Path) -> None:
    report = write(dataset, "tum", tmp_path / "tum", bridges=())

    assert (tmp_path / "tum/B1/rgb.txt").is_file()
    assert (tmp_path / "tum/B3/rgb.txt").is_file()
    assert all(loss.startswith(("B1: ", "B3: ")) for loss in report.losses)
