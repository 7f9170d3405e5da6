"""Damaged files give a clear error or a recording, never anything else."""

from __future__ import annotations

import tracemalloc
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import CivilRgbdError

from . import containers, scene

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


@pytest.fixture(scope="module", params=["none", "lz4", "bz2", "unindexed", "db3", "db3-small"])
def other(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording in one of the other containers."""
    folder = tmp_path_factory.mktemp("other")
    messages = scene.flat(scene.whole())
    if request.param.startswith("db3"):
        how = "message" if request.param == "db3-small" else None
        return containers.write_folder(folder / "a", messages, compression=how) / "a.db3"
    compression = "none" if request.param == "unindexed" else request.param
    path = folder / "a.bag"
    path.write_bytes(
        containers.bag_by_hand(
            messages, compression=compression, index=request.param != "unindexed"
        )
    )
    return path


@pytest.mark.parametrize("salvage", [False, True])
def test_any_cut_of_other_containers(tmp_path: Path, other: Path, salvage: bool) -> None:
    data = other.read_bytes()
    path = tmp_path / other.name
    rng = np.random.default_rng(6)
    opened = 0
    for length in rng.integers(0, len(data) * 9 // 10, ROUNDS // 4).tolist():
        path.write_bytes(data[:length])
        opened += try_everything(path, salvage=salvage)
    assert (opened > 0) if salvage else opened < ROUNDS // 8  # an unindexed bag may end anywhere


@pytest.mark.parametrize("kind", ["bytes", "bits", "holes", "moved"])
def test_any_damage_of_other_containers(tmp_path: Path, other: Path, kind: str) -> None:
    data = other.read_bytes()
    path = tmp_path / other.name
    rng = np.random.default_rng(7)
    for _ in range(ROUNDS // 4):
        damaged = bytearray(data)
        for at in rng.integers(13, len(data), rng.integers(1, 12)).tolist():
            if kind == "bytes":
                damaged[at] = int(rng.integers(256))
            elif kind == "bits":
                damaged[at] ^= 1 << int(rng.integers(8))
            elif kind == "holes":
                damaged[at : at + 200] = bytes(len(damaged[at : at + 200]))
            else:
                del damaged[at : at + int(rng.integers(1, 40))]
        path.write_bytes(damaged)
        try_everything(path, salvage=bool(rng.integers(2)))


@pytest.mark.parametrize("claim", [0, 2**31, 2**32 - 1])
@pytest.mark.parametrize("field", [b"size=", b"compression=", b"conn=", b"op=", b"pos="])
@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_lengths_that_lie_cost_no_memory(
    tmp_path: Path, compression: str, field: bytes, claim: int
) -> None:
    data = containers.bag_by_hand(scene.flat(scene.whole()), compression=compression)
    at = data.find(field)
    path = tmp_path / "lying.bag"
    for place in (at - 4, at + len(field), data.rfind(field) - 4, data.rfind(field) + len(field)):
        damaged = bytearray(data)
        damaged[place : place + 4] = claim.to_bytes(4, "little")
        path.write_bytes(damaged)
        tracemalloc.start()
        try_everything(path, salvage=True)
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak_bytes < 2 * len(data) + 4_000_000
