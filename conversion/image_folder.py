"""Images in a folder, with their stamps in a list."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.ros_images import rgb_from_encoded
from civil_rgbd.domain.folders import IMAGE_SUFFIXES, TIME_LISTS, files_in_order
from civil_rgbd.domain.recording import CameraImage
from civil_rgbd.domain.stamps import StampList, read_stamp_list
from civil_rgbd.errors import ImageDecodeError, RecordingError
from civil_rgbd.geometry.camera import LensCamera


@dataclass(frozen=True, slots=True, eq=False)
class ImageFolder:
    """Images of one camera, ordered by time.

    Attributes:
        paths: the images.
        stamps_ns: (I,) int64, camera clock.
        times: the list that the stamps come from.
        without_stamp: images of the folder that the list does not name; they are left out.
    """

    paths: tuple[Path, ...]
    stamps_ns: NDArray[np.int64]
    times: Path
    without_stamp: int = 0


def open_images(folder: Path, times: Path | None) -> ImageFolder:
    """List the images of a folder with their stamps.

    Args:
        folder: JPEG and PNG files in it are images.
        times: one stamp an image in numeric order of their names, or name and stamp; None takes
            one of :data:`TIME_LISTS` inside the folder.

    Raises:
        RecordingError: there are no images or stamps, or they do not belong to each other.
    """
    files = files_in_order(folder, IMAGE_SUFFIXES)
    if not files:
        raise RecordingError(
            "the folder holds no images",
            where=folder,
            fix=f"give the folder with the {', '.join(IMAGE_SUFFIXES)} files themselves",
        )
    stamps = read_stamp_list(times or find_times(folder, "--image-times"))
    paths, stamps_ns = match_stamps(files, stamps)
    return ImageFolder(paths, stamps_ns, stamps.where, len(files) - len(paths))


def find_times(folder: Path, option: str) -> Path:
    """Return the time list inside a folder.

    Raises:
        RecordingError: there is none.
    """
    for name in TIME_LISTS:
        if (folder / name).is_file():
            return folder / name
    raise RecordingError(
        f"the folder has no time list ({', '.join(TIME_LISTS)})",
        where=folder,
        fix=f"give one with {option}: a stamp in seconds a line, in numeric order of the files, "
        "or NAME,SECONDS",
    )


def match_stamps(
    files: tuple[Path, ...], stamps: StampList
) -> tuple[tuple[Path, ...], NDArray[np.int64]]:
    """Bring files and stamps together.

    Args:
        files: in numeric order.
        stamps: one each, in that order, or by file name (its suffix may be missing).

    Returns:
        the files that have a stamp, ordered by it; and the stamps (N,).

    Raises:
        RecordingError: there are more or fewer stamps than files, or a name names none.
    """
    if stamps.names is None:
        if len(stamps.stamps_ns) != len(files):
            raise RecordingError(
                f"there are {len(files)} files in {files[0].parent.name!r}, but "
                f"{len(stamps.stamps_ns)} stamps",
                where=stamps.where,
                fix="give one stamp a file, or NAME,SECONDS a line; is it the right list?",
            )
        return files, stamps.stamps_ns
    named = {path.stem: path for path in files} | {path.name: path for path in files}
    for name in stamps.names:
        if name not in named:
            raise RecordingError(
                f"the list names {name!r}, which is not among the {len(files)} files of "
                f"{files[0].parent.name!r}",
                where=stamps.where,
                fix="give the list that belongs to this folder",
            )
    return tuple(named[name] for name in stamps.names), stamps.stamps_ns


def read_image_file(path: Path, index: int, stamp_ns: int, camera: LensCamera) -> CameraImage:
    """Decode one image.

    Raises:
        ImageDecodeError: this one image cannot be read; others may.
        RecordingError: it does not fit the camera.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ImageDecodeError(
            f"an image cannot be read: {error.strerror or error}",
            where=path,
            fix="the build counts it and goes on; check the disk and the file's permissions",
        ) from error
    rgb = rgb_from_encoded(memoryview(data), "", where=path)
    pinhole = camera.pinhole
    if rgb.shape[:2] != (pinhole.height_px, pinhole.width_px):
        raise RecordingError(
            f"images have {rgb.shape[1]} x {rgb.shape[0]} pixels, the rig's camera "
            f"{pinhole.width_px} x {pinhole.height_px}",
            where=path,
            fix="give the camera of these images in the rig file (--rig)",
        )
    return CameraImage(index, stamp_ns, rgb)
