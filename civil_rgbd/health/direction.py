"""Is the camera's mounting given the right way round? It is compared with its own inverse.

Points of the scans around a few images are projected both ways. Where depth jumps, the picture
mostly has an edge: the direction under which it does is the right one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import ImageDecodeError, RecordingError
from civil_rgbd.geometry.transforms import inverse, transform_points
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.health.edges import EdgeSamples, edge_picture, sample_edges

IMAGES_LOOKED_AT: Final = 8
_WITHIN_NS: Final = 150_000_000
_MOST_SCANS: Final = 4
_ENOUGH_POINTS: Final = 60_000
_FEWEST_RIMS: Final = 50
_FEWEST_IN_VIEW: Final = 0.01
"""Below this share of points in the image a build refuses to start."""
_NEIGHBOURS: Final = 2.0
"""Rims beside each other share one edge: the error of their mean is so much larger."""
_SIGMAS: Final = 3.0


@dataclass(frozen=True, slots=True)
class Evidence:
    """How well one direction explains the images.

    Attributes:
        share_in_view: of the points, those that fall into the image.
        rims: places in view where depth jumps.
        contrast: edge strength there, over that under all points in view; 1 is chance.
        contrast_error: one sigma.
    """

    share_in_view: float
    rims: int
    contrast: float
    contrast_error: float

    @property
    def in_words(self) -> str:
        """Say it."""
        view = f"{100 * self.share_in_view:.1f} % of the points are in view"
        if self.rims < _FEWEST_RIMS:
            return f"{view}, too few depth jumps among them ({self.rims}) to compare with edges"
        return (
            f"{view}; where depth jumps ({self.rims} places) the images' edges are "
            f"{self.contrast:.2f} +- {self.contrast_error:.2f} times as strong as elsewhere"
        )


@dataclass(frozen=True, slots=True, eq=False)
class DirectionReport:
    """The given mounting beside its inverse.

    Attributes:
        T_lidar_camera: (4, 4) as given.
        images: how many were looked at.
        given: how well it explains them.
        inverse: how well its inverse does.
    """

    T_lidar_camera: NDArray[np.float64]
    images: int
    given: Evidence
    inverse: Evidence

    @property
    def verdict(self) -> str:
        """``given``, ``inverse`` or ``undecided``: which explains the images better."""
        margin = self.given.contrast - self.inverse.contrast
        noise = _SIGMAS * math.hypot(self.given.contrast_error, self.inverse.contrast_error)
        if abs(margin) > noise:
            return "given" if margin > 0 else "inverse"
        return "undecided"

    @property
    def misses(self) -> bool:
        """Whether so few points are in view that a build refuses to start."""
        return self.given.share_in_view < _FEWEST_IN_VIEW

    @property
    def turned_round(self) -> str:
        """The line of a rig file that says the opposite."""
        rows = np.round(inverse(self.T_lidar_camera), 9) + 0.0  # no -0.0
        return f"T_lidar_camera = {rows.tolist()}"

    def to_document(self) -> dict[str, object]:
        """Return it for machines."""
        return {
            "verdict": self.verdict,
            "misses": self.misses,
            "images": self.images,
            "T_lidar_camera": self.T_lidar_camera.tolist(),
            **{
                name: {
                    "share_in_view": evidence.share_in_view,
                    "rims": evidence.rims,
                    "contrast": evidence.contrast,
                    "contrast_error": evidence.contrast_error,
                }
                for name, evidence in (("given", self.given), ("inverse", self.inverse))
            },
        }

    def to_text(self) -> str:
        """Return it for people."""
        lines = [
            f"as given: {extrinsics_in_words(self.T_lidar_camera)}",
            f"  {self.given.in_words}",
            f"inverse:  {extrinsics_in_words(inverse(self.T_lidar_camera))}",
            f"  {self.inverse.in_words}",
        ]
        if self.verdict == "inverse":
            lines += [
                f"warning: rig-inverted: the inverse explains {self.images} images better",
                "  fix: import the calibration by `civil-rgbd rig import`, or turn it round:",
                "       T_lidar_camera takes camera points to the LiDAR; in the rig file (--rig)",
                f"       {self.turned_round}",
            ]
        elif self.misses:
            lines += [
                "warning: rig-misses: hardly any point falls into the images",
                "  fix: compare the words above with the rig",
            ]
        elif self.verdict == "undecided":
            lines += [
                "the images do not tell the two apart: too few depth jumps, or neither fits",
                "  fix: compare the words above with the rig",
            ]
        else:
            lines.append(f"the given direction explains {self.images} images better")
        return "\n".join(lines)


def compare_directions(recording: Recording, images: int = IMAGES_LOOKED_AT) -> DirectionReport:
    """Project scans into images by the given mounting and by its inverse.

    No poses are needed: the scans lie within a seventh of a second of their image, and clouds that
    are in the map already are brought back by the pose at that instant.

    Args:
        recording: with the rig to check.
        images: how many to look at, spread over the recording.

    Raises:
        RecordingError: no image can be decoded, or none has a scan near it.
    """
    T_lidar_camera = recording.rig.T_lidar_camera
    given: list[EdgeSamples] = []
    turned: list[EdgeSamples] = []
    for index in _spread(len(recording.image_stamps_ns), images):
        stamp_ns = int(recording.image_stamps_ns[index]) + recording.rig.camera_time_offset_ns
        points = list(_scans_near(recording, stamp_ns))
        if not sum(map(len, points)):
            continue
        try:
            rgb = recording.read_image(index).rgb
        except ImageDecodeError:
            continue
        picture, cloud = edge_picture(rgb, recording.rig.camera), np.concatenate(points)
        given.append(sample_edges(picture, cloud, inverse(T_lidar_camera)))
        turned.append(sample_edges(picture, cloud, T_lidar_camera))
    if not given:
        raise RecordingError(
            f"no image of {len(recording.image_stamps_ns)} can be decoded and has points within "
            f"{_WITHIN_NS / 1e9} s",
            where=recording.name,
            fix="see `civil-rgbd inspect-recording`: clocks and gaps",
        )
    return DirectionReport(T_lidar_camera, len(given), _evidence(given), _evidence(turned))


def _spread(count: int, wanted: int) -> list[int]:
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, wanted)).round()})


def _scans_near(recording: Recording, stamp_ns: int) -> Iterator[NDArray[np.floating]]:
    off_ns = np.abs(recording.scan_stamps_ns - stamp_ns)
    total = 0
    for index in np.argsort(off_ns, kind="stable")[:_MOST_SCANS].tolist():
        if off_ns[index] > _WITHIN_NS or total >= _ENOUGH_POINTS:
            return
        scan = recording.read_scan(index)
        points = scan.points
        returned = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
        if scan.noise is not None:
            returned &= ~scan.noise
        points = points[returned]
        if scan.in_map:
            points = _in_body(recording, points, stamp_ns)
        total += len(points)
        yield points


def _in_body(
    recording: Recording, points_map: NDArray[np.floating], stamp_ns: int
) -> NDArray[np.floating]:
    trajectory = recording.trajectory
    nearest_ns = min(max(stamp_ns, trajectory.start_ns), trajectory.end_ns)
    T_map_body = trajectory.transforms_at(np.array([nearest_ns], dtype=np.int64))[0]
    return transform_points(inverse(T_map_body), points_map)


def _evidence(samples: Sequence[EdgeSamples]) -> Evidence:
    rims = np.concatenate([sample.at_rims for sample in samples])
    share = sum(sample.in_view for sample in samples) / sum(sample.points for sample in samples)
    if len(rims) < _FEWEST_RIMS:
        return Evidence(share, len(rims), 1.0, 0.0)  # what is not seen explains as much as chance
    error = _NEIGHBOURS * float(rims.std()) / math.sqrt(len(rims))
    return Evidence(share, len(rims), float(rims.mean()), error)
