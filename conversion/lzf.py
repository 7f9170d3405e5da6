"""LZF, the compression inside PCD files: literals, and copies of what came before.

Layout (liblzf's lzf_d.c): a byte below 32 is followed by that many literals and one more; any
other holds a length in its upper three bits (7 = more follows) and a distance in the rest and the
next byte.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.point_table import LayoutError

_MOST_EXPANSION = 88  # three bytes stand for at most 264


@numba.njit(cache=True)
def _decompress(source, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  # a kernel: numba infers
    """Fill ``out`` from ``source``, both (N,) uint8; return how much was written, -1 if broken."""
    i, o = 0, 0
    while i < len(source):
        control = int(source[i])
        i += 1
        if control < 32:
            n = control + 1
            if i + n > len(source) or o + n > len(out):
                return -1
            for k in range(n):
                out[o + k] = source[i + k]
            i += n
        else:
            n = (control >> 5) + 2
            if n == 9:
                if i >= len(source):
                    return -1
                n += int(source[i])
                i += 1
            if i >= len(source):
                return -1
            start = o - ((control & 31) << 8) - int(source[i]) - 1
            i += 1
            if start < 0 or o + n > len(out):
                return -1
            for k in range(n):  # one by one: a copy may overlap itself
                out[o + k] = out[start + k]
        o += n
    return o


def decompress_lzf(source: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Decompress.

    Args:
        source: (N,) compressed bytes.
        size: how many bytes come out, as the file claims.

    Returns:
        (size,) uint8.

    Raises:
        LayoutError: the data is broken, or gives another number of bytes.
    """
    if size > _MOST_EXPANSION * len(source):
        raise LayoutError(f"{len(source)} compressed bytes cannot hold {size}")
    out = np.empty(size, dtype=np.uint8)
    written = int(_decompress(source, out))
    if written != size:
        found = "broken data" if written < 0 else f"{written} bytes"
        raise LayoutError(f"its compressed data should give {size} bytes and gives {found}")
    return out
