"""What stays in memory after a recording was read."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator

from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import ImageDecodeError
from civil_rgbd.validation.recording_reads import Sample


def kept_bytes(recording: Recording, sample: Sample, spare_bytes: int) -> Iterator[str]:
    """Yield a message when reading leaves more behind than a few messages.

    Args:
        recording: any.
        sample: what is read.
        spare_bytes: may stay, whatever was read: a converter keeps a few chunks.
    """
    was_tracing = tracemalloc.is_tracing()
    if not was_tracing:
        tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        read_bytes = _read_all(recording, sample)
        gc.collect()
        kept = tracemalloc.get_traced_memory()[0] - before
    finally:
        if not was_tracing:
            tracemalloc.stop()
    if kept > spare_bytes:
        yield f"{kept} bytes stay in memory after {read_bytes} bytes were read"


def _read_all(recording: Recording, sample: Sample) -> int:
    read_bytes = 0
    for number in sample.scans:
        read_bytes += recording.read_scan(number).points.nbytes
    for number in sample.images:
        try:
            read_bytes += recording.read_image(number).rgb.nbytes
        except ImageDecodeError:
            continue
    return read_bytes
