"""Damaged files give a clear error or a recording, never anything else."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from civil_rgbd.conversion.mcap import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError

from . import scene

TINY = Path(__file__).parents[1] / "data" / "recordings" / "tiny.mcap"
ROUNDS = 80


def try_everything(path: Path, *, salvage: bool) -> bool:
    """Open and read all of it; tell whether it could be opened. Other errors fail the test."""
    try:
        recording = open_recording(path, RecordingOptions(salvage=salvage))
    except CivilRgbdError:
        return False
    for index in range(len(recording.scan_stamps_ns)):
        with suppress(CivilRgbdError):
            recording.read_scan(index)
    for index in range(len(recording.image_stamps_ns)):
        with suppress(CivilRgbdError):
            recording.read_image(index)
    return True


@pytest.mark.parametrize("salvage", [False, True])
def test_any_cut(tmp_path: Path, salvage: bool) -> None:
    data = TINY.read_bytes()
    path = tmp_path / "cut.mcap"
    rng = np.random.default_rng(2)
    opened = 0
    last_chunk, _ = scene.chunk_places(data)[-1]  # a cut after it loses nothing
    for length in rng.integers(0, last_chunk, ROUNDS).tolist():
        path.write_bytes(data[:length])
        opened += try_everything(path, salvage=salvage)
    assert (opened > ROUNDS // 4) if salvage else opened == 0


@pytest.mark.parametrize("salvage", [False, True])
@pytest.mark.parametrize("chunked", [False, True])
def test_any_flipped_bytes(tmp_path: Path, salvage: bool, chunked: bool) -> None:
    # Without checksums, so that the damage reaches the messages themselves.
    path = scene.write(
        tmp_path / "flip.mcap",
        scene.whole(),
        compression=CompressionType.NONE,
        chunked=chunked,
        crcs=False,
    )
    data = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(ROUNDS):
        damaged = bytearray(data)
        for at in rng.integers(8, len(data), rng.integers(1, 20)).tolist():
            damaged[at] = int(rng.integers(256))
        path.write_bytes(damaged)
        try_everything(path, salvage=salvage)


def test_any_flipped_bytes_in_compressed_chunks(tmp_path: Path) -> None:
    data = TINY.read_bytes()
    path = tmp_path / "flip.mcap"
    rng = np.random.default_rng(4)
    for _ in range(ROUNDS):
        damaged = bytearray(data)
        for at in rng.integers(8, len(data), 3).tolist():
            damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try_everything(path, salvage=True)
