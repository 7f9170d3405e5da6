"""Pictures and depth against OpenCV's projection and numbers by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.simulator.bridge import caster_of
from civil_rgbd.simulator.camera import (
    D455,
    lens_rays,
    pinhole_rays,
    raw_camera,
    render_depth,
    simulate_jpeg,
    true_camera_pose,
    true_depth,
)
from civil_rgbd.simulator.lidar import simulate_scan
from civil_rgbd.simulator.scene import RayCaster, Scene, polygon
from civil_rgbd.simulator.shading import Painter
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import START_NS, image_instants_ns, imu_poses

SMALL = ScanSpec(seconds=2.0, image_scale=0.25, point_rate_hz=60_000)
PINHOLE = PinholeCamera(64, 48, 40.0, 41.0, 31.2, 23.9)
COEFFICIENTS = np.array(D455.coefficients)


def _looking(rotation: np.ndarray, place: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, place
    return T


UPWARDS = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])  # optical axis along scene z
AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # optical axis along scene x


def test_a_soffit_five_metres_above_gives_five_in_every_pixel_that_it_covers() -> None:
    narrow = PinholeCamera(40, 30, 200.0, 200.0, 19.5, 14.5)

    depth = render_depth(caster_of("demo"), narrow, _looking(UPWARDS, (0.0, -6.0, 0.9)))

    assert np.abs(depth - 5.0).max() < 1e-12


def test_turning_the_camera_about_its_axis_does_not_change_a_flat_soffit() -> None:
    narrow = PinholeCamera(40, 30, 200.0, 200.0, 19.5, 14.5)
    turned = Rotation.from_euler("z", 33.0, degrees=True).as_matrix()

    depth = render_depth(caster_of("demo"), narrow, _looking(turned, (0.0, -6.0, 0.9)))

    assert np.abs(depth - 5.0).max() < 1e-12


def test_depth_is_along_the_optical_axis_and_pixels_are_centres() -> None:
    wall = polygon("w", "wall", [(5, 9, -9), (5, -9, -9), (5, -9, 9), (5, 9, 9)])
    turned = AHEAD @ Rotation.from_euler("y", 30.0, degrees=True).as_matrix()

    depth = render_depth(RayCaster(Scene("t", (wall,))), PINHOLE, _looking(turned, (0.0, 0.0, 0.0)))

    # A wall turned by 30 degrees: 5 = Z (cos 30 - x sin 30), x = (u - cx) / fx.
    x = (np.arange(64) - 31.2) / 40.0
    row = 5.0 / (np.cos(np.radians(30)) - x * np.sin(np.radians(30)))
    expected = np.broadcast_to(row, depth.shape)
    np.testing.assert_allclose(depth[:, 20:50], expected[:, 20:50], rtol=1e-12)


def test_the_sky_has_no_depth() -> None:
    depth = render_depth(caster_of("demo"), PINHOLE, _looking(UPWARDS, (-60.0, 0.0, 1.5)))

    assert (depth == 0).all()


def test_lens_rays_come_back_to_their_pixels_through_opencv() -> None:
    camera = raw_camera(1.0)
    x, y = lens_rays(camera)
    spots = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    pixels, _ = cv2.projectPoints(
        spots, np.zeros(3), np.zeros(3), camera.pinhole.matrix, COEFFICIENTS
    )

    v, u = np.mgrid[:720, :1280]
    error = pixels.reshape(720, 1280, 2) - np.stack([u, v], axis=-1)
    assert np.abs(error).max() < 1e-6


def test_lens_rays_agree_with_opencvs_undistortion() -> None:
    camera = raw_camera(0.25)
    v, u = np.mgrid[:180, :320]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14)
    iterated = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # its name before 5.0
    K = camera.pinhole.matrix
    rays = iterated(pixels[:, np.newaxis], K, COEFFICIENTS, R=None, P=None, criteria=criteria)

    np.testing.assert_allclose(lens_rays(camera).reshape(2, -1).T, rays[:, 0], rtol=0, atol=1e-8)


def test_a_lens_that_cannot_be_inverted_is_refused() -> None:
    wild = LensCamera(PinholeCamera(64, 48, 20.0, 20.0, 32.0, 24.0), "plumb_bob", (-3.0, 0, 0, 0))

    with pytest.raises(ValueError, match="cannot be inverted"), np.errstate(all="ignore"):
        lens_rays(wild)


def test_a_corner_appears_where_opencv_projects_it_through_the_lens() -> None:
    # A yellow plate before a dark wall, seen askew, its corners towards the image's edges.
    corners = np.array([[4, 2.6, -1.2], [4, -2.3, -1.2], [4, -2.3, 1.4], [4, 2.6, 1.4]])
    wall = polygon("w", "rubber", [(5, 20, -20), (5, -20, -20), (5, -20, 20), (5, 20, 20)])
    painter = Painter(RayCaster(Scene("t", (wall, polygon("s", "sign", corners)))))
    camera = raw_camera(0.5)
    tilt = Rotation.from_euler("xyz", [4, -3, 2], degrees=True).as_matrix()
    T_scene_camera = _looking(AHEAD @ tilt, (0.1, 0.05, -0.1))

    rgb = painter.paint(lens_rays(camera), camera.pinhole.fx_px, T_scene_camera)

    T_camera_scene = np.linalg.inv(T_scene_camera)
    edge = np.linspace(corners, np.roll(corners, -1, axis=0), 400, endpoint=False)
    outline, _ = cv2.projectPoints(
        edge.transpose(1, 0, 2).reshape(-1, 3),
        cv2.Rodrigues(T_camera_scene[:3, :3])[0],
        T_camera_scene[:3, 3],
        camera.pinhole.matrix,
        COEFFICIENTS,
    )
    yellow = (rgb[..., 0].astype(int) - rgb[..., 2]) > 60
    polygon_px = outline.astype(np.float32)
    corners_px = [np.rint(outline).astype(int)]
    filled = cv2.fillPoly(np.zeros((360, 640), np.uint8), corners_px, 1)
    band = cv2.dilate(filled, np.ones((5, 5))) - cv2.erode(filled, np.ones((5, 5)))
    np.testing.assert_array_equal(yellow[band == 0], filled[band == 0] == 1)
    v, u = np.nonzero(band)
    inside = np.array(
        [
            cv2.pointPolygonTest(polygon_px, (float(a), float(b)), measureDist=True)
            for a, b in zip(u, v, strict=True)
        ]
    )
    assert yellow[v, u][inside > 0.02].all()  # to a fiftieth of a pixel
    assert not yellow[v, u][inside < -0.02].any()
    assert 40_000 < yellow.sum() < 120_000


def test_true_depth_agrees_with_the_lidar_at_the_same_instant() -> None:
    # Points of 2 ms around an image, moved and projected by scipy and OpenCV.
    index, spec = 10, ScanSpec(seconds=2.0)
    instant = int(image_instants_ns(spec)[index])
    camera = D455.pinhole.scaled(0.6)
    depth = true_depth(spec, index, camera)
    scan = simulate_scan(spec, (instant - START_NS) // 100_000_000)
    stamps = scan.stamp_ns + scan.offset_ns.astype(np.int64)
    near = (np.abs(stamps - instant) < 2_000_000) & scan.points_lidar.any(axis=1)
    places, turns = imu_poses(spec, stamps[near])
    in_imu = scan.points_lidar[near] + np.array([0.04165, 0.02326, -0.0284])
    in_map = places + Rotation.from_quat(turns).apply(in_imu)
    T_camera_map = np.linalg.inv(true_camera_pose(spec, index))
    z = in_map @ T_camera_map[2, :3] + T_camera_map[2, 3]
    pixels, _ = cv2.projectPoints(
        in_map, cv2.Rodrigues(T_camera_map[:3, :3])[0], T_camera_map[:3, 3], camera.matrix, None
    )
    u, v = pixels[:, 0].T
    seen = (z > 0) & (u > 1) & (u < 766) & (v > 1) & (v < 430)
    column, row = np.floor(u[seen]).astype(int), np.floor(v[seen]).astype(int)
    around = np.stack([depth[row + i, column + j] for i in (0, 1) for j in (0, 1)])
    fits = (z[seen] > around.min(axis=0) - 1e-4) & (z[seen] < around.max(axis=0) + 1e-4)

    assert len(fits) > 300
    assert fits.mean() > 0.99  # the camera sees round some corners that the LiDAR does not


def test_true_depth_is_seen_from_the_pose_at_the_images_instant() -> None:
    still, moving = (true_depth(ScanSpec(speed_m_s=s), 20, PINHOLE) for s in (0.0, 1.3))

    assert (still != moving).mean() > 0.3


def test_a_far_away_map_sees_the_same_picture_and_depth() -> None:
    offset = (540_000.0, 4_810_000.0, 330.0)
    far = ScanSpec(seconds=2.0, image_scale=0.25, map_offset_m=offset)
    near = ScanSpec(seconds=2.0, image_scale=0.25)

    np.testing.assert_allclose(
        true_depth(far, 3, PINHOLE), true_depth(near, 3, PINHOLE), rtol=0, atol=2e-7
    )
    np.testing.assert_allclose(
        true_camera_pose(far, 3)[:3, 3] - offset,
        true_camera_pose(near, 3)[:3, 3],
        rtol=0,
        atol=1e-9,
    )


def test_a_picture_is_bright_detailed_and_the_same_each_time() -> None:
    jpeg = simulate_jpeg(SMALL, 4)
    rgb = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)

    assert rgb.shape == (180, 320, 3)
    assert 60 < rgb.mean() < 190
    assert rgb.std() > 30
    assert jpeg == simulate_jpeg(SMALL, 4)
    assert jpeg != simulate_jpeg(SMALL, 5)
    assert jpeg != simulate_jpeg(ScanSpec(seconds=2.0, image_scale=0.25, seed=1), 4)


def test_the_jpeg_keeps_red_green_and_blue_apart() -> None:
    bgr = cv2.imdecode(np.frombuffer(simulate_jpeg(SMALL, 0), np.uint8), cv2.IMREAD_COLOR).astype(
        int
    )
    depth = true_depth(SMALL, 0, raw_camera(0.25).pinhole)
    yellow = (bgr[..., 2] - bgr[..., 0]) > 100

    assert yellow.sum() > 50  # the sign on the parapet: red over blue
    assert (bgr[..., 0] - bgr[..., 2])[depth == 0].mean() > 5  # the sky: blue over red


def test_every_image_has_its_own_noise() -> None:
    still = ScanSpec(seconds=1.0, image_scale=0.1, speed_m_s=0.0)

    assert simulate_jpeg(still, 0) != simulate_jpeg(still, 1)


def test_pinhole_rays_pass_through_pixel_centres() -> None:
    x, y = pinhole_rays(PinholeCamera(3, 2, 2.0, 4.0, 1.0, 0.5))

    assert x.tolist() == [[-0.5, 0.0, 0.5]] * 2
    assert y.tolist() == [[-0.125] * 3, [0.125] * 3]
