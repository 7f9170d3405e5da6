"""Hashes of files and of decoded pixels."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.storage.places import Place


def bytes_sha256(data: bytes | memoryview) -> str:
    """Return the SHA-256 of some bytes, lower-case hex."""
    return hashlib.sha256(data).hexdigest()


def file_sha256(path: Place) -> str:
    """Return the SHA-256 of a file, lower-case hex, in constant memory."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def document_sha256(document: Any) -> str:  # noqa: ANN401  # anything that JSON can say
    """Return the SHA-256 of a document's canonical JSON: sorted keys, no spaces, ASCII.

    >>> document_sha256({"b": 1, "a": 2.0}) == document_sha256({"a": 2.0, "b": 1})
    True
    """
    return bytes_sha256(json.dumps(document, sort_keys=True, separators=(",", ":")).encode("ascii"))


def pixel_sha256(pixels: NDArray[np.generic]) -> str:
    r"""Return the hash of decoded pixels: the same for every writer of the same pixels.

    SHA-256 over, in ASCII, numpy's name of the little-endian dtype (``|u1``, ``<f4``), one space,
    the sizes joined by ``x`` (``432x768x3``) and a line feed; then the values, row by row (C
    order), little-endian; colours in the order red, green, blue.

    Args:
        pixels: any shape, integers or floats.

    Returns:
        lower-case hex.

    Raises:
        ValueError: a value is NaN, Inf or -0.0: equal pixels would have different hashes.

    >>> import hashlib
    >>> expected = hashlib.sha256(b"<f4 1x2\n" + b"\0\0\0\0" + b"\0\0\x80\x3f").hexdigest()
    >>> pixel_sha256(np.array([[0.0, 1.0]], dtype=np.float32)) == expected
    True
    """
    if pixels.dtype.kind == "f":
        fault = float_fault(pixels)
        if fault:
            raise ValueError(fault)
    dtype = pixels.dtype.newbyteorder("<")
    values = np.ascontiguousarray(pixels, dtype=dtype)
    head = f"{dtype.str} {'x'.join(map(str, pixels.shape))}\n"
    digest = hashlib.sha256(head.encode("ascii"))
    digest.update(values.data)
    return digest.hexdigest()


def float_fault(values: NDArray[Any]) -> str | None:
    """Say in words which values have no place in stored pixels: NaN, Inf, -0.0; None for none."""
    odd = ~np.isfinite(values)
    if odd.any():
        return f"{int(odd.sum())} values are NaN or Inf, the first at {_first(odd)}"
    minus_zero = (values == 0) & np.signbit(values)
    if minus_zero.any():
        return f"{int(minus_zero.sum())} values are -0.0, the first at {_first(minus_zero)}"
    return None


def _first(where: NDArray[np.bool_]) -> str:
    place = np.unravel_index(int(np.argmax(where)), where.shape)
    return "(" + ", ".join(str(int(index)) for index in place) + ")"
