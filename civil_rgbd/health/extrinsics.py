"""How far is the camera turned against the rig? Its edges say it exactly, its turning roughly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import compose, transform_from
from civil_rgbd.health.alignment import Alignment, align
from civil_rgbd.health.checks import CHECKS, Figure
from civil_rgbd.health.depth_edges import depth_edges
from civil_rgbd.health.mounting import turn_of_mounting, with_camera_turned
from civil_rgbd.health.rotations import rotation, rotation_vector
from civil_rgbd.health.sampling import Posed, Stretch
from civil_rgbd.health.tracks import Pair
from civil_rgbd.health.views import Views

Floats = NDArray[np.float64]

_FAR_RAD: Final = math.radians(2.5)
"""Beyond it the edges are searched from where the images' turning says that the camera is."""

_SURE_SIGMAS: Final = 3.0


def extrinsics_figure(
    recording: Posed,
    stretches: Sequence[Stretch],
    pairs: Sequence[Pair],
    views: Views,
    shift_s: float,
) -> Figure:
    """Compare the camera's mounting with what its images show.

    Args:
        recording: with poses, and sensors that turn.
        stretches: of it.
        pairs: features followed in them.
        views: of its images.
        shift_s: to be added to the images' stamps beyond what the rig says.
    """
    turn, sigma = turn_of_mounting(recording, pairs, shift_s)
    start = turn if np.abs(turn).max() > _FAR_RAD else np.zeros(3)
    edges = depth_edges(with_camera_turned(recording, start), stretches, views, shift_s)
    alignment = align(edges, (turn - start, sigma))
    if alignment.turn_deg is None:
        return _by_turning(recording, turn, sigma, alignment.why_not)
    there = rotation(start) @ rotation(np.radians(alignment.turn_deg))
    return _figure(recording, rotation_vector(there), alignment.sigma_deg, _by_edges(alignment))


def _by_edges(alignment: Alignment) -> str:
    return (
        f"{alignment.edges} depth edges meet image edges {alignment.contrast:.2f} times chance, "
        f"{alignment.contrast_as_given:.2f} before"
    )


def _by_turning(recording: Posed, turn: Floats, sigma: Floats, why_not: str) -> Figure:
    """Say what images and poses alone know: enough for a finding where it is far off."""
    size = float(np.sqrt((turn**2).sum()))
    doubt = float(np.sqrt((turn**2 * sigma**2).sum())) / max(size, 1e-9)
    sure_deg = math.degrees(size - _SURE_SIGMAS * doubt)
    if sure_deg < CHECKS["extrinsics"].limit:
        return Figure("extrinsics", None, why_not)
    said = f"as images and poses turn; of the depth edges: {why_not}"
    return _figure(recording, turn, math.degrees(doubt), said)


def _figure(recording: Posed, turn: Floats, sigma_deg: float, said: str) -> Figure:
    x, y, z = np.degrees(turn)
    whole = compose(recording.rig.T_lidar_camera, transform_from(rotation(turn), np.zeros(3)))
    line = f"T_lidar_camera = {(np.round(whole, 6) + 0.0).tolist()}"
    return Figure(
        "extrinsics",
        math.degrees(float(np.sqrt((turn**2).sum()))),
        f"about the camera's x {x:+.2f}, y {y:+.2f}, z {z:+.2f} deg; {said}",
        fix="see whether the mount is loose (a camera that was shifted looks turned, too), and "
        f"calibrate again; or write into the rig file (--rig): {line}",
        sigma=sigma_deg,
    )
