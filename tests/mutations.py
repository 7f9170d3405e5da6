"""Break the geometry and the pipeline in every way that is easy to get wrong, and look who notices.

Each mutation replaces one piece of text in a copy of the package; then the tests that prove the
geometry run against the copy, and one of them must fail. By hand, from anywhere:

    python tests/mutations.py             all of them, as the table of docs/geometry-proof.md
    python tests/mutations.py sign fx     those whose names hold one of these words
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
PROOF = (
    "tests/test_proved_from_outside.py",
    "tests/geometry",
    "tests/pipeline",
    "tests/builder/test_plan.py",
    "tests/builder/test_checks.py",
)
"""The tests that prove the geometry; all are run, those of the mutated room first."""

TRANSFORMS, TRAJECTORY = "geometry/transforms.py", "geometry/trajectory.py"
CAMERA, MOTION = "geometry/camera.py", "geometry/motion.py"
RIG, PREPARE = "domain/rig.py", "pipeline/prepare.py"
ACCUMULATE, RENDER = "pipeline/accumulate.py", "pipeline/render.py"
IMAGE, FRAMES, SELECT = "pipeline/image.py", "pipeline/frames.py", "pipeline/select.py"
VISIBILITY, QUALITY = "pipeline/visibility.py", "pipeline/quality.py"
WINNERS, PLAN = "pipeline/winners.py", "builder/plan.py"


@dataclass(frozen=True)
class Mutation:
    """One mistake.

    Attributes:
        name: what is done wrong.
        file: below ``civil_rgbd/``.
        old: text that occurs once in it.
        new: what stands there instead.
    """

    name: str
    file: str
    old: str
    new: str


MUTATIONS = (
    # transforms
    Mutation(
        "compose: rotations in the other order",
        TRANSFORMS,
        "R = _matmul3(T_a_b[..., :3, :3], T_b_c[..., :3, :3])",
        "R = _matmul3(T_b_c[..., :3, :3], T_a_b[..., :3, :3])",
    ),
    Mutation(
        "compose: translation of c not turned into a",
        TRANSFORMS,
        "t = _matmul3(T_a_b[..., :3, :3], T_b_c[..., :3, 3:4])[..., 0] + T_a_b[..., :3, 3]",
        "t = T_b_c[..., :3, 3] + T_a_b[..., :3, 3]",
    ),
    Mutation(
        "inverse: translation keeps its sign",
        TRANSFORMS,
        "transform_from(R_b_a, -_matmul3(",
        "transform_from(R_b_a, _matmul3(",
    ),
    Mutation(
        "inverse: rotation not transposed",
        TRANSFORMS,
        "R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)",
        "R_b_a = T_a_b[..., :3, :3]",
    ),
    Mutation(
        "transform_points: rotation transposed",
        TRANSFORMS,
        "R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + t[i]",
        "R[0, i] * x + R[1, i] * y + R[2, i] * z + t[i]",
    ),
    Mutation(
        "quaternion to matrix: order wxyz",
        TRANSFORMS,
        "x, y, z, w = np.moveaxis(np.asarray(quaternion_xyzw, dtype=np.float64), -1, 0)",
        "w, x, y, z = np.moveaxis(np.asarray(quaternion_xyzw, dtype=np.float64), -1, 0)",
    ),
    Mutation(
        "quaternion to matrix: one sign (turns the other way)",
        TRANSFORMS,
        "2 * (x * y - z * w), 2 * (x * z + y * w)]",
        "2 * (x * y + z * w), 2 * (x * z + y * w)]",
    ),
    Mutation(
        "matrix to quaternion: w with the other sign",
        TRANSFORMS,
        "q[3] = R[k, j] - R[j, k]",
        "q[3] = R[j, k] - R[k, j]",
    ),
    Mutation(
        "matrix to quaternion: x with the other sign",
        TRANSFORMS,
        "q[:] = R[2, 1] - R[1, 2],",
        "q[:] = R[1, 2] - R[2, 1],",
    ),
    Mutation(
        "unit quaternion: w may be negative",
        TRANSFORMS,
        "np.where(q[..., 3:4] < 0, -q, q)",
        "np.where(q[..., 3:4] < 0, q, q)",
    ),
    Mutation("rotate: by half", TRANSFORMS, "tx = 2 * (qy", "tx = 1 * (qy"),
    # trajectory
    Mutation(
        "slerp: the long way round",
        MOTION,
        "sign = -1.0 if dot < 0.0 else 1.0",
        "sign = 1.0",
    ),
    Mutation(
        "slerp: weights swapped",
        MOTION,
        "return _sin((1.0 - share) * angle) / whole, _sin(share * angle) / whole",
        "return _sin(share * angle) / whole, _sin((1.0 - share) * angle) / whole",
    ),
    Mutation(
        "slerp: linear instead",
        MOTION,
        "if angle < _SMALL_ANGLE_RAD:",
        "if angle < 4.0:",
    ),
    Mutation(
        "translation between poses: from the wrong end",
        MOTION,
        "start = translations[segment, k]",
        "start = translations[after, k]",
    ),
    Mutation(
        "translation between poses: the earlier pose's",
        MOTION,
        "start + share * (translations[after, k] - start)",
        "start",
    ),
    Mutation(
        "pose one later than asked for",
        MOTION,
        'return max(0, np.searchsorted(stamps, stamp, side="right") - 1)',
        'return min(last, np.searchsorted(stamps, stamp, side="right"))',
    ),
    Mutation(
        "trajectory: its end is outside",
        TRAJECTORY,
        "(stamps_ns <= self.end_ns)\n        short",
        "(stamps_ns < self.end_ns)\n        short",
    ),
    Mutation(
        "trajectory: poses at the edge of a gap are in it",
        TRAJECTORY,
        "within & (at_a_pose | short)",
        "within & short",
    ),
    Mutation(
        "trajectory: a gap of exactly the limit counts as one",
        TRAJECTORY,
        "short = self.stamps_ns[after] - self.stamps_ns[before] <= max_gap_ns",
        "short = self.stamps_ns[after] - self.stamps_ns[before] < max_gap_ns",
    ),
    Mutation(
        "trajectory: a span over a gap is covered",
        TRAJECTORY,
        "return bool((np.diff(self.stamps_ns[first : last + 1]) <= max_gap_ns).all())",
        "return True",
    ),
    Mutation(
        "trajectory: equal stamps pass",
        TRAJECTORY,
        "if (steps <= 0).any():",
        "if (steps < 0).any():",
    ),
    # points into the map
    Mutation(
        "move points: LiDAR not placed on the body",
        MOTION,
        "T = T_body_points\n",
        "T = np.eye(4)\n",
    ),
    Mutation(
        "move points: mounting rotation transposed",
        MOTION,
        "bx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]",
        "bx = T[0, 0] * x + T[1, 0] * y + T[2, 0] * z + T[0, 3]",
    ),
    Mutation(
        "move points: turned the other way",
        MOTION,
        "out[0, i] = bx + qw * tx + (qy",
        "out[0, i] = bx - qw * tx + (qy",
    ),
    Mutation(
        "move points: body's place left out in z",
        MOTION,
        "+ (translations[p, 2] - origin[2])",
        "- origin[2]",
    ),
    Mutation(
        "move points: origin added",
        MOTION,
        "(translations[p, 0] - origin[0])",
        "(translations[p, 0] + origin[0])",
    ),
    Mutation(
        "de-skew by the header's stamp",
        PREPARE,
        "if scan.point_stamps_ns is None or not recipe.accumulate.deskew:",
        "if True:",
    ),
    Mutation(
        "de-skew although it is switched off",
        PREPARE,
        "if scan.point_stamps_ns is None or not recipe.accumulate.deskew:",
        "if scan.point_stamps_ns is None:",
    ),
    Mutation(
        "registered clouds moved once more",
        PREPARE,
        "    if scan.in_map:\n        near",
        "    if scan.in_map and not len(points):\n        near",
    ),
    Mutation(
        "registered clouds: range from the map's origin",
        PREPARE,
        "points_map.astype(np.float64) - (translations + lever)",
        "points_map.astype(np.float64)",
    ),
    Mutation(
        "registered clouds: lever of the LiDAR left out",
        PREPARE,
        "points_map.astype(np.float64) - (translations + lever)",
        "points_map.astype(np.float64) - translations",
    ),
    Mutation(
        "cast to float32 before the origin is subtracted",
        PREPARE,
        '(points.astype(np.float64) - origin_map).T.astype(np.float32, order="C")',
        "(points.astype(np.float32) - origin_map.astype(np.float32)).T.copy()",
    ),
    Mutation(
        "range: limits exclusive", PREPARE, "limits[0] <= range_m <=", "limits[0] < range_m <"
    ),
    Mutation("noise not dropped", PREPARE, "elif len(noise) and noise[i]:", "elif False:"),
    Mutation(
        "no returns not dropped",
        PREPARE,
        "elif x == 0.0 and y == 0.0 and z == 0.0:",
        "elif False:",
    ),
    Mutation(
        "order by stamp: not stable",
        PREPARE,
        'np.argsort(stamps_ns, kind="stable")',
        'np.argsort(-stamps_ns, kind="stable")[::-1]',
    ),
    Mutation(
        "local origin: not in whole metres",
        PREPARE,
        "np.floor(trajectory.translations_m[0] + 0.5) + 0.0",
        "trajectory.translations_m[0] + 0.0",
    ),
    # which points
    Mutation(
        "past: the image's own instant as well (< to <=)",
        ACCUMULATE,
        'stop = int(np.searchsorted(held.stamps_ns, stamp_ns, side="left"))',
        'stop = int(np.searchsorted(held.stamps_ns, stamp_ns, side="right"))',
    ),
    Mutation(
        "future: without the image's own instant",
        ACCUMULATE,
        'start = int(np.searchsorted(held.stamps_ns, stamp_ns, side="left"))',
        'start = int(np.searchsorted(held.stamps_ns, stamp_ns, side="right"))',
    ),
    Mutation(
        "past and future swapped",
        ACCUMULATE,
        '"past": (stage.points, 0),\n            "future": (0, stage.points),',
        '"future": (stage.points, 0),\n            "past": (0, stage.points),',
    ),
    Mutation(
        "centred: the odd point from the past",
        ACCUMULATE,
        '"centred": (half, stage.points - half)',
        '"centred": (stage.points - half, half)',
    ),
    Mutation(
        "past: stamps shifted by one message",
        ACCUMULATE,
        'scan = int(np.searchsorted(self._earliest_from, stamp_ns, side="left"))',
        'scan = int(np.searchsorted(self._earliest_from, stamp_ns, side="left")) - 1',
    ),
    Mutation(
        "past: the first points instead of the last",
        ACCUMULATE,
        "start = max(young, stop - wanted)",
        "start, stop = young, min(stop, young + wanted)",
    ),
    Mutation(
        "stale points: exactly the limit is too old",
        ACCUMULATE,
        'young = int(np.searchsorted(held.stamps_ns, oldest_ns, side="left"))',
        'young = int(np.searchsorted(held.stamps_ns, oldest_ns, side="right"))',
    ),
    Mutation(
        "unsorted headers: believed to be sorted",
        ACCUMULATE,
        "self._earliest_from = np.minimum.accumulate(earliest[::-1])[::-1]",
        "self._earliest_from = earliest",
    ),
    Mutation(
        "held scans dropped one too early",
        ACCUMULATE,
        "if scan >= from_scan}",
        "if scan > from_scan}",
    ),
    # cameras
    Mutation(
        "fx and fy swapped",
        RENDER,
        "((camera.fx_px, camera.cx_px), (camera.fy_px, camera.cy_px))",
        "((camera.fy_px, camera.cx_px), (camera.fx_px, camera.cy_px))",
    ),
    Mutation(
        "cx and cy swapped",
        RENDER,
        "((camera.fx_px, camera.cx_px), (camera.fy_px, camera.cy_px))",
        "((camera.fx_px, camera.cy_px), (camera.fy_px, camera.cx_px))",
    ),
    Mutation(
        "half-pixel rule left out of cx",
        CAMERA,
        "cx_px=(self.cx_px + 0.5) * sx - 0.5",
        "cx_px=self.cx_px * sx",
    ),
    Mutation(
        "half-pixel rule left out of cy",
        CAMERA,
        "cy_px=(self.cy_px + 0.5) * sy - 0.5",
        "cy_px=self.cy_px * sy",
    ),
    Mutation(
        "size of a scaled image truncated",
        CAMERA,
        "math.floor(self.height_px * scale + 0.5)",
        "math.floor(self.height_px * scale)",
    ),
    Mutation(
        "scaled: the factor asked for instead of that of the sizes",
        CAMERA,
        "sx, sy = width_px / self.width_px, height_px / self.height_px",
        "sx, sy = scale, scale",
    ),
    Mutation(
        "cropped: shifted the other way", CAMERA, "self.cx_px - left_px", "self.cx_px + left_px"
    ),
    Mutation(
        "k1 and k2 swapped",
        CAMERA,
        "k1, k2, k3, k4, k5, k6 = k[0], k[1], k[4]",
        "k1, k2, k3, k4, k5, k6 = k[1], k[0], k[4]",
    ),
    Mutation(
        "p1 and p2 swapped",
        CAMERA,
        "p1, p2, s1, s2, s3, s4 = k[2], k[3]",
        "p1, p2, s1, s2, s3, s4 = k[3], k[2]",
    ),
    Mutation(
        "fisheye: the radius instead of the angle",
        CAMERA,
        "theta = _arctan(r)",
        "theta = r",
    ),
    Mutation(
        "rational lens: denominator left out",
        CAMERA,
        "above / np.where(below == 0, np.inf, below)",
        "above",
    ),
    Mutation(
        "undistorted where it should be distorted",
        CAMERA,
        "rows = distorted_y * raw.pinhole.fy_px + raw.pinhole.cy_px",
        "rows = (2 * y - distorted_y) * raw.pinhole.fy_px + raw.pinhole.cy_px",
    ),
    Mutation(
        "lens beyond its valid radius is believed",
        CAMERA,
        "(radius <= valid_radius(raw, float(radius.max())))",
        "(radius >= 0)",
    ),
    Mutation(
        "raw image ends at its last pixel's centre",
        CAMERA,
        "& (columns <= raw.pinhole.width_px - 0.5)",
        "& (columns <= raw.pinhole.width_px - 1)",
    ),
    Mutation(
        "width and height swapped in the raw image",
        CAMERA,
        "& (columns <= raw.pinhole.width_px - 0.5)",
        "& (columns <= raw.pinhole.height_px - 0.5)",
    ),
    # rig and time
    Mutation(
        "extrinsics inverted",
        RIG,
        "return compose(inverse(self.T_body_lidar), self.T_body_camera)",
        "return compose(inverse(self.T_body_camera), self.T_body_lidar)",
    ),
    Mutation(
        "extrinsics: inverse left out",
        RIG,
        "compose(inverse(self.T_body_lidar), self.T_body_camera)",
        "compose(self.T_body_lidar, self.T_body_camera)",
    ),
    Mutation(
        "camera's time offset subtracted",
        PLAN,
        "recording.image_stamps_ns + recording.rig.camera_time_offset_ns",
        "recording.image_stamps_ns - recording.rig.camera_time_offset_ns",
    ),
    Mutation(
        "camera's time offset left out",
        PLAN,
        "recording.image_stamps_ns + recording.rig.camera_time_offset_ns",
        "recording.image_stamps_ns + 0",
    ),
    Mutation(
        "camera pose: the other order",
        PLAN,
        "recording.trajectory.transforms_at(stamps_ns[posed]), recording.rig.T_body_camera",
        "recording.rig.T_body_camera, recording.trajectory.transforms_at(stamps_ns[posed])",
    ),
    Mutation(
        "stored stamp is the camera's",
        PLAN,
        " stamp_ns=int(self.stamps_ns[place])",
        " stamp_ns=int(self.source_stamps_ns[place])",
    ),
    Mutation(
        "frame numbered by its place in the plan",
        PLAN,
        "source_index=int(self.source_indices[place])",
        "source_index=int(place)",
    ),
    Mutation(
        "gate: exactly the limit is enough (> to >=)",
        SELECT,
        "> min_displacement_m",
        ">= min_displacement_m",
    ),
    Mutation(
        "gate: from the previous image, kept or not",
        SELECT,
        "            last = here\n            kept.append(index)",
        "            kept.append(index)\n        last = here",
    ),
    # rendering
    Mutation(
        "T_camera_local: inverse left out",
        FRAMES,
        "return inverse(T_local_camera)",
        "return T_local_camera",
    ),
    Mutation(
        "camera not moved to the local origin",
        FRAMES,
        "T_local_camera[:3, 3] -= self._scans.origin_map",
        "T_local_camera[:3, 3] -= 0.0",
    ),
    Mutation(
        "pixel truncated instead of floor(u + 0.5)",
        RENDER,
        "u = np.floor((a0 * x + a1 * y + a2 * z + a3) * per_depth + 0.5)",
        "u = np.trunc((a0 * x + a1 * y + a2 * z + a3) * per_depth)",
    ),
    Mutation(
        "pixel rounded half to even",
        RENDER,
        "v = np.floor((b0 * x + b1 * y + b2 * z + b3) * per_depth + 0.5)",
        "v = np.rint((b0 * x + b1 * y + b2 * z + b3) * per_depth)",
    ),
    Mutation(
        "pixel: trunc(u + 0.5), so -0.7 is column 0",
        RENDER,
        "u = np.floor((a0 * x + a1 * y + a2 * z + a3) * per_depth + 0.5)",
        "u = np.trunc((a0 * x + a1 * y + a2 * z + a3) * per_depth + 0.5)",
    ),
    Mutation(
        "largest depth wins",
        RENDER,
        "nearest[pixel] = min(depths[point], nearest[pixel])",
        "nearest[pixel] = (depths[point] if nearest[pixel] == np.inf else "
        "max(depths[point], nearest[pixel]))",
    ),
    Mutation(
        "newest depth wins",
        RENDER,
        "nearest[pixel] = min(depths[point], nearest[pixel])",
        "nearest[pixel] = depths[point]",
    ),
    Mutation(
        "width and height swapped in the image",
        RENDER,
        "np.int32(v * u_end + u if seen else np.float64(missed))",
        "np.int32(u * v_end + v if seen else np.float64(missed))",
    ),
    Mutation(
        "depth along the ray",
        RENDER,
        "depths[i] = np.float32(steps if rounded else depth)",
        "depths[i] = np.float32(steps if rounded else np.sqrt(depth * depth * (1 + 1e-4 * u * u)))",
    ),
    Mutation(
        "depth step truncated",
        RENDER,
        "np.floor(depth * steps_per_m + 0.5)",
        "np.floor(depth * steps_per_m)",
    ),
    Mutation(
        "depth range: its lower end is outside",
        RENDER,
        "(depth >= min_m) & (depth <= max_m)",
        "(depth > min_m) & (depth <= max_m)",
    ),
    Mutation(
        "depth range: its upper end is outside",
        RENDER,
        "(depth >= min_m) & (depth <= max_m)",
        "(depth >= min_m) & (depth < max_m)",
    ),
    Mutation(
        "points behind the camera are drawn",
        RENDER,
        "(depth >= min_m) & (depth <= max_m)",
        "(abs(depth) >= min_m) & (abs(depth) <= max_m)",
    ),
    Mutation(
        "a block's last point is forgotten",
        RENDER,
        "count = min(_BLOCK, len(xs) - first)",
        "count = min(_BLOCK - 1, len(xs) - first)",
    ),
    Mutation(
        "rendering: fused arithmetic (fastmath)",
        RENDER,
        '@numba.njit(cache=True, nogil=True, error_model="numpy")',
        '@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)',
    ),
    Mutation(
        "move points: fused arithmetic (fastmath)",
        MOTION,
        "@numba.njit(cache=True)\ndef move_points",
        "@numba.njit(cache=True, fastmath=True)\ndef move_points",
    ),
    Mutation(
        "poses: the segment of the instant before, unchecked",
        MOTION,
        "if stamps[guess] <= stamp and (guess == last or stamp < stamps[guess + 1]):",
        "if stamps[guess] <= stamp and guess > 0:",
    ),
    # the picture
    Mutation(
        "picture: columns and rows swapped",
        IMAGE,
        "for places in (source.columns, source.rows)",
        "for places in (source.rows, source.columns)",
    ),
    Mutation(
        "picture: weights swapped",
        IMAGE,
        "row % _PARTS_OF_A_PIXEL * _PARTS_OF_A_PIXEL + column % _PARTS_OF_A_PIXEL",
        "column % _PARTS_OF_A_PIXEL * _PARTS_OF_A_PIXEL + row % _PARTS_OF_A_PIXEL",
    ),
    Mutation(
        "picture: no area filter",
        IMAGE,
        "_AREA_BELOW = 0.5",
        "_AREA_BELOW = 0.0",
    ),
    Mutation(
        "picture: area filter at half size too",
        IMAGE,
        "stage.scale < _AREA_BELOW",
        "stage.scale <= _AREA_BELOW + 0.2",
    ),
    Mutation(
        "picture: a small distorted image stays distorted",
        IMAGE,
        "self._moves_pixels = looked_up.distorts or looked_up.pinhole != self.camera",
        "self._moves_pixels = looked_up.pinhole != self.camera",
    ),
    Mutation(
        "picture: black leaks in at the rim",
        IMAGE,
        "borderMode=cv2.BORDER_REPLICATE",
        "borderMode=cv2.BORDER_CONSTANT",
    ),
    Mutation(
        "picture: pixels without a source keep what the border gave",
        IMAGE,
        "            rgb[self._missing] = 0\n",
        "            pass\n",
    ),
    Mutation(
        "depth where the picture has no pixel",
        FRAMES,
        "rendered.depth_m[~self.images.exists] = NO_DEPTH_M",
        "pass",
    ),
    Mutation(
        "frames: exactly min_fill is too few",
        FRAMES,
        "if window.count < self.recipe",
        "if window.count <= self.recipe",
    ),
    # visibility
    Mutation(
        "hidden: the frame's own points hide nothing",
        VISIBILITY,
        "depth_m[i] if depth_m[i] != no_depth_m else np.float32(np.inf)",
        "np.float32(np.inf)",
    ),
    Mutation(
        "hidden: empty pixels stand before everything",
        VISIBILITY,
        "depth_m[i] if depth_m[i] != no_depth_m else np.float32(np.inf)",
        "depth_m[i]",
    ),
    Mutation(
        "hidden: what hides is rounded to the step of depth",
        VISIBILITY,
        "unrounded = dataclasses.replace(limits, step_m=0.0)",
        "unrounded = limits",
    ),
    Mutation(
        "hidden: of the front's neighbourhoods the largest first",
        VISIBILITY,
        "grown = cv2.erode(surface_m",
        "grown = cv2.dilate(surface_m",
    ),
    Mutation(
        "hidden: the front has no rim",
        VISIBILITY,
        "_square(closing_px + 2 * stage.rim_px)",
        "_square(closing_px)",
    ),
    Mutation(
        "hidden: the rim is twice as wide",
        VISIBILITY,
        "_square(closing_px + 2 * stage.rim_px)",
        "_square(closing_px + 4 * stage.rim_px)",
    ),
    Mutation(
        "hidden: holes are as wide in pixels whatever the focal length",
        VISIBILITY,
        "reach_px * camera.fx_px / CLOSING_FX_PX",
        "reach_px",
    ),
    Mutation(
        "hidden: what has gone is as wide in pixels whatever the focal length",
        VISIBILITY,
        "_square(_scaled_px(stage.gone_px, camera))",
        "_square(stage.gone_px)",
    ),
    Mutation(
        "hidden: one point behind is enough for gone",
        VISIBILITY,
        "around_m = cv2.erode(",
        "around_m = cv2.dilate(",
    ),
    Mutation(
        "hidden: nobody behind is enough for gone",
        VISIBILITY,
        "< np.float64(around_m[row, column]) < np.inf:",
        "< np.float64(around_m[row, column]):",
    ),
    Mutation(
        "hidden: what has gone leaves a hole in the frame's own",
        VISIBILITY,
        "surface_m[row, column] = own_m[row, column]",
        "surface_m[row, column] = np.inf",
    ),
    Mutation(
        "hidden: exactly the margin is hidden (> to >=)",
        VISIBILITY,
        "if np.float64(depth_m[row, column]) > limit_m:",
        "if np.float64(depth_m[row, column]) >= limit_m:",
    ),
    Mutation(
        "hidden: no margin in metres",
        VISIBILITY,
        "np.float64(front_m[row, column]) * times + margin_m",
        "np.float64(front_m[row, column]) * times",
    ),
    Mutation(
        "hidden: no margin by depth",
        VISIBILITY,
        "depth_m, front_m, stage.margin_m, 1.0 + stage.margin_share",
        "depth_m, front_m, stage.margin_m, 1.0",
    ),
    Mutation(
        "hidden: the limit in float32",
        VISIBILITY,
        "np.float64(front_m[row, column]) * times + margin_m",
        "front_m[row, column] * np.float32(times) + np.float32(margin_m)",
    ),
    Mutation(
        "hidden: removed pixels are counted once in all",
        VISIBILITY,
        "removed += 1",
        "removed = 1",
    ),
    Mutation(
        "hidden: points of any age hide",
        FRAMES,
        "points=stage.points, max_age_s=stage.max_age_s",
        "points=stage.points",
    ),
    Mutation(
        "hidden: a scan that comes twice counts by its later part",
        ACCUMULATE,
        "theirs[scan] = (min(start, known[0]), max(stop, known[1]))",
        "theirs[scan] = (start, stop)",
    ),
    # quality planes
    Mutation(
        "quality: the nearest of many returns is too far",
        QUALITY,
        "bias_m = -mean * one2",
        "bias_m = mean * one2",
    ),
    Mutation(
        "quality: the nearest of many errs as one",
        QUALITY,
        "left2 = one2 - (1 - variance) * one2 * one2 / both2",
        "left2 = one2 + 0 * variance",
    ),
    Mutation(
        "quality: the pixel's own spread of depth left out",
        QUALITY,
        "both2 = one2 + slopes.spread_m**2 + ",
        "both2 = one2 + ",
    ),
    Mutation(
        "quality: noise along the ray taken for depth",
        QUALITY,
        "range_noise_m**2 / ray2",
        "range_noise_m**2",
    ),
    Mutation(
        "quality: depth taken for range",
        QUALITY,
        "(weak2 + slant2) * depth_m",
        "(weak2 + slant2) / ray2 * depth_m",
    ),
    Mutation(
        "quality: rounding errs by a whole step",
        QUALITY,
        "depth.step_m**2 / 12",
        "depth.step_m**2",
    ),
    Mutation(
        "quality: leaves taken for planes",
        QUALITY,
        "(_LEAF_TANGENT * leaves)",
        "(0.0 * leaves)",
    ),
    Mutation(
        "quality: more returns than half floats can count",
        QUALITY,
        "np.minimum(winners.returns, _MOST_RETURNS)",
        "winners.returns",
    ),
    Mutation(
        "quality: the age is that of the first point",
        QUALITY,
        "won = np.where(winners.point == NO_WINNER, 0, winners.point)",
        "won = np.zeros_like(winners.point)",
    ),
    Mutation(
        "quality: the age has the other sign",
        FRAMES,
        "ages_s=(plan.stamp_ns - stamps_ns)",
        "ages_s=(stamps_ns - plan.stamp_ns)",
    ),
    Mutation(
        "quality: hidden and out of range exchanged",
        QUALITY,
        'EMPTY["hidden"], EMPTY["out-of-range"]]',
        'EMPTY["out-of-range"], EMPTY["hidden"]]',
    ),
    Mutation(
        "quality: what was removed had no return",
        QUALITY,
        "_why_empty(measured, before_m != NO_DEPTH_M",
        "_why_empty(measured, measured",
    ),
    Mutation(
        "quality: of equally near returns the last wins",
        WINNERS,
        "depths_m[i] < depths_m[best]",
        "depths_m[i] <= depths_m[best]",
    ),
    Mutation(
        "quality: returns out of the depth range count",
        WINNERS,
        "if limits[0] <= depth <= limits[1]:",
        "if depth > 0.0:",
    ),
)


@dataclass(frozen=True)
class Copy:
    """A copy of package and tests that may be broken.

    Attributes:
        folder: holds ``tests/`` and, under ``site/``, the package with its mapped folders.
    """

    folder: Path

    @classmethod
    def into(cls, folder: Path) -> Copy:
        """Copy what the proof needs."""
        leave_out = shutil.ignore_patterns("__pycache__", "data", "*.nb[ic]")
        package = folder / "site" / "civil_rgbd"
        shutil.copytree(ROOT / "civil_rgbd", package, ignore=leave_out)
        for room in ("schema", "recipes", "conversion"):
            shutil.copytree(ROOT / room, package / room, ignore=leave_out)
        shutil.copytree(ROOT / "tests", folder / "tests", ignore=leave_out)
        # Only what pytest reads: warnings are errors here as they are there.
        shutil.copy(ROOT / "pyproject.toml", folder)
        return cls(folder)

    def caught_by(self, mutation: Mutation | None) -> str | None:
        """Break the copy, run the proof, mend the copy.

        Args:
            mutation: None breaks nothing.

        Returns:
            the test that failed; None when all passed.
        """
        if mutation is None:
            return self._first_failure("", kernels="whole")
        path = self.folder / "site" / "civil_rgbd" / mutation.file
        text, stat = path.read_text("utf-8"), path.stat()
        if text.count(mutation.old) != 1:
            raise LookupError(
                f"{mutation.name!r}: its text occurs {text.count(mutation.old)} times in "
                f"{mutation.file}; the code has changed, so write the mutation anew"
            )
        path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
        try:
            return self._first_failure(mutation.file, kernels="broken")
        finally:
            path.write_text(text, encoding="utf-8")
            # The stamp too, so that kernels which were compiled before count as fresh.
            os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))

    def _first_failure(self, file: str, *, kernels: str) -> str | None:
        room = f"tests/{file.partition('/')[0]}"
        # numba keeps one kernel a file: broken ones must not throw out the whole ones.
        changes_kernels = file in {RENDER, MOTION, PREPARE, VISIBILITY, WINNERS}
        cache = self.folder / (kernels if changes_kernels else "whole")
        ordered = sorted(PROOF, key=lambda path: not path.startswith(room))
        plugins = ("-p", "no:cacheprovider", "-p", "no:xdist")
        options = ("-x", "-q", "--tb=line", *plugins, "--rootdir", str(self.folder))
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *ordered],
            cwd=self.folder,
            env=os.environ
            | {
                "PYTHONPATH": str(self.folder / "site"),
                "PYTHONDONTWRITEBYTECODE": "1",  # same size, same second: a stale .pyc would win
                "NUMBA_CACHE_DIR": str(cache),
                "CIVIL_RGBD_HYPOTHESIS": "unshrunk",
            },
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == 0:
            return None
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
        if done.returncode != 1 or failed is None:
            raise RuntimeError(f"pytest did not run:\n{done.stdout}\n{done.stderr}")
        return failed.group(1)


def main(words: list[str]) -> int:
    """Try the mutations whose names hold one of the words, and print who caught them."""
    chosen = [m for m in MUTATIONS if not words or any(word in m.name for word in words)]
    missed = 0
    with TemporaryDirectory() as folder:
        copy = Copy.into(Path(folder))
        broken = copy.caught_by(None)
        if broken:
            sys.stderr.write(f"the tests fail as it is: {broken}\n")
            return 2
        sys.stdout.write("| what is done wrong | in | caught by |\n|---|---|---|\n")
        for mutation in chosen:
            test = copy.caught_by(mutation)
            missed += test is None
            caught = f"`{test.removeprefix('tests/')}`" if test else "**nothing**"
            sys.stdout.write(f"| {mutation.name} | `{mutation.file}` | {caught} |\n")
            sys.stdout.flush()
    sys.stderr.write(f"{len(chosen) - missed} of {len(chosen)} mutations caught\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
