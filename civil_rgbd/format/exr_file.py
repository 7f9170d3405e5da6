"""The one way in which EXR files are written: whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from civil_rgbd.errors import OutputError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.storage.places import Place


def write_exr(
    path: Place, channels: Mapping[str, NDArray[np.floating]], *, what: str, sync: bool
) -> bytes:
    """Write one flat part, ZIP, its channels in the order of their names.

    Args:
        path: the file to make; its folder exists.
        channels: (H, W) each, of one size.
        what: is being written, for the error.
        sync: bring it to the disk now; without it the caller syncs later.

    Returns:
        the file's bytes; the same arrays give the same ones.

    Raises:
        OutputError: the file cannot be written.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    image = OpenEXR.File(
        header, {name: np.ascontiguousarray(channels[name]) for name in sorted(channels)}
    )
    with whole_file(path, sync=sync) as scratch:
        # Through a path, not a stream: OpenEXR before 3.5 writes to paths only. It notices a full
        # disk up to the last byte, and says so in a RuntimeError.
        scratch.touch()  # a folder that takes no file gets the system's own words
        try:
            image.write(str(scratch))
        except RuntimeError as error:
            raise OutputError(
                f"cannot write {what}: {error}",
                where=path,
                fix="free some space, or make the folder writable, or write elsewhere",
            ) from error
        return scratch.read_bytes()
