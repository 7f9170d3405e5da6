"""Depth for photos: a model and a camera in, depth images out."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.baselines.model import DepthModel, predict_frame
from civil_rgbd.constants import NO_DEPTH_M
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.errors import CivilRgbdError, OutputError, UsageError
from civil_rgbd.format.atomic import whole_file, writing
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.images import encode_image
from civil_rgbd.format.intrinsics import write_intrinsics
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.pipeline.image import image_maker

PHOTO_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""What counts as a photo, in any case of letters."""

_ASPECT_TOLERANCE: Final = 0.01
"""By how much the two sides' factors may differ when intrinsics are scaled to a photo."""

_NEAR_AND_FAR: Final = (0.02, 0.98)  # quantiles of depth between which colours run


@dataclass(frozen=True, slots=True)
class PhotoCamera:
    """What is known of the camera that took the photos: one of the two.

    Attributes:
        calibrated: a calibration, with or without a lens; it holds for photos of its own size and,
            scaled, for others of the same shape. EXIF orientation is ignored, as it was calibrated.
        focal_px: a focal length, the principal point in the middle; photos are turned upright.
    """

    calibrated: LensCamera | None = None
    focal_px: float | None = None

    def __post_init__(self) -> None:
        if (self.calibrated is None) == (self.focal_px is None):
            raise UsageError(
                "the camera is given twice, or not at all",
                where="--intrinsics, --rig, --focal-px",
                fix="give one of them",
            )
        if self.focal_px is not None and not 0 < self.focal_px < np.inf:
            raise UsageError(
                f"the focal length is no positive number: {self.focal_px}",
                where="--focal-px",
                fix="give pixels: the photo's width in px x focal length / sensor width",
            )

    def of(self, *, width_px: int, height_px: int, where: object) -> LensCamera:
        """Return the camera of a photo of this size.

        Raises:
            UsageError: the photo's shape is not that of the calibration.
        """
        if self.focal_px is not None:
            cx, cy = (width_px - 1) / 2, (height_px - 1) / 2
            return LensCamera(
                PinholeCamera(width_px, height_px, self.focal_px, self.focal_px, cx, cy)
            )
        assert self.calibrated is not None  # noqa: S101 - one of the two, as checked when made
        pinhole = self.calibrated.pinhole
        sx, sy = width_px / pinhole.width_px, height_px / pinhole.height_px
        if abs(sx / sy - 1) > _ASPECT_TOLERANCE:
            raise UsageError(
                f"the photo has {width_px} x {height_px} px, its camera {pinhole.width_px} x "
                f"{pinhole.height_px}: these have not the same shape",
                where=where,
                fix="give the camera of these very photos; crops and upright photos need their own",
            )
        scaled = PinholeCamera(
            width_px=width_px,
            height_px=height_px,
            fx_px=pinhole.fx_px * sx,
            fy_px=pinhole.fy_px * sy,
            cx_px=(pinhole.cx_px + 0.5) * sx - 0.5,
            cy_px=(pinhole.cy_px + 0.5) * sy - 0.5,
        )
        return LensCamera(scaled, self.calibrated.lens, self.calibrated.coefficients)


@dataclass(slots=True)
class PredictionReport:
    """What became of the photos.

    Attributes:
        predicted: photos with a depth image.
        failed: what went wrong, by photo.
        left_out: files that are no photos.
        without_answer: pixels for which a model had no answer, by photo; stored as 0.
        near_m: depth at the warm end of the colours, by photo.
        far_m: depth at the cold end, by photo.
    """

    predicted: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    without_answer: dict[str, int] = field(default_factory=dict)
    near_m: dict[str, float] = field(default_factory=dict)
    far_m: dict[str, float] = field(default_factory=dict)

    def to_text(self) -> str:
        """Say it in words."""
        lines = [f"{len(self.predicted)} photos predicted"]
        if self.left_out:
            lines.append(f"{len(self.left_out)} files are no photos: {', '.join(self.left_out)}")
        lines += [f"{name}: {count} pixels without answer" for name, count in self._unanswered()]
        lines += [f"{name}: failed: {words}" for name, words in self.failed.items()]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Say it for machines."""
        return json.dumps(asdict(self), indent=2)

    def _unanswered(self) -> list[tuple[str, int]]:
        return [(name, count) for name, count in self.without_answer.items() if count]


def photos_in(location: Path) -> tuple[list[Path], list[str]]:
    """List the photos of a folder by name, or the one photo.

    Returns:
        the photos, and the names of files that are none.

    Raises:
        UsageError: there are none, or two differ by suffix only and would share a depth image.
    """
    if not location.exists():
        raise UsageError("there is no such file or folder", where=location, fix="check the path")
    files = (
        sorted(p for p in location.iterdir() if p.is_file()) if location.is_dir() else [location]
    )
    photos = [path for path in files if path.suffix.lower() in PHOTO_SUFFIXES]
    stems = [path.stem for path in photos]
    twins = sorted({stem for stem in stems if stems.count(stem) > 1})
    if not photos or twins:
        raise UsageError(
            f"two photos share the name {twins[0]!r}" if twins else "there is no photo here",
            where=location,
            fix="rename one" if twins else f"photos end in {', '.join(PHOTO_SUFFIXES)}",
        )
    return photos, [path.name for path in files if path not in photos]


def predict_photos(
    model: DepthModel,
    location: Path,
    camera: PhotoCamera,
    out: Path,
    *,
    on_photo: Callable[[int, int], object] = lambda _done, _total: None,
) -> PredictionReport:
    """Predict every photo of a folder.

    Writes ``depth/NAME.exr`` (metres, 0 = no answer), ``colour/NAME.png`` to look at, and
    ``intrinsics/NAME.json``; and where a lens was taken out ``rgb/NAME.png``, the image that the
    depth belongs to. A photo that fails is reported, and the others go on.

    Args:
        model: predicts.
        location: a folder of photos, or one photo.
        camera: what is known of the camera.
        out: a folder to make; if it exists it is empty.
        on_photo: is told of every photo that is done: 1, and how many there are.

    Raises:
        UsageError: there are no photos.
        OutputError: the folder holds something, or cannot be written.
    """
    photos, left_out = photos_in(location)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise OutputError(
            "the folder holds something already", where=out, fix="choose another --out, or empty it"
        )
    with writing(out):
        for part in ("depth", "colour", "intrinsics"):
            (out / part).mkdir(parents=True, exist_ok=True)
    report = PredictionReport(left_out=left_out)
    for photo in photos:
        try:
            _predict_one(model, photo, camera, out, report)
            report.predicted.append(photo.name)
        except OutputError:
            raise  # the disk that is full now is full for all
        except CivilRgbdError as error:
            report.failed[photo.name] = error.what
        on_photo(1, len(photos))
    return report


def _predict_one(
    model: DepthModel, photo: Path, camera: PhotoCamera, out: Path, report: PredictionReport
) -> None:
    raw_rgb = _read_photo(photo, upright=camera.calibrated is None)
    raw = camera.of(width_px=raw_rgb.shape[1], height_px=raw_rgb.shape[0], where=photo)
    maker = image_maker(raw, ImageStage(scale=1.0))
    rgb = maker.make(raw_rgb)
    depth_m = predict_frame(model, rgb, maker.camera, bridge=photo.parent.name, frame=photo.stem)
    answered = np.isfinite(depth_m) & (depth_m > 0) & maker.exists
    stored = np.where(answered, depth_m, np.float32(NO_DEPTH_M)).astype(np.float32)
    near_m, far_m = _near_and_far(stored[answered])
    report.without_answer[photo.name] = int((~answered).sum())
    report.near_m[photo.name], report.far_m[photo.name] = near_m, far_m
    write_depth(out / "depth" / f"{photo.stem}.exr", stored)
    _write_png(out / "colour" / f"{photo.stem}.png", coloured(stored, near_m=near_m, far_m=far_m))
    write_intrinsics(out / "intrinsics" / f"{photo.stem}.json", maker.camera)
    if raw.distorts:
        with writing(out):
            (out / "rgb").mkdir(exist_ok=True)
        _write_png(out / "rgb" / f"{photo.stem}.png", rgb)


def _read_photo(photo: Path, *, upright: bool) -> NDArray[np.uint8]:
    flags = cv2.IMREAD_COLOR | (0 if upright else cv2.IMREAD_IGNORE_ORIENTATION)
    try:
        data = np.frombuffer(photo.read_bytes(), np.uint8)
        bgr = cv2.imdecode(data, flags) if len(data) else None
    except (OSError, cv2.error) as error:
        raise UsageError(
            f"the photo cannot be read: {error}", where=photo, fix="check it"
        ) from error
    if bgr is None:
        raise UsageError("the file is no image, or it is cut off", where=photo, fix="copy it again")
    rgb: NDArray[np.uint8] = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
    return rgb


def _near_and_far(depths_m: NDArray[np.float32]) -> tuple[float, float]:
    if not depths_m.size:
        return 0.0, 0.0
    near_m, far_m = np.quantile(depths_m, _NEAR_AND_FAR)
    return float(near_m), float(far_m)


def coloured(depth_m: NDArray[np.float32], *, near_m: float, far_m: float) -> NDArray[np.uint8]:
    """Paint depth: near is warm, far is cold, no depth is black.

    Args:
        depth_m: (H, W) float32, metres, 0 = none.
        near_m: depth of the warm end.
        far_m: depth of the cold end.

    Returns:
        (H, W, 3) uint8, red first.
    """
    share = (far_m - depth_m) / max(far_m - near_m, 1e-6)
    levels = (share.clip(0, 1) * 255).astype(np.uint8)
    rgb: NDArray[np.uint8] = cv2.cvtColor(
        cv2.applyColorMap(levels, cv2.COLORMAP_TURBO), cv2.COLOR_BGR2RGB
    )
    rgb[depth_m == NO_DEPTH_M] = 0
    return rgb


def _write_png(path: Path, rgb: NDArray[np.uint8]) -> None:
    with whole_file(path, sync=False) as scratch:
        scratch.write_bytes(encode_image(rgb, codec="png"))
