"""Trajectories of others, read here, against what evo says of the same files.

Absolute trajectory error over poses nearest in time, at most 10 ms apart; evo 1.38.1::

    evo_ape tum freiburg1_xyz-groundtruth.txt freiburg1_xyz-rgbdslam.txt [-a | -as]
    evo_traj tum freiburg1_xyz-groundtruth.txt --full_check
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.trajectories.files import read_trajectory

EVO_APE_M = {
    ("rgbdslam", ""): (0.020079, 0.043289),
    ("rgbdslam", "a"): (0.013470, 0.034760),
    ("rgbdslam", "as"): (0.013389, 0.034846),
    ("rgbdslam_drift", ""): (0.134185, 0.249332),
    ("rgbdslam_drift", "a"): (0.013470, 0.034760),
    ("ORB_kf_mono", ""): (2.025142, 2.176246),
    ("ORB_kf_mono", "a"): (0.024302, 0.042735),
    ("ORB_kf_mono", "as"): (0.009755, 0.027924),
}
"""Root mean square and largest error, metres; a = after alignment, s = with scale."""


@pytest.fixture(scope="module")
def folder() -> Path:
    found = Path(__file__).resolve().parents[3] / "shared/data"
    if not found.is_dir():
        pytest.skip("needs the recordings of others, in `shared` beside the repository")
    return found


def matched(
    reference: Trajectory, estimate: Trajectory
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places of the poses that belong together: nearest in time, at most 10 ms apart."""
    apart = np.abs(reference.stamps_ns[:, None] - estimate.stamps_ns[None])
    few = len(estimate.stamps_ns) < len(reference.stamps_ns)
    nearest = apart.argmin(axis=0 if few else 1)
    at = np.arange(len(nearest))
    pairs = np.stack([nearest, at] if few else [at, nearest], axis=1)
    pairs = pairs[apart[pairs[:, 0], pairs[:, 1]] <= 10_000_000]
    return reference.translations_m[pairs[:, 0]], estimate.translations_m[pairs[:, 1]]


def aligned(
    reference: NDArray[np.float64], estimate: NDArray[np.float64], how: str
) -> NDArray[np.float64]:
    """Umeyama 1991."""
    if not how:
        return estimate
    a, b = estimate.mean(axis=0), reference.mean(axis=0)
    U, D, Vt = np.linalg.svd((reference - b).T @ (estimate - a) / len(a))
    S = np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))])
    scale = (D * S.diagonal()).sum() / ((estimate - a) ** 2).sum() * len(a) if "s" in how else 1.0
    moved: NDArray[np.float64] = scale * (estimate - a) @ (U @ S @ Vt).T + b
    return moved


@pytest.mark.parametrize(("name", "how"), EVO_APE_M)
def test_absolute_trajectory_errors_are_evos(folder: Path, name: str, how: str) -> None:
    data = folder / "evo_trajectories/test/data"
    reference, estimate = matched(
        read_trajectory(data / "freiburg1_xyz-groundtruth.txt"),
        read_trajectory(data / f"freiburg1_xyz-{name}.txt"),
    )
    error = np.sqrt(((aligned(reference, estimate, how) - reference) ** 2).sum(axis=1))
    found = (float(np.sqrt((error**2).mean())), float(error.max()))
    assert found == pytest.approx(EVO_APE_M[name, how], abs=2e-6)


def test_the_ground_truth_is_as_long_as_evo_says(folder: Path) -> None:
    data = folder / "evo_trajectories/test/data"
    found = read_trajectory(data / "freiburg1_xyz-groundtruth.txt")
    steps = np.diff(found.translations_m, axis=0)
    assert len(found.stamps_ns) == 3000
    assert np.sqrt((steps**2).sum(axis=1)).sum() == pytest.approx(9.159267877342083)
    assert (found.end_ns - found.start_ns) == 30_089_600_000


def test_trajectories_of_slambook_are_read_and_compared(folder: Path) -> None:
    book = folder / "slambook2_rgbd"
    walk = read_trajectory(book / "ch3/examples/trajectory.txt")
    steps = np.diff(walk.translations_m, axis=0)
    assert len(walk.stamps_ns) == 620
    assert np.sqrt((steps**2).sum(axis=1)).sum() == pytest.approx(11.666714669825826)
    # evo_ape tum groundtruth.txt estimated.txt: rmse 0.023082, max 0.063891
    reference, estimate = matched(
        read_trajectory(book / "ch4/example/groundtruth.txt"),
        read_trajectory(book / "ch4/example/estimated.txt"),
    )
    error = np.sqrt(((estimate - reference) ** 2).sum(axis=1))
    assert np.sqrt((error**2).mean()) == pytest.approx(0.023082, abs=1e-6)
    assert error.max() == pytest.approx(0.063891, abs=1e-6)


def test_poses_of_an_ouster_in_kittis_format_are_read(folder: Path, tmp_path: Path) -> None:
    poses = folder / "ouster_sdk_pcaps/tests/pcaps/OS-1-128_v2.3.0_1024x10_lb_n3_poses_kitti.txt"
    times = tmp_path / "times.txt"
    times.write_text("0.0\n1.000000e-01\n2.000000e-01\n")
    found = read_trajectory(poses, times_path=times)
    assert found.stamps_ns.tolist() == [0, 100_000_000, 200_000_000]
    np.testing.assert_allclose(
        found.translations_m[-1], [0.49782553, 0.0060335, -0.00055434], atol=1e-8
    )
