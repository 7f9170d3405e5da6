"""``intrinsics.json``: the pinhole camera of the stored images."""

from __future__ import annotations

import dataclasses

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.errors import FormatError
from civil_rgbd.format.documents import check_document, read_document, write_document
from civil_rgbd.format.versions import Document, current_document
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.storage.places import Place

KIND = "intrinsics"


def read_intrinsics(path: Place) -> PinholeCamera:
    """Read ``intrinsics.json``.

    Raises:
        FormatError: the file is missing, damaged, or breaks its schema.
    """
    return camera_from_document(read_document(path), where=path)


def camera_from_document(document: Document, *, where: object) -> PinholeCamera:
    """Turn a parsed ``intrinsics.json`` into a camera.

    Raises:
        FormatError: it breaks its schema.
    """
    document = current_document(document, kind=KIND, where=where)
    check_document(document, kind=KIND, where=where)
    return pinhole_from(document, where=where)


def pinhole_from(values: Document, *, where: object) -> PinholeCamera:
    """Turn checked values into a camera; keys that are none of its fields are left alone.

    Raises:
        FormatError: the values are no camera.
    """
    try:
        return PinholeCamera(
            width_px=int(values["width_px"]),
            height_px=int(values["height_px"]),
            fx_px=float(values["fx_px"]),
            fy_px=float(values["fy_px"]),
            cx_px=float(values["cx_px"]),
            cy_px=float(values["cy_px"]),
        )
    except (ValueError, OverflowError) as error:
        raise FormatError(
            f"this describes no camera: {error}", where=where, fix="mend the values"
        ) from error


def camera_to_document(camera: PinholeCamera) -> Document:
    """Turn a camera into the document that :func:`camera_from_document` reads."""
    return {
        "format_version": FORMAT_VERSION,
        "model": "pinhole",
        **dataclasses.asdict(camera),
    }


def write_intrinsics(path: Place, camera: PinholeCamera) -> None:
    """Write ``intrinsics.json``, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_document(path, camera_to_document(camera), kind=KIND)
