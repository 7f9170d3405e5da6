"""Frames of a foreign set, decoded onto one pinhole's pixels."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera, source_pixels
from civil_rgbd.importers.pixels import SATURATED, read_colour, read_raw_depth
from civil_rgbd.importers.rendered_set import ImportOptions, Intrinsics, RenderedSet, SetFrame

_AREA_BELOW = 0.5  # bilinear lookups skip source pixels below this scale: average areas first


class OtherSizeError(RecordingError):
    """An image has another size than the set's first."""


class FrameReader:
    """Reads the frames of one set; the lookups are computed once.

    The stored camera is that of the depth images: depth moves only where a lens is taken out,
    and then takes the nearest pixel; colour is interpolated.

    Attributes:
        camera: the pinhole of every frame.
        missing_pixels: pixels of every frame that have no source; rgb and depth are 0 there.
        saturated_pixels: depths read so far at the 16-bit limit; they become 0.
        warnings: what was done to the images, in words.
    """

    def __init__(self, opened: RenderedSet, options: ImportOptions) -> None:
        rgb, raw = _first_whole(opened)
        self._rgb_shape, self._depth_shape = rgb.shape, raw.shape
        (height, width), (rgb_height, rgb_width) = raw.shape, rgb.shape[:2]
        intrinsics = _with_size(opened.intrinsics, rgb_width, rgb_height, opened)
        lens = _lens(intrinsics, options, opened)
        of_depth = opened.depth_intrinsics or lens
        colour, depth = lens.sized(rgb_width, rgb_height), of_depth.sized(width, height)
        _require_one_shape(rgb.shape, raw.shape, opened)
        self.camera: PinholeCamera = depth.pinhole
        self._colour = None if colour == LensCamera(self.camera) else colour
        self._depth_pixels, exists = _nearest_pixels(depth, self.camera)
        if self._colour is not None:
            self._maps, self._shrinks, has_colour = _colour_maps(self._colour, self.camera)
            exists &= has_colour
        self._missing = ~exists
        self.missing_pixels = int(self._missing.sum())
        self._z_over_depth = _z_over_ray(self.camera) if options.depth_along == "ray" else None
        self.saturated_pixels = 0
        self.warnings = _what_is_done(rgb.shape, raw.shape, lens, options)

    def raw_depth(self, frame: SetFrame) -> NDArray[np.uint16]:
        """Read a frame's depth in the set's units: (H, W) uint16, on the stored pixels.

        Raises:
            RecordingError: it is damaged.
            OtherSizeError: it has another size.
        """
        raw = read_raw_depth(frame.depth)
        if raw.shape != self._depth_shape:
            raise _other_size(frame, raw.shape, self._depth_shape)
        if self._depth_pixels is not None:
            raw = raw[self._depth_pixels]
        raw[self._missing] = 0
        return raw

    def read(self, frame: SetFrame, *, scale: float) -> RgbdFrame:
        """Read one frame.

        Args:
            frame: which.
            scale: stored depth units a metre.

        Raises:
            RecordingError: a file is damaged.
            OtherSizeError: an image has another size.
        """
        rgb = read_colour(frame.rgb)
        if rgb.shape != self._rgb_shape:
            raise _other_size(frame, rgb.shape, self._rgb_shape)
        raw = self.raw_depth(frame)
        saturated = raw == SATURATED
        self.saturated_pixels += int(saturated.sum())
        raw[saturated] = 0
        depth_m = self.depth_m(raw, scale=scale).astype(np.float32)
        return RgbdFrame(
            source_index=frame.source_index,
            stamp_ns=frame.stamp_ns,
            source_stamp_ns=frame.stamp_ns,
            rgb=self._on_depth_pixels(rgb),
            depth_m=depth_m,
            camera=self.camera,
            T_map_camera=frame.T_map_camera,
        )

    def depth_m(self, raw: NDArray[np.uint16], *, scale: float) -> NDArray[np.float64]:
        """Turn stored units into metres along the optical axis: (H, W) float64."""
        depth_m: NDArray[np.float64] = raw.astype(np.float64) / scale
        return depth_m if self._z_over_depth is None else depth_m * self._z_over_depth

    def _on_depth_pixels(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self._colour is not None:
            size = (self.camera.width_px, self.camera.height_px)
            if self._shrinks:
                rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
            rgb = cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            rgb[self._missing] = 0
        return rgb


def _first_whole(opened: RenderedSet) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """The first image and depth that can be read: they say how large the others are."""
    first: RecordingError | None = None
    for frame in opened.frames:
        try:
            return read_colour(frame.rgb), read_raw_depth(frame.depth)
        except RecordingError as error:
            first = first or error
    raise first or RecordingError(
        f"none of {opened.images_seen} images has a depth and a pose: {dict(opened.dropped)}",
        where=opened.root,
        fix="compare the names of images, depth and poses; or give --poses FILE",
    )


def _with_size(camera: Intrinsics, width: int, height: int, opened: RenderedSet) -> Intrinsics:
    """Give a camera the image's size; one for another size must have the image's shape."""
    if camera.width_px is None or camera.height_px is None:
        return replace(camera, width_px=width, height_px=height)
    if abs(width * camera.height_px - height * camera.width_px) > max(width, height):
        raise RecordingError(
            f"the camera is for {camera.width_px} x {camera.height_px} pixels, the images have "
            f"{width} x {height}: another shape",
            where=opened.root,
            fix="give this camera's intrinsics: --intrinsics FILE or fx,fy,cx,cy",
        )
    return camera


def _lens(camera: Intrinsics, options: ImportOptions, opened: RenderedSet) -> Intrinsics:
    if not camera.distorts or options.lens == "ignore":
        return replace(camera, coefficients=())
    if options.lens is None or camera.fy_px < 0:
        raise RecordingError(
            f"the camera has lens distortion {list(camera.coefficients)}, and nothing says whether "
            "the images still have it; the stored camera is a pinhole",
            where=opened.root,
            fix="give --lens undistort where images and depth are distorted, --lens ignore where "
            "it was taken out already (the lab's converter does so)",
        )
    return camera


def _require_one_shape(rgb: tuple[int, ...], depth: tuple[int, ...], opened: RenderedSet) -> None:
    if opened.depth_intrinsics is None and abs(rgb[1] * depth[0] - rgb[0] * depth[1]) > max(rgb):
        raise RecordingError(
            f"images have {rgb[1]} x {rgb[0]} pixels, depth {depth[1]} x {depth[0]}: another "
            "shape, so they were not taken by one camera",
            where=opened.root,
            fix="register the depth to the image first",
        )


def _nearest_pixels(
    raw: LensCamera, stored: PinholeCamera
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]] | None, NDArray[np.bool_]]:
    """Where each stored pixel's depth comes from; None where it stays in its place."""
    if not raw.distorts:
        return None, np.ones((stored.height_px, stored.width_px), dtype=np.bool_)
    source = source_pixels(raw, stored)
    rows = np.floor(source.rows + np.float32(0.5)).clip(0, stored.height_px - 1).astype(np.intp)
    columns = np.floor(source.columns + np.float32(0.5)).clip(0, stored.width_px - 1)
    return (rows, columns.astype(np.intp)), source.exists


def _colour_maps(
    raw: LensCamera, stored: PinholeCamera
) -> tuple[tuple[NDArray[np.int16], NDArray[np.uint16]], bool, NDArray[np.bool_]]:
    """cv2.remap's fixed-point lookup, whether to shrink first, and which pixels have colour."""
    shrinks = stored.width_px < _AREA_BELOW * raw.pinhole.width_px
    if shrinks:
        sx = stored.width_px / raw.pinhole.width_px
        sy = stored.height_px / raw.pinhole.height_px
        small = PinholeCamera(
            width_px=stored.width_px,
            height_px=stored.height_px,
            fx_px=raw.pinhole.fx_px * sx,
            fy_px=raw.pinhole.fy_px * sy,
            cx_px=(raw.pinhole.cx_px + 0.5) * sx - 0.5,
            cy_px=(raw.pinhole.cy_px + 0.5) * sy - 0.5,
        )
        raw = replace(raw, pinhole=small)
    source = source_pixels(raw, stored)
    # Fixed point: cv2.remap then counts in integers, and every processor gives the same pixels.
    maps = cv2.convertMaps(source.columns, source.rows, cv2.CV_16SC2)
    return (maps[0], maps[1]), shrinks, source.exists


def _z_over_ray(camera: PinholeCamera) -> NDArray[np.float64]:
    x = (np.arange(camera.width_px) - camera.cx_px) / camera.fx_px
    y = (np.arange(camera.height_px) - camera.cy_px) / camera.fy_px
    ratio: NDArray[np.float64] = 1.0 / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)
    return ratio


def _what_is_done(
    rgb: tuple[int, ...], depth: tuple[int, ...], lens: Intrinsics, options: ImportOptions
) -> tuple[str, ...]:
    said = []
    if rgb[:2] != depth:
        said.append(
            f"colour images of {rgb[1]} x {rgb[0]} pixels were put on the depth's "
            f"{depth[1]} x {depth[0]}"
        )
    if lens.distorts:
        said.append("the lens was taken out of images and depth; depth took the nearest pixel")
    if options.depth_along == "ray":
        said.append("the set's depth is along the ray; it was turned into depth along the axis")
    return tuple(said)


def _other_size(frame: SetFrame, found: tuple[int, ...], wanted: tuple[int, ...]) -> OtherSizeError:
    return OtherSizeError(
        f"image {frame.source_index} has {found[1]} x {found[0]} pixels, the first has "
        f"{wanted[1]} x {wanted[0]}",
        where=frame.rgb,
        fix="a bridge has one camera: convert the images of each size on their own",
    )
