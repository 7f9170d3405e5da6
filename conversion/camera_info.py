"""sensor_msgs/CameraInfo to a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from civil_rgbd.conversion.cdr import CdrReader
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera

# ROS's names of lens models, and how many coefficients OpenCV's model of that kind takes.
_MODELS: Final = {
    "plumb_bob": ("plumb_bob", 5),
    "rational_polynomial": ("rational_polynomial", 8),
    "fisheye": ("fisheye", 4),
    "equidistant": ("fisheye", 4),
    "kannala_brandt4": ("fisheye", 4),
}
_THIN_PRISM = 12  # rational_polynomial with s1 s2 s3 s4; two more would tilt the sensor


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """The message, as recorded.

    Attributes:
        frame: header frame id.
        width_px: of the full sensor.
        height_px: of the full sensor.
        model: ``distortion_model``.
        d: distortion coefficients.
        k: (9) intrinsics of the raw image, row by row.
        p: (12) projection of the rectified image, row by row.
        binning: x, y; 0 = 1.
        roi: left, top, width, height in pixels of the full sensor; all 0 = everything.
    """

    frame: str
    width_px: int
    height_px: int
    model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    p: tuple[float, ...]
    binning: tuple[int, int]
    roi: tuple[int, int, int, int]

    @property
    def calibrated(self) -> bool:
        """Whether it says anything: K of an uncalibrated camera is zero."""
        return any(self.k)


def parse_camera_info(payload: memoryview, read: type[CdrReader] = CdrReader) -> CameraInfo:
    """Take a CameraInfo apart.

    Args:
        payload: the message.
        read: reads its encoding.

    Raises:
        CdrError: it breaks its layout.
    """
    reader = read(payload)
    _, frame = reader.header()
    height_px, width_px, model = reader.uint32(), reader.uint32(), reader.text()
    d = reader.float64s(reader.count(smallest_bytes=8))
    k, _, p = reader.float64s(9), reader.float64s(9), reader.float64s(12)
    binning = (reader.uint32(), reader.uint32())
    left, top, roi_height, roi_width = (reader.uint32() for _ in range(4))
    return CameraInfo(
        frame=frame,
        width_px=width_px,
        height_px=height_px,
        model=model,
        d=d,
        k=k,
        p=p,
        binning=binning,
        roi=(left, top, roi_width, roi_height),
    )


def camera_from_info(info: CameraInfo, *, rectified: bool, where: object) -> LensCamera:
    """Build the camera of the published images.

    Args:
        info: calibrated.
        rectified: the images are rectified: P and no distortion, else K and D.
        where: file and topic, for errors.

    Raises:
        RecordingError: the model is not known, or its numbers make no camera.
    """
    from_p = rectified and any(info.p)
    matrix = (*info.p[0:3], *info.p[4:7], *info.p[8:11]) if from_p else info.k
    try:
        pinhole = _windowed(info, matrix)
        if rectified:
            return LensCamera(pinhole)
        return LensCamera(pinhole, *_lens(info))
    except ValueError as error:
        raise RecordingError(
            f"CameraInfo describes no camera that is known: {error}",
            where=where,
            fix="give the camera in a rig file (--rig), or choose another --camera-info-topic",
        ) from error


def _windowed(info: CameraInfo, matrix: tuple[float, ...]) -> PinholeCamera:
    """Apply region of interest, then binning; a bin's centre is the centre of its pixels."""
    left, top, width, height = info.roi
    width, height = width or info.width_px, height or info.height_px
    bin_x, bin_y = (max(1, factor) for factor in info.binning)
    return PinholeCamera(
        width_px=width // bin_x,
        height_px=height // bin_y,
        fx_px=matrix[0] / bin_x,
        fy_px=matrix[4] / bin_y,
        cx_px=(matrix[2] - left + 0.5) / bin_x - 0.5,
        cy_px=(matrix[5] - top + 0.5) / bin_y - 0.5,
    )


def _lens(info: CameraInfo) -> tuple[str, tuple[float, ...]]:
    if not all(map(math.isfinite, info.d)):
        raise ValueError(f"distortion coefficients {info.d} are not finite")
    name, taken = _MODELS.get(info.model.lower(), ("", 0))
    if name != "fisheye" and not any(info.d):
        return "none", ()
    if not name:
        raise ValueError(
            f"distortion_model {info.model!r} is none of {', '.join(_MODELS)}, and D is not zero"
        )
    if name == "rational_polynomial" and any(info.d[taken:]):
        taken = _THIN_PRISM
    if any(info.d[taken:]):
        raise ValueError(f"{info.model} takes {taken} coefficients, D has {len(info.d)}")
    least = 4 if name in ("plumb_bob", "fisheye") else 0
    if len(info.d) < least:
        raise ValueError(f"{info.model} takes {taken} coefficients, D has {len(info.d)}")
    return name, (*info.d[:taken], *(0.0,) * (taken - len(info.d)))
