"""A bridge folder, from frames to publishing."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.recipe import ImageStage
from civil_rgbd.errors import FormatError, OutputError
from civil_rgbd.format.hashes import pixel_sha256
from civil_rgbd.format.images import read_image
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.format.writer import depth_statistics, finish_bridge, write_frame

from ..data.format_v1 import make


def write(partial: Path) -> list[FrameRow]:
    frames = [make.frame(index) for index in make.SOURCE_INDICES]
    return [write_frame(partial, frame, stage=make.RECIPE.image) for frame in frames]


def finish(partial: Path, bridge: Path, rows: list[FrameRow], *, replace: bool = False) -> None:
    finish_bridge(
        partial,
        bridge,
        manifest=make.manifest(0.25),
        camera=make.CAMERA,
        rows=rows,
        replace=replace,
    )


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_row_describes_the_frame(tmp_path: Path) -> None:
    frame = make.frame(7)

    row = write_frame(tmp_path, frame, stage=make.RECIPE.image)

    assert (row.frame_id, row.source_index) == ("000007", 7)
    assert (row.rgb_path, row.depth_path) == ("rgb/000007.jpg", "depth/000007.exr")
    assert row.stamp_ns - row.source_stamp_ns == 15_625_000
    assert (row.tx, row.ty, row.tz) == (540007.5, 4810000.25, 331.125)
    assert row.qw >= 0
    valid = frame.depth_m[frame.depth_m > 0]
    assert row.valid_share == np.float32(valid.size / frame.depth_m.size)
    assert (row.depth_min_m, row.depth_max_m) == (valid.min(), valid.max())


def test_hashes_are_of_files_and_of_what_a_reader_sees(tmp_path: Path) -> None:
    frame = make.frame(7)

    row = write_frame(tmp_path, frame, stage=make.RECIPE.image)

    files = {path: hashlib.sha256(data).hexdigest() for path, data in contents(tmp_path).items()}
    assert files == {"rgb/000007.jpg": row.rgb_file_sha256, row.depth_path: row.depth_file_sha256}
    assert row.rgb_pixel_sha256 == pixel_sha256(read_image(tmp_path / row.rgb_path))
    assert row.depth_pixel_sha256 == pixel_sha256(frame.depth_m)


def test_png_keeps_every_pixel(tmp_path: Path) -> None:
    frame = make.frame(7)

    row = write_frame(tmp_path, frame, stage=ImageStage(codec="png"))

    assert row.rgb_path == "rgb/000007.png"
    assert np.array_equal(read_image(tmp_path / row.rgb_path), frame.rgb)
    assert row.rgb_pixel_sha256 == pixel_sha256(frame.rgb)


def test_depth_without_a_measurement_has_zeros() -> None:
    assert depth_statistics(np.zeros((3, 4), dtype=np.float32)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_the_least_depth_is_that_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth_m = (rng.random((20, 30)) * 10.0 ** rng.integers(-30, 30)).astype(np.float32)
    depth_m[rng.random((20, 30)) < 0.7] = 0

    share, least_m, most_m = depth_statistics(depth_m[:, ::2])

    valid = depth_m[:, ::2][depth_m[:, ::2] > 0]
    assert (share, least_m, most_m) == (np.float32(valid.size / 300), valid.min(), valid.max())


def test_a_finished_bridge_can_be_read(tmp_path: Path) -> None:
    rows = write(tmp_path / "p")

    finish(tmp_path / "p", tmp_path / "bridges" / "B1", rows)

    bridge = read_bridge(tmp_path / "bridges" / "B1")
    assert bridge.rows == tuple(rows)
    assert bridge.camera == make.CAMERA
    for row, index in zip(rows, make.SOURCE_INDICES, strict=True):
        assert np.array_equal(bridge.read_depth(row), make.frame(index).depth_m)
        assert np.abs(bridge.read_rgb(row).astype(int) - make.frame(index).rgb).max() <= 6


def test_rows_in_any_order_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        rows = write(tmp_path / "p")
        finish(tmp_path / "p", tmp_path / name, rows[::-1] if name == "b" else rows)

    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert len(contents(tmp_path / "a")) == 4 + 2 * 3


def test_a_bridge_holds_nothing_else(tmp_path: Path) -> None:
    rows = write(tmp_path / "p")
    for stray in ("rgb/000099.jpg", "state/chunk.json", "manifest.json", "rgb/deep/x", ".lock"):
        (tmp_path / "p" / stray).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "p" / stray).write_text("stray")

    finish(tmp_path / "p", tmp_path / "B1", rows)

    names = {row.rgb_path for row in rows} | {row.depth_path for row in rows}
    documents = {"manifest.json", "intrinsics.json", "poses.json", "frames.parquet"}
    assert contents(tmp_path / "B1").keys() == names | documents
    assert not (tmp_path / "B1" / "state").exists()


def test_a_lost_file_stops_the_publishing(tmp_path: Path) -> None:
    rows = write(tmp_path / "p")
    (tmp_path / "p" / "depth" / "000007.exr").unlink()

    with pytest.raises(OutputError, match="1 files of the bridge are missing, the first is depth"):
        finish(tmp_path / "p", tmp_path / "B1", rows)
    assert not (tmp_path / "B1").exists()


def test_rows_and_counts_must_agree(tmp_path: Path) -> None:
    rows = write(tmp_path / "p")

    with pytest.raises(ValueError, match="counts 3 frames, there are 2"):
        finish(tmp_path / "p", tmp_path / "B1", rows[:2])
    with pytest.raises(ValueError, match="the same frame id"):
        finish(tmp_path / "p", tmp_path / "B1", [*rows[:2], rows[0]])


def test_a_damaged_partial_folder_never_looks_whole(tmp_path: Path) -> None:
    rows = write(tmp_path / "p")
    manifest = dataclasses.replace(make.manifest(0.25), data_version="")

    with pytest.raises(FormatError, match=r"\$\.data_version"):
        finish_bridge(
            tmp_path / "p",
            tmp_path / "B1",
            manifest=manifest,
            camera=make.CAMERA,
            rows=rows,
            replace=False,
        )
    assert not (tmp_path / "B1").exists()
    assert not (tmp_path / "p" / "manifest.json").exists()


def test_depth_that_cannot_be_stored_is_refused(tmp_path: Path) -> None:
    frame = make.frame(0)
    frame.depth_m[2, 3] = np.nan

    with pytest.raises(ValueError, match="NaN or Inf"):
        write_frame(tmp_path, frame, stage=make.RECIPE.image)
    assert not list((tmp_path / "depth").iterdir())
