"""Geometry proved from outside: nothing of ``civil_rgbd.geometry`` on the expected side.

A mistake that the simulator shares with the renderer would cancel out. Here OpenCV projects, SciPy
interpolates, numpy inverts, and the recording is made from what they say: landmarks in the map,
seen by a LiDAR and a camera that move and turn, mounted askew, on clocks that differ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recipe import (
    AccumulateStage,
    DepthStage,
    FilterStage,
    ImageStage,
    Recipe,
    SelectStage,
)
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.frames import FrameMaker

from .recordings import MemoryRecording, standing_still, trajectory_of
from .reference.pose import pose_at

MS = 10**6
SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND
SIZE = (640, 360)
K = np.array([[318.26, 0.0, 317.6], [0.0, 310.9, 184.8], [0.0, 0.0, 1.0]])
LENSES = {
    "none": (),
    "plumb_bob": (-0.08, 0.05, 0.004, -0.007, -0.01),
    "rational_polynomial": (0.1, -0.05, 0.003, -0.006, 0.01, 0.15, -0.03, 0.01),
    "fisheye": (0.05, -0.02, 0.004, -0.001),
}
OFFSET_S = 0.037  # the camera's clock is behind the LiDAR's: add this
SCALE = 0.6
K_STORED = np.array(
    [
        [318.26 * 0.6, 0.0, (317.6 + 0.5) * 0.6 - 0.5],
        [0.0, 310.9 * 0.6, (184.8 + 0.5) * 0.6 - 0.5],
        [0.0, 0.0, 1.0],
    ]
)


def rigid(
    rotation_deg: tuple[float, float, float], t: tuple[float, float, float]
) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
    T[:3, 3] = t
    return T


FORWARD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Camera axes (right, down, forward) in a body whose x is forward, y left, z up."""

T_BODY_CAMERA = rigid((3, -5, 4), (0.12, -0.21, 0.33)) @ FORWARD
T_BODY_LIDAR = rigid((-8, 4, 7), (-0.25, 0.14, -0.4))


@dataclass(frozen=True)
class Walk:
    """Poses of the body each 0.1 s: it walks some 1.5 m/s and turns some 40 deg/s."""

    stamps_ns: list[int]
    positions: list[list[float]]
    quaternions: list[list[float]]

    def pose(self, stamp_ns: int) -> NDArray[np.float64]:
        """T_map_body, by SciPy."""
        return pose_at(self.stamps_ns, self.positions, self.quaternions, stamp_ns)


def a_walk(seed: int) -> Walk:
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(scale=0.06, size=(21, 3)), axis=0))
    steps = rng.normal([0.15, 0.0, 0.0], 0.03, size=(21, 3))
    return Walk(
        stamps_ns=[EPOCH + i * 100 * MS for i in range(21)],
        positions=(np.array([12.3, -4.6, 1.2]) + np.cumsum(steps, axis=0)).tolist(),
        quaternions=turns.as_quat(canonical=True).tolist(),
    )


def camera_pose(walk: Walk, image_stamp_ns: int) -> NDArray[np.float64]:
    return walk.pose(image_stamp_ns + round(OFFSET_S * 1e9)) @ T_BODY_CAMERA


def projected(
    landmarks_map: NDArray[np.float64],
    T_map_camera: NDArray[np.float64],
    matrix: NDArray[np.float64],
    lens: str,
) -> NDArray[np.float64]:
    """(N, 2) pixels, by OpenCV."""
    T_camera_map = np.linalg.inv(T_map_camera)
    rvec, t = cv2.Rodrigues(T_camera_map[:3, :3])[0], T_camera_map[:3, 3]
    k = np.array(LENSES[lens]) if LENSES[lens] else np.zeros(4)
    if lens == "fisheye":
        points = landmarks_map.reshape(-1, 1, 3)
        return cv2.fisheye.projectPoints(points, rvec, t, matrix, k)[0].reshape(-1, 2)
    return cv2.projectPoints(landmarks_map, rvec, t, matrix, k)[0].reshape(-1, 2)


def landmarks_before(
    T_map_camera: NDArray[np.float64], rng: np.random.Generator, count: int
) -> NDArray[np.float64]:
    """Points of the map that the stored image shows, none near a rounding boundary."""
    found: list[NDArray[np.float64]] = []
    while len(found) < count:
        x, y, z = rng.uniform([-0.9, -0.5, 4], [0.9, 0.5, 40])
        landmark = (T_map_camera @ [x * z, y * z, z, 1])[:3]
        u, v = projected(landmark[None], T_map_camera, K_STORED, "none")[0]
        inside = -0.5 < u < 0.6 * SIZE[0] - 0.5 and -0.5 < v < 0.6 * SIZE[1] - 0.5
        if inside and all(0.02 < (value + 0.5) % 1 < 0.98 for value in (u, v)):
            found.append(landmark)
    return np.array(found)


def seen_by_lidar(
    walk: Walk, landmarks_map: NDArray[np.float64], stamps_ns: list[int]
) -> NDArray[np.float32]:
    """(N, 3) points in the LiDAR frame, each at its own time, by numpy's inverse."""
    return np.array(
        [
            (np.linalg.inv(walk.pose(stamp) @ T_BODY_LIDAR) @ [*landmark, 1.0])[:3]
            for landmark, stamp in zip(landmarks_map, stamps_ns, strict=True)
        ],
        dtype=np.float32,
    )


RECIPE = Recipe(
    "proof",
    select=SelectStage(min_displacement_m=0.0),
    filter=FilterStage(min_range_m=0.5, max_range_m=200.0),
    accumulate=AccumulateStage(points=200, min_fill=1.0),
    image=ImageStage(scale=SCALE),
    depth=DepthStage(step_m=0.0),
)


def the_frame(
    walk: Walk,
    lens: str,
    scans: list[LidarScan],
    raw_rgb: NDArray[np.uint8],
    image_stamp_ns: int,
    recipe: Recipe = RECIPE,
) -> RgbdFrame:
    pinhole = PinholeCamera(*SIZE, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    recording = MemoryRecording(
        rig=Rig(LensCamera(pinhole, lens, LENSES[lens]), T_BODY_CAMERA, T_BODY_LIDAR, OFFSET_S),
        trajectory=trajectory_of(walk.stamps_ns, walk.positions, walk.quaternions),
        scans=scans,
        image_stamps_ns=np.array([image_stamp_ns]),
        images=[raw_rgb],
    )
    plan = plan_frames(recording, recipe)
    (outcome,) = FrameMaker(recording, recipe).make(plan.frames)
    assert outcome.frame is not None, outcome.dropped
    return outcome.frame


BLANK = np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("window", ["past", "future"])
def test_every_landmark_appears_in_the_pixel_and_at_the_depth_that_opencv_says(
    seed: int, window: str
) -> None:
    rng = np.random.default_rng(seed)
    walk = a_walk(seed)
    image_stamp_ns = EPOCH + 1003 * MS
    T_map_camera = camera_pose(walk, image_stamp_ns)
    landmarks = landmarks_before(T_map_camera, rng, 200)
    # Up to the last nanosecond before the corrected stamp, or from that very nanosecond on.
    now = image_stamp_ns + round(OFFSET_S * 1e9)
    times = [*sorted(rng.integers(EPOCH, now, size=199).tolist()), now - 1]
    if window == "future":
        times = [now, *sorted(rng.integers(now, EPOCH + 2 * SECOND, size=199).tolist())]
    points = seen_by_lidar(walk, landmarks, times)
    scans = [
        LidarScan(
            times[first] - 7 * MS, points[first : first + 20], np.array(times[first : first + 20])
        )
        for first in range(0, 200, 20)
    ]
    # Points on the other side of the image's stamp, where they would win every pixel.
    decoy_time = now if window == "past" else now - 1
    decoys = (landmarks + T_map_camera[:3, 3]) / 2
    decoy = LidarScan(
        decoy_time, seen_by_lidar(walk, decoys, [decoy_time] * 200), np.full(200, decoy_time)
    )
    scans = [*scans, decoy] if window == "past" else [decoy, *scans]
    uv = np.floor(projected(landmarks, T_map_camera, K_STORED, "none") + 0.5).astype(int)
    depth = (np.linalg.inv(T_map_camera) @ np.c_[landmarks, np.ones(200)].T)[2]
    expected = np.full((216, 384), np.inf)
    np.minimum.at(expected, (uv[:, 1], uv[:, 0]), depth)
    expected[np.isinf(expected)] = 0

    recipe = replace(RECIPE, accumulate=AccumulateStage(points=200, window=window))
    frame = the_frame(walk, "none", scans, BLANK, image_stamp_ns, recipe)

    np.testing.assert_array_equal(np.argwhere(frame.depth_m), np.argwhere(expected))
    np.testing.assert_allclose(frame.depth_m, expected, rtol=0, atol=2e-5)
    np.testing.assert_allclose(frame.T_map_camera, T_map_camera, rtol=0, atol=1e-9)
    assert frame.stamp_ns == now
    assert frame.source_stamp_ns == image_stamp_ns


def dots(uv: NDArray[np.float64], sigma_px: float) -> NDArray[np.uint8]:
    """A raw image with a soft white dot at each place."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    light = np.zeros(x.shape)
    for u, v in uv:
        light += np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma_px**2))
    return np.repeat(np.round(250 * light.clip(0, 1)).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("lens", list(LENSES))
def test_the_picture_shows_every_landmark_where_its_depth_is(lens: str) -> None:
    walk = a_walk(11)
    image_stamp_ns = EPOCH + 1203 * MS
    T_map_camera = camera_pose(walk, image_stamp_ns)
    rays = [(x, y) for x in (-0.75, -0.35, 0.05, 0.4, 0.8) for y in (-0.42, 0.02, 0.38)]
    landmarks = np.array([(T_map_camera @ [9 * x, 9 * y, 9, 1])[:3] for x, y in rays])
    raw_rgb = dots(projected(landmarks, T_map_camera, K, lens), sigma_px=2.0)
    stored_uv = projected(landmarks, T_map_camera, K_STORED, "none")
    times = [EPOCH + 900 * MS + i * MS for i in range(15)]
    scans = [LidarScan(times[0], seen_by_lidar(walk, landmarks, times), np.array(times))]
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=15))

    frame = the_frame(walk, lens, scans, raw_rgb, image_stamp_ns, recipe)

    drawn = np.argwhere(frame.depth_m)[:, ::-1]
    for u, v in stored_uv:
        column, row = round(u), round(v)
        patch = frame.rgb[row - 7 : row + 8, column - 7 : column + 8, 0].astype(float)
        down, across = np.mgrid[row - 7 : row + 8, column - 7 : column + 8]
        centre = ((patch * across).sum() / patch.sum(), (patch * down).sum() / patch.sum())
        # A plain scaling of the principal point would miss by 0.28 px.
        # The dot itself is a little askew, as the lens stretches its sides unevenly.
        assert math.dist(centre, (u, v)) < 0.1
        assert np.abs(drawn - centre).max(axis=1).min() <= 0.6


# --- numbers by hand --------------------------------------------------------------------------


def test_one_point_all_the_way_by_hand() -> None:
    """The body stands at (100, 50, 2) and looks north (map y): it is turned 90 deg left.

    The LiDAR sits 1 m ahead of it, upside down (turned 180 deg about x). A return at
    (9, 2, -3) in the LiDAR is (10, -2, 3) in the body (ahead, left, up): x + 1, y and z negated.
    In the map that is (100 + 2, 50 + 10, 2 + 3) = (102, 60, 5).
    The camera sits 0.5 m above the body and looks ahead: the point is 2 m right of it, 2.5 m above
    it and 10 m ahead: (2, -2.5, 10) in the camera.
    With f = 100, c = (60, 40): u = 60 + 100 * 0.2 = 80, v = 40 - 100 * 0.25 = 15.
    """
    half = math.sqrt(0.5)
    T_body_camera = FORWARD.copy()
    T_body_camera[2, 3] = 0.5
    T_body_lidar = np.diag([1.0, -1.0, -1.0, 1.0])
    T_body_lidar[0, 3] = 1.0
    recording = MemoryRecording(
        rig=Rig(
            LensCamera(PinholeCamera(121, 81, 100.0, 100.0, 60.0, 40.0)),
            T_body_camera,
            T_body_lidar,
        ),
        trajectory=trajectory_of([0, SECOND // 10], [(100, 50, 2)] * 2, [(0, 0, half, half)] * 2),
        scans=[LidarScan(10, np.array([[9, 2, -3]], np.float32))],
        image_stamps_ns=np.array([20]),
        images=[np.zeros((81, 121, 3), dtype=np.uint8)],
    )
    recipe = replace(RECIPE, accumulate=AccumulateStage(points=1), image=ImageStage(scale=1.0))
    plan = plan_frames(recording, recipe)

    (outcome,) = FrameMaker(recording, recipe).make(plan.frames)

    assert outcome.frame is not None
    assert np.argwhere(outcome.frame.depth_m).tolist() == [[15, 80]]
    assert outcome.frame.depth_m[15, 80] == pytest.approx(10.0, abs=1e-6)
    np.testing.assert_allclose(outcome.frame.T_map_camera[:3, 3], [100, 50, 2.5], atol=1e-12)
    # The optical axis (the third column) points north.
    np.testing.assert_allclose(outcome.frame.T_map_camera[:3, 2], [0, 1, 0], atol=1e-12)


def test_the_extrinsics_of_the_manifest_take_camera_points_to_the_lidar() -> None:
    # The LiDAR is 1 m ahead of the body, the camera 0.5 m above it: seen from the LiDAR the camera
    # is 1 m behind and 0.5 m above, and its axis is the LiDAR's x.
    T_body_camera, T_body_lidar = FORWARD.copy(), np.eye(4)
    T_body_camera[2, 3], T_body_lidar[0, 3] = 0.5, 1.0
    rig = Rig(LensCamera(PinholeCamera(4, 4, 1.0, 1.0, 0.0, 0.0)), T_body_camera, T_body_lidar)

    assert rig.T_lidar_camera[:3, 3].tolist() == [-1, 0, 0.5]
    assert rig.T_lidar_camera[:3, 2].tolist() == [1, 0, 0]
    np.testing.assert_allclose(
        rig.T_lidar_camera, np.linalg.inv(T_body_lidar) @ T_body_camera, atol=1e-15
    )


def test_the_extrinsics_of_a_turned_lidar_are_numpys() -> None:
    rig = Rig(
        LensCamera(PinholeCamera(4, 4, 1.0, 1.0, 0.0, 0.0)), T_BODY_CAMERA, T_BODY_LIDAR, OFFSET_S
    )

    expected = np.linalg.inv(T_BODY_LIDAR) @ T_BODY_CAMERA
    np.testing.assert_allclose(rig.T_lidar_camera, expected, atol=1e-12)
    assert rig.camera_time_offset_ns == 37_000_000


def test_a_body_that_turns_on_the_spot_moves_its_camera() -> None:
    # The camera is 1 m ahead of the body: a turn by 0.2 rad moves it by 2 sin 0.1 = 0.1997 m.
    T_body_camera = FORWARD.copy()
    T_body_camera[0, 3] = 1.0
    turned = (0.0, 0.0, math.sin(0.1), math.cos(0.1))
    recording = MemoryRecording(
        rig=Rig(LensCamera(PinholeCamera(4, 4, 1.0, 1.0, 0.0, 0.0)), T_body_camera, np.eye(4)),
        trajectory=trajectory_of([0, 10], [(7, 8, 9)] * 2, [(0, 0, 0, 1), turned]),
        image_stamps_ns=np.array([0, 10]),
    )

    kept = [
        len(plan_frames(recording, replace(RECIPE, select=SelectStage(limit))).frames)
        for limit in (0.1996, 0.1997)
    ]

    assert kept == [2, 1]


def test_a_camera_clock_that_is_behind_gets_its_offset_added() -> None:
    # The body passes x = 3 m at 3 s of the LiDAR's clock; the camera is 0.5 s behind: 2.5 s.
    recording = MemoryRecording(
        rig=Rig(
            LensCamera(PinholeCamera(4, 4, 1.0, 1.0, 0.0, 0.0)),
            np.eye(4),
            np.eye(4),
            camera_time_offset_s=0.5,
        ),
        trajectory=trajectory_of(
            [i * SECOND // 10 for i in range(51)], [(0.1 * i, 0, 0) for i in range(51)]
        ),
        image_stamps_ns=np.array([5 * SECOND // 2]),
    )

    (frame,) = plan_frames(recording, RECIPE).frames

    assert frame.T_map_camera[0, 3] == pytest.approx(3.0)
    assert (frame.stamp_ns, frame.source_stamp_ns) == (3 * SECOND, 5 * SECOND // 2)


def test_a_flat_soffit_at_five_metres_is_five_metres_in_every_pixel() -> None:
    # The camera looks straight up; a plane of points 5 m above it covers the image.
    x, y = np.meshgrid(np.linspace(-5, 5, 400), np.linspace(-5, 5, 400))
    points = np.stack([x, y, np.full_like(x, 5.0)], axis=-1).reshape(-1, 3).astype(np.float32)
    recording = MemoryRecording(
        rig=Rig(LensCamera(PinholeCamera(64, 48, 40.0, 41.0, 31.5, 23.5)), np.eye(4), np.eye(4)),
        trajectory=standing_still(),
        scans=[LidarScan(10, points)],
        image_stamps_ns=np.array([SECOND]),
        images=[np.zeros((48, 64, 3), dtype=np.uint8)],
    )
    recipe = replace(
        RECIPE,
        accumulate=AccumulateStage(points=160_000),
        image=ImageStage(scale=1.0),
        depth=DepthStage(),
    )

    (outcome,) = FrameMaker(recording, recipe).make(plan_frames(recording, recipe).frames)

    assert outcome.frame is not None
    assert set(outcome.frame.depth_m.ravel().tolist()) == {5.0}
