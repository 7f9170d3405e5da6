"""Do a frame's files hold what the index says, and what the recipe promises?"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import decode_depth, read_bytes, read_depth
from civil_rgbd.format.hashes import bytes_sha256, float_fault, pixel_sha256
from civil_rgbd.format.images import decode_image
from civil_rgbd.format.manifest import quality_channels
from civil_rgbd.format.quality_exr import Planes, decode_quality, quality_sha256
from civil_rgbd.format.writer import depth_statistics
from civil_rgbd.storage.places import Place
from civil_rgbd.validation.documents import BridgeDocuments, recipe_value
from civil_rgbd.validation.report import Finding

_Fault = tuple[str, str]  # code and message


@dataclass(frozen=True, slots=True)
class FrameRules:
    """What holds for every frame of a bridge.

    Attributes:
        size: height and width of the images; None when the camera could not be read.
        min_m: smallest depth; None for an imported bridge.
        max_m: largest depth; None for an imported bridge.
        step_m: depths are multiples of this; None or 0 for any.
        quality: names of the quality planes; () for none, None when the manifest is unreadable.
    """

    size: tuple[int, int] | None
    min_m: float | None
    max_m: float | None
    step_m: float | None
    quality: tuple[str, ...] | None


def frame_rules(read: BridgeDocuments) -> FrameRules:
    """Take the rules from a bridge's camera and recipe."""
    camera = read.camera
    return FrameRules(
        size=None if camera is None else (camera.height_px, camera.width_px),
        min_m=recipe_value(read.manifest, "depth", "min_m"),
        max_m=recipe_value(read.manifest, "depth", "max_m"),
        step_m=recipe_value(read.manifest, "depth", "step_m"),
        quality=None if read.manifest is None else quality_channels(read.manifest),
    )


def check_frame(folder: Place, row: FrameRow, rules: FrameRules, bridge: str) -> Iterator[Finding]:
    """Check the files of one frame; files that are not there were reported already.

    Args:
        folder: the bridge folder.
        row: the frame's row of the index.
        rules: what holds for every frame.
        bridge: its name in findings.
    """
    faults = {
        row.rgb_path: _rgb_faults(folder / row.rgb_path, row, rules),
        row.depth_path: _depth_faults(folder / row.depth_path, row, rules),
    }
    if row.quality_path is not None:
        faults[row.quality_path] = _quality_faults(
            folder / row.quality_path, row, folder / row.depth_path, rules
        )
    elif rules.quality:
        message = f"no quality planes, the manifest has {', '.join(rules.quality)}"
        yield Finding("quality-planes", message, row.depth_path, bridge)
    for path, some in faults.items():
        if _is_inside(folder, path):
            for code, message in some:
                yield Finding(code, message, path, bridge)


def _is_inside(folder: Place, path: str) -> bool:
    """Tell whether a path names a file of the bridge: an index may name any file of the system."""
    parts = path.split("/")
    return ".." not in parts and "" not in parts and (folder / path).is_file()


def _hash_faults(data: bytes, expected: str) -> Iterator[_Fault]:
    digest = bytes_sha256(data)
    if digest != expected:
        yield "file-hash", f"sha256 is {digest}, the index has {expected}"


def _rgb_faults(path: Place, row: FrameRow, rules: FrameRules) -> Iterator[_Fault]:
    try:
        data = read_bytes(path)
        changed = list(_hash_faults(data, row.rgb_file_sha256))
        yield from changed
        rgb = decode_image(data, where=path)
    except FormatError as error:
        yield "rgb-unreadable", error.what
        return
    yield from _size_faults("rgb-size", rgb, rules)
    digest = pixel_sha256(rgb)
    if digest != row.rgb_pixel_sha256:
        lossy = path.suffix == ".jpg" and not changed
        code = "rgb-decoder" if lossy else "rgb-pixel-hash"
        yield code, f"pixel hash is {digest}, the index has {row.rgb_pixel_sha256}"


def _size_faults(code: str, pixels: NDArray[np.generic], rules: FrameRules) -> Iterator[_Fault]:
    height, width = pixels.shape[:2]
    if rules.size is not None and (height, width) != rules.size:
        yield code, f"{width} x {height} pixels, the camera has {rules.size[1]} x {rules.size[0]}"


def _depth_faults(path: Place, row: FrameRow, rules: FrameRules) -> Iterator[_Fault]:
    try:
        data = read_bytes(path)
        yield from _hash_faults(data, row.depth_file_sha256)
        depth_m = decode_depth(path, data)
    except FormatError as error:
        yield "depth-unreadable", error.what
        return
    yield from _size_faults("depth-size", depth_m, rules)
    odd = int(np.count_nonzero(~np.isfinite(depth_m)))
    if odd:
        yield "depth-not-finite", f"{odd} pixels are NaN or Inf"
        return
    negative = int(np.count_nonzero(np.signbit(depth_m)))  # -0.0 too: it changes the hash
    if negative:
        yield "depth-negative", f"{negative} pixels are below 0 or are -0.0"
        return
    yield from _value_faults(depth_m, rules)
    statistics = depth_statistics(depth_m)
    said = (row.valid_share, row.depth_min_m, row.depth_max_m)
    if statistics != said:
        yield (
            "depth-statistics",
            f"share, least and most are {statistics}, the index has {said}",
        )
    digest = pixel_sha256(depth_m)
    if digest != row.depth_pixel_sha256:
        message = f"pixel hash is {digest}, the index has {row.depth_pixel_sha256}"
        yield "depth-pixel-hash", message


def _value_faults(depth_m: NDArray[np.float32], rules: FrameRules) -> Iterator[_Fault]:
    step_m = np.float32(rules.step_m or 0.0)
    if step_m > 0:
        # Exact in float32, as the step is a power of two.
        steps = depth_m / step_m
        off = int(np.count_nonzero(steps != np.rint(steps)))
        if off:
            yield "depth-off-step", f"{off} pixels are no multiple of {float(step_m)!r} m"
    if rules.min_m is None or rules.max_m is None:
        return
    # Rounding to the step may carry a depth past the limit by half of it.
    low, high = np.float32(rules.min_m - step_m / 2), np.float32(rules.max_m + step_m / 2)
    outside = int(np.count_nonzero((depth_m != 0) & ((depth_m < low) | (depth_m > high))))
    if outside:
        yield (
            "depth-out-of-range",
            (
                f"{outside} pixels lie outside {rules.min_m} to {rules.max_m} m; the depths are "
                f"{depth_m[depth_m != 0].min()} to {depth_m.max()} m"
            ),
        )


def _quality_faults(
    path: Place, row: FrameRow, depth_path: Place, rules: FrameRules
) -> Iterator[_Fault]:
    try:
        data = read_bytes(path)
        yield from _hash_faults(data, row.quality_file_sha256 or "")
        planes = decode_quality(path, data)
    except FormatError as error:
        yield "quality-unreadable", error.what
        return
    if rules.quality is not None and set(planes) != set(rules.quality):
        words = ", ".join(rules.quality) or "none"
        yield "quality-planes", f"planes are {', '.join(planes)}, the manifest has {words}"
    yield from _size_faults("quality-size", next(iter(planes.values())), rules)
    odd = [name for name, plane in planes.items() if float_fault(plane)]
    if odd:
        yield "quality-values", f"NaN, Inf or -0.0 in {', '.join(odd)}"
        return
    yield from _contradictions(planes, depth_path)
    digest = quality_sha256(planes)
    if digest != row.quality_pixel_sha256:
        message = f"pixel hash is {digest}, the index has {row.quality_pixel_sha256}"
        yield "quality-pixel-hash", message


def _contradictions(planes: Planes, depth_path: Place) -> Iterator[_Fault]:
    """Do the planes and the depth speak of the same pixels?"""
    try:
        depth_m = read_depth(depth_path)
    except FormatError:
        return  # said already
    if any(plane.shape != depth_m.shape for plane in planes.values()):
        return  # said already
    measured = depth_m > 0
    contradicts: dict[str, Callable[[NDArray[np.floating]], NDArray[np.bool_]]] = {
        "sigma_m": lambda plane: (plane > 0) != measured,
        "empty": lambda plane: (plane == 0) != measured,
        "returns": lambda plane: (plane < 1) & measured,
    }
    for name, test in contradicts.items():
        count = int(np.count_nonzero(test(planes[name]))) if name in planes else 0
        if count:
            yield "quality-values", f"{name} contradicts the depth in {count} pixels"
