"""What a recording's messages hold when they are read, one at a time."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from civil_rgbd.domain.recording import CameraImage, Recording
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import ImageDecodeError


@dataclass(frozen=True, slots=True)
class Sample:
    """Numbers of the messages that are read.

    Attributes:
        scans: of LiDAR messages.
        images: of images.
    """

    scans: tuple[int, ...]
    images: tuple[int, ...]

    @classmethod
    def of(cls, recording: Recording, at_most: int) -> Sample:
        """Spread a sample over a recording; its first and last messages are in it."""
        scans, images = len(recording.scan_stamps_ns), len(recording.image_stamps_ns)
        return cls(_spread(scans, at_most), _spread(images, at_most))

    def reversed(self) -> Sample:
        """Return it from back to front."""
        return Sample(self.scans[::-1], self.images[::-1])

    def first(self) -> Sample:
        """Return its first messages."""
        return Sample(self.scans[:1], self.images[:1])


def _spread(count: int, at_most: int) -> tuple[int, ...]:
    if count <= at_most:
        return tuple(range(count))
    return tuple(np.linspace(0, count - 1, at_most).astype(int).tolist())


def scans_fit(recording: Recording, numbers: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong with scans: types, stamps, points that are timed out of reach."""
    for number in numbers:
        for what in _scan_fits(recording, recording.read_scan(number), number):
            yield f"scan {number}: {what}"


def _scan_fits(recording: Recording, scan: LidarScan, number: int) -> Iterator[str]:
    if not isinstance(scan, LidarScan):
        yield f"it is a {type(scan).__name__}, not a LidarScan"
        return
    stamp_ns = int(recording.scan_stamps_ns[number])
    if scan.stamp_ns != stamp_ns:
        yield f"its stamp is {scan.stamp_ns}, scan_stamps_ns says {stamp_ns}"
    if scan.points.dtype not in (np.float32, np.float64):
        yield f"its points are {scan.points.dtype}, not float32 or float64"
    if scan.noise is not None and scan.noise.dtype != np.bool_:
        yield f"its noise is {scan.noise.dtype}, not bool"
    deskew = recording.notes.deskew
    if scan.in_map != (deskew == "registered"):
        yield f"in_map is {scan.in_map}, but deskew is {deskew!r}"
    if deskew == "per_point" and scan.point_stamps_ns is None:
        yield "its points have no stamps, but deskew is 'per_point'"
    if deskew == "unavailable" and scan.point_stamps_ns is not None:
        yield "its points have stamps, but deskew is 'unavailable'"
    if scan.point_stamps_ns is not None and scan.point_stamps_ns.dtype != np.int64:
        yield f"its point stamps are {scan.point_stamps_ns.dtype}, not int64"
    earliest, latest = recording.point_reach_ns
    if scan.start_ns < stamp_ns + earliest or scan.end_ns > stamp_ns + latest:
        yield (
            f"its points are stamped {scan.start_ns - stamp_ns} to {scan.end_ns - stamp_ns} ns "
            f"after its header, point_reach_ns is {recording.point_reach_ns}"
        )


def images_fit(recording: Recording, numbers: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong with images; ones that cannot be decoded are the build's to count."""
    undecodable = 0
    for number in numbers:
        try:
            image = recording.read_image(number)
        except ImageDecodeError:
            undecodable += 1
            continue
        for what in _image_fits(recording, image, number):
            yield f"image {number}: {what}"
    if numbers and undecodable == len(numbers):
        yield "no image can be decoded"


def _image_fits(recording: Recording, image: CameraImage, number: int) -> Iterator[str]:
    if not isinstance(image, CameraImage):
        yield f"it is a {type(image).__name__}, not a CameraImage"
        return
    if image.index != number:
        yield f"its index is {image.index}"
    stamp_ns = int(recording.image_stamps_ns[number])
    if image.source_stamp_ns != stamp_ns:
        yield f"its stamp is {image.source_stamp_ns}, image_stamps_ns says {stamp_ns}"
    camera = recording.rig.camera.pinhole
    shape = (camera.height_px, camera.width_px, 3)
    if image.rgb.dtype != np.uint8 or image.rgb.shape != shape:
        yield f"it is {image.rgb.dtype} of shape {image.rgb.shape}, not uint8 of shape {shape}"


def digests(recording: Recording, sample: Sample) -> list[str]:
    """Read a sample; return a line a message: what it is and a hash of what it holds."""
    found = []
    for number in sample.scans:
        scan = recording.read_scan(number)
        parts = [scan.points, scan.point_stamps_ns, scan.noise, scan.stamp_ns, scan.in_map]
        found.append(f"scan {number} {_digest(parts)}")
    for number in sample.images:
        try:
            image = recording.read_image(number)
        except ImageDecodeError as error:
            found.append(f"image {number} {_digest([error.what])}")
        else:
            found.append(f"image {number} {_digest([image.rgb, image.source_stamp_ns])}")
    return found


def _digest(parts: Sequence[object]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype} {part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()
