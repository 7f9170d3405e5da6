"""Rendering 250,000 points into 768 x 432, beside two ways in which others do it.

    python benchmarks/render.py [--points 250000] [--repeat 30]

Runs on one core: our renderer, Open3D's ``PointCloud.project_to_depth_image`` (tensor interface;
``pip install open3d``, left out where it is not installed), and numpy's ``minimum.at``. Points are
handed to each in the layout that suits it, before the clock starts; the best of the repeats counts.
"""

# ruff: noqa: E402  # libraries read the number of threads when they load: it is set before

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import argparse
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recipe import DepthStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from, unit_quaternion
from civil_rgbd.pipeline.render import render_depth

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "reference"))
from zbuffer import Pinhole, zbuffer_by_minimum_at

TARGET = 15.0
"""Each of the others shall take at least so many times as long."""

POINTS_A_SCAN = 24_000  # a Livox Avia's message
CAMERA = PinholeCamera(768, 432, 381.9, 380.9, 381.2, 219.5)  # a D455's at 0.6
STAGE = DepthStage(step_m=0.0)  # the others round nothing
T_CAMERA_LOCAL = transform_from(
    matrix_from_quaternion(unit_quaternion([0.02, -0.03, 0.01, 1.0])), [0.05, -0.1, 0.2]
)


def avia_points(count: int) -> NDArray[np.float32]:
    """(N, 3) float32 metres, all over a field of view of 70 x 77 degrees, 3 to 60 m away."""
    rng = np.random.default_rng(0)
    across, down = np.tan(np.radians(rng.uniform([[-35.2], [-38.6]], [[35.2], [38.6]], (2, count))))
    depth = rng.uniform(3.0, 60.0, count)
    return np.stack([across * depth, down * depth, depth], axis=1).astype(np.float32)


def best_ms(work: Callable[[], object], repeat: int) -> float:
    """The shortest of ``repeat`` runs, after one that is not counted."""
    work()
    times = []
    for _ in range(repeat):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return 1e3 * min(times)


def ours(points: NDArray[np.float32]) -> Callable[[], NDArray[np.float32]]:
    """Our renderer, on segments as a window holds them."""
    cuts = range(POINTS_A_SCAN, len(points), POINTS_A_SCAN)
    segments = [np.ascontiguousarray(part.T) for part in np.split(points, list(cuts))]

    def work() -> NDArray[np.float32]:
        return render_depth(
            segments, T_camera_local=T_CAMERA_LOCAL, camera=CAMERA, stage=STAGE
        ).depth_m

    return work


def by_open3d(points: NDArray[np.float32]) -> Callable[[], NDArray[np.float32]]:
    """Open3D's tensor interface, on the processor."""
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    intrinsics, extrinsics = o3d.core.Tensor(CAMERA.matrix), o3d.core.Tensor(T_CAMERA_LOCAL)

    def work() -> NDArray[np.float32]:
        image = cloud.project_to_depth_image(
            CAMERA.width_px,
            CAMERA.height_px,
            intrinsics,
            extrinsics,
            depth_scale=1.0,
            depth_max=STAGE.max_m,
        )
        depth_m: NDArray[np.float32] = image.as_tensor().numpy()[..., 0]
        return depth_m

    return work


def by_numpy(points: NDArray[np.float32]) -> Callable[[], NDArray[np.float32]]:
    """``np.minimum.at``, as most people write it."""
    camera = Pinhole(
        CAMERA.width_px, CAMERA.height_px, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px
    )

    def work() -> NDArray[np.float32]:
        return zbuffer_by_minimum_at(
            points, T_CAMERA_LOCAL, camera, min_m=STAGE.min_m, max_m=STAGE.max_m, step_m=0.0
        )

    return work


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=250_000)
    parser.add_argument("--repeat", type=int, default=30, help="the best of so many is taken")
    arguments = parser.parse_args()
    points = avia_points(arguments.points)
    print(f"Python {platform.python_version()}, {_versions('numpy', 'numba', 'open3d')}, one core")
    render = ours(points)
    mine, my_ms = render(), best_ms(render, arguments.repeat)
    print(f"{arguments.points} points, {np.count_nonzero(mine)} pixels: ours {my_ms:.2f} ms")
    for name, peer in (("open3d", by_open3d), ("numpy minimum.at", by_numpy)):
        try:
            work = peer(points)
        except ImportError:
            print(f"{name}: not installed, so not compared")
            continue
        same = float(np.mean(np.isclose(work(), mine, rtol=0, atol=1e-4)))
        peer_ms = best_ms(work, arguments.repeat)
        ratio = peer_ms / my_ms
        print(
            f"{name}: {peer_ms:.2f} ms, {ratio:.1f} times ours "
            f"(target {'met' if ratio >= TARGET else 'missed'}: at least {TARGET:.0f}); "
            f"the same depth in {same:.2%} of the pixels"
        )


def _versions(*packages: str) -> str:
    words = []
    for package in packages:
        try:
            words.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            words.append(f"no {package}")
    return ", ".join(words)


if __name__ == "__main__":
    main()
