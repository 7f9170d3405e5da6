"""Sets of every layout become the bridge that they describe, or are refused in words."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from civil_rgbd.errors import BuildError, RecordingError, UsageError
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.format.images import decode_image
from civil_rgbd.importers.registry import IMPORTERS, open_rendered_set
from civil_rgbd.importers.rendered_set import ImportOptions
from civil_rgbd.validation import validate

from . import sets

Take = Any

LAYOUTS: dict[str, tuple[Callable[[Path], Path], float]] = {
    "bridge-rgbd": (sets.bridge_rgbd, 256.0),
    "kitti-depth": (sets.kitti, 256.0),
    "lab": (sets.lab, 1000.0),
    "redwood": (sets.redwood, 1000.0),
    "scannet": (sets.scannet, 1000.0),
    "tum": (sets.tum, 5000.0),
}


def test_every_importer_is_tried() -> None:
    assert {*LAYOUTS, "icl"} == set(IMPORTERS)


@pytest.mark.parametrize("importer", LAYOUTS)
def test_a_set_becomes_the_bridge_that_it_describes(
    importer: str, take: Take, tmp_path: Path
) -> None:
    write, scale = LAYOUTS[importer]

    bridge = take(write(tmp_path / "set"), importer)

    lost = {4} if importer == "scannet" else set()  # its pose is -inf there
    first = 1 if importer == "lab" else 0
    kept = [frame for frame in range(sets.FRAMES) if frame not in lost]
    assert [row.source_index for row in bridge.rows] == [frame + first for frame in kept]
    camera = bridge.camera
    assert (camera.width_px, camera.height_px) == (sets.WIDTH, sets.HEIGHT)
    K = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    assert pytest.approx((sets.FX, sets.FY, sets.CX, sets.CY)) == K
    for row, frame in zip(bridge.rows, kept, strict=True):
        assert np.array_equal(bridge.read_rgb(row), sets.rgb(frame))
        depth_m, expected_m = bridge.read_depth(row), sets.depth_m(frame)
        assert np.array_equal(depth_m == 0, expected_m == 0)
        assert np.abs(depth_m - expected_m).max() <= 0.5 / scale + 1e-5
        typed = 1e-6 if importer in {"scannet", "redwood"} else 1e-9
        tolerance = 1e-4 if importer == "tum" else typed  # between two poses of a curve
        assert transform_of(row) == pytest.approx(sets.pose(frame), abs=tolerance)
    assert bridge.manifest.counts.dropped == ({"no_pose": 1} if lost else {})


@pytest.mark.parametrize("importer", LAYOUTS)
def test_the_bridge_is_valid_and_says_that_it_was_imported(
    importer: str, take: Take, tmp_path: Path
) -> None:
    manifest = take(LAYOUTS[importer][0](tmp_path / "set"), importer).manifest

    report = validate(tmp_path / "dataset")
    assert [finding.code for finding in report.findings] == []
    assert (manifest.origin, manifest.recipe, manifest.rig, manifest.deskew) == (
        *("imported", None),
        *(None, None),
    )
    assert [source.converter for source in manifest.sources] == [importer]
    assert manifest.reading == {
        "depth_scale": f"{LAYOUTS[importer][1]:g}",
        "depth_along": "z",
        "direction": "camera-to-map",
    }


@pytest.mark.parametrize("importer", ["bridge-rgbd", "kitti-depth", "lab", "tum"])
def test_stamps_are_kept_to_the_nanosecond(importer: str, take: Take, tmp_path: Path) -> None:
    bridge = take(LAYOUTS[importer][0](tmp_path / "set"), importer)

    assert [row.stamp_ns for row in bridge.rows] == [sets.stamp_ns(i) for i in range(sets.FRAMES)]


def test_a_set_without_stamps_says_so(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.redwood(tmp_path / "set"), "redwood")

    assert [row.stamp_ns for row in bridge.rows][:3] == [0, 10**9, 2 * 10**9]
    assert any("no time stamps" in warning for warning in bridge.manifest.warnings)


def test_the_hash_of_a_set_is_that_of_a_list_that_sha256sum_writes(
    take: Take, tmp_path: Path
) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")

    (source,) = take(root, "bridge-rgbd").manifest.sources

    files = sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())
    lines = [f"{hashlib.sha256((root / name).read_bytes()).hexdigest()}  {name}" for name in files]
    expected = hashlib.sha256(("\n".join(lines) + "\n").encode()).hexdigest()
    assert source.sha256 == expected
    assert source.name == "set"
    assert source.size_bytes == sum((root / name).stat().st_size for name in files)


# --- the depth scale --------------------------------------------------------------------------


def test_millimetres_where_256_is_usual_are_found_by_the_poses(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.bridge_rgbd(tmp_path / "set", scale=1000.0), "bridge-rgbd")

    assert np.abs(bridge.read_depth(bridge.rows[0]) - sets.depth_m(0)).max() < 6e-4
    assert any(
        "1000 instead of 256" in said and "pairs of frames differ" in said
        for said in bridge.manifest.warnings
    )


def test_256_where_millimetres_are_usual_is_found_by_the_poses(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.bridge_rgbd(tmp_path / "set", scale=256.0), "lab")

    assert np.abs(bridge.read_depth(bridge.rows[0]) - sets.depth_m(0)).max() < 3e-3


def test_a_proven_scale_needs_no_warning(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.bridge_rgbd(tmp_path / "set"), "bridge-rgbd")

    assert bridge.manifest.warnings == ()


def test_a_given_scale_is_taken_and_the_contradiction_kept(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.bridge_rgbd(tmp_path / "set"), "bridge-rgbd", depth_scale=1000.0)

    ratio = bridge.read_depth(bridge.rows[0])[30, 30] / sets.depth_m(0)[30, 30]
    assert ratio == pytest.approx(0.256, rel=1e-3)
    (warning,) = bridge.manifest.warnings
    assert "1000 was given" in warning
    assert "they prove x 256" in warning


def test_a_layouts_scale_that_the_poses_contradict_is_refused_though_they_prove_no_other(
    take: Take, tmp_path: Path
) -> None:
    """Millimetres under a layout of 256, through a camera that is not the set's."""
    root = sets.bridge_rgbd(tmp_path / "set", scale=1000.0)
    wrong = f"{sets.FX * 0.55},{sets.FY * 0.55},{sets.CX},{sets.CY}"

    with pytest.raises(RecordingError, match="contradict the depth scale 256") as caught:
        take(root, "bridge-rgbd", intrinsics=wrong)
    assert "they do not tell" in caught.value.what
    assert "--depth-scale 1000 fits best" in caught.value.fix
    assert "--intrinsics" in caught.value.fix
    given = take(root, "bridge-rgbd", intrinsics=wrong, depth_scale=256.0)
    (*_, warning) = given.manifest.warnings
    assert "256 is what --depth-scale says; the poses do not prove it" in warning


def test_a_camera_that_only_turns_proves_no_scale(take: Take, tmp_path: Path) -> None:
    root = tmp_path / "set"

    def turning(frame: int) -> np.ndarray[Any, Any]:
        T = sets.pose(frame)
        T[:3, 3] = 0.0
        return T

    depths = lambda frame: sets.depth_m(frame, T=turning(frame))  # noqa: E731  # one line says it
    sets.write_images(root / "rgb", root / "depth", scale=1000.0, z=depths)
    sets.lab_intrinsics(root)
    sets.lab_poses(root, T=turning)

    bridge = take(root, "bridge-rgbd")

    assert any(
        "256 is what the layout bridge-rgbd says; the poses do not prove it" in said
        for said in bridge.manifest.warnings
    )


# --- poses the wrong way round, fy < 0 ----------------------------------------------------------


def test_poses_the_wrong_way_round_are_noticed(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    sets.lab_poses(root, T=lambda frame: np.linalg.inv(sets.pose(frame)))

    with pytest.raises(RecordingError, match="the other way round") as caught:
        take(root, "bridge-rgbd")

    assert caught.value.fix == "give --direction map-to-camera"
    bridge = take(root, "bridge-rgbd", direction="map-to-camera")
    assert transform_of(bridge.rows[7]) == pytest.approx(sets.pose(7), abs=1e-9)


def test_a_negative_fy_mirrors_the_map_and_keeps_the_pixels(take: Take, tmp_path: Path) -> None:
    bridge = take(sets.upside_down(tmp_path / "set"), "icl")

    assert bridge.camera.fy_px == sets.FY
    for frame, row in enumerate(bridge.rows):
        T = transform_of(row)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        assert pytest.approx(sets.M @ sets.pose(frame) @ sets.M, abs=1e-9) == T
        depth_m = bridge.read_depth(row)
        assert np.abs(depth_m - sets.depth_m(frame, fy=-sets.FY)).max() < 2e-4
        assert np.array_equal(bridge.read_rgb(row), sets.rgb(frame))
        # Mirrored planes: what the stored frame says lies on them.
        v, u = np.nonzero(depth_m)
        z = depth_m[v, u].astype(float)
        x, y = (u - sets.CX) / sets.FX * z, (v - sets.CY) / sets.FY * z
        points = np.stack([x, y, z], axis=1) @ T[:3, :3].T + T[:3, 3]
        off = [np.abs((points * [1, -1, 1]) @ np.array(n) - d) for n, d in sets.PLANES]
        assert np.min(off, axis=0).max() < 1e-3


# --- damage, gaps, and what is there already ------------------------------------------------------


def test_damaged_and_missing_files_are_counted(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    cut = root / "depth" / "000003.png"
    cut.write_bytes(cut.read_bytes()[:-30])
    flipped = root / "rgb" / "000005.png"
    data = bytearray(flipped.read_bytes())
    data[len(data) // 2] ^= 0x10
    flipped.write_bytes(data)
    (root / "depth" / "000008.png").unlink()
    sets.write_png(root / "depth" / "000099.png", np.zeros((4, 4), dtype=np.uint16))
    poses = (root / "poses.csv").read_text().splitlines()
    (root / "poses.csv").write_text("\n".join(poses[:2] + poses[3:]))
    sets.write_png(root / "rgb" / "000006.png", np.zeros((9, 9, 3), dtype=np.uint8))

    bridge = take(root, "bridge-rgbd")

    counts = bridge.manifest.counts
    assert counts.dropped == {
        "unreadable_image": 2,
        "no_depth_image": 1,
        "no_pose": 1,
        "other_size": 1,
    }
    assert counts.images_seen == sets.FRAMES == counts.frames_kept + sum(counts.dropped.values())
    assert counts.skipped == {"depth_without_image": 1}
    assert not validate(tmp_path / "dataset").errors


def test_depth_at_the_16_bit_limit_is_no_measurement(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    path = root / "depth" / "000002.png"
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    codes[20, 20:23] = 65535
    sets.write_png(path, codes)

    bridge = take(root, "bridge-rgbd")

    assert not bridge.read_depth(bridge.rows[2])[20, 20:23].any()
    assert any("3 depths were at the 16-bit limit" in said for said in bridge.manifest.warnings)


def test_a_picture_of_depth_is_refused(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    for path in (root / "depth").iterdir():
        sets.write_png(path, np.full((sets.HEIGHT, sets.WIDTH), 9, dtype=np.uint8))

    with pytest.raises(RecordingError, match=r"uint8 of shape .* not 16 bits in one channel"):
        take(root, "bridge-rgbd")

    assert not (tmp_path / "dataset").exists()


def test_a_bridge_that_is_there_is_not_replaced_unasked(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    take(root, "bridge-rgbd")
    before = (tmp_path / "dataset/bridges/B3/manifest.json").read_bytes()

    with pytest.raises(BuildError, match="lies here already") as caught:
        take(root, "bridge-rgbd")

    assert "--overwrite" in caught.value.fix
    assert (tmp_path / "dataset/bridges/B3/manifest.json").read_bytes() == before
    take(root, "bridge-rgbd", overwrite=True)
    assert (tmp_path / "dataset/bridges/B3/manifest.json").read_bytes() == before
    assert {p.name for p in (tmp_path / "dataset").iterdir()} == {"bridges", "dataset.json"}


def test_an_interrupted_conversion_leaves_nothing(
    take: Take, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from civil_rgbd.importers.frame_reader import FrameReader

    read = FrameReader.read

    def stop_at_seven(self: FrameReader, frame: Any, *, scale: float) -> Any:
        if frame.source_index == 7:
            raise KeyboardInterrupt
        return read(self, frame, scale=scale)

    monkeypatch.setattr(FrameReader, "read", stop_at_seven)

    with pytest.raises(KeyboardInterrupt):
        take(sets.bridge_rgbd(tmp_path / "set"), "bridge-rgbd")

    assert not [path for path in (tmp_path / "dataset").rglob("*") if path.is_file()]


def test_a_near_miss_names_the_importer(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        open_rendered_set(tmp_path, "bridge_rgbd", ImportOptions())

    assert caught.value.fix.startswith("did you mean 'bridge-rgbd'?")


def test_png_keeps_the_pixels_of_jpeg_sources(take: Take, tmp_path: Path) -> None:
    root = sets.bridge_rgbd(tmp_path / "set")
    for path in sorted((root / "rgb").iterdir()):
        assert cv2.imwrite(str(path.with_suffix(".jpg")), cv2.imread(str(path)))
        path.unlink()

    bridge = take(root, "bridge-rgbd")

    source = decode_image((root / "rgb" / "000004.jpg").read_bytes(), where="rgb")
    assert np.array_equal(bridge.read_rgb(bridge.rows[4]), source)
