"""``frames.parquet``, row by row."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.index import SCHEMA, read_index, read_index_table, write_index


def rows(count: int) -> list[FrameRow]:
    """Rows whose floats are exact in their columns."""
    digest = "ab" * 32
    return [
        FrameRow(
            frame_id=f"{2 * n:06d}",
            source_index=2 * n,
            stamp_ns=(1 << 60) + n,
            source_stamp_ns=(1 << 60) - n,
            rgb_path=f"rgb/{2 * n:06d}.jpg",
            depth_path=f"depth/{2 * n:06d}.exr",
            quality_path=None if n % 2 else f"quality/{2 * n:06d}.exr",
            tx=540000.1 + n,
            ty=math.pi * n,
            tz=-1e-17,
            qx=0.0,
            qy=0.6,
            qz=0.0,
            qw=0.8,
            valid_share=0.375,
            depth_min_m=0.5,
            depth_max_m=93.125,
            rgb_file_sha256=digest,
            rgb_pixel_sha256=digest,
            depth_file_sha256=digest,
            depth_pixel_sha256=digest,
            quality_file_sha256=None if n % 2 else digest,
            quality_pixel_sha256=None if n % 2 else digest,
        )
        for n in range(count)
    ]


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_rows_come_back_as_they_were(tmp_path: Path, count: int) -> None:
    write_index(tmp_path / "frames.parquet", rows(count))

    assert read_index(tmp_path / "frames.parquet") == tuple(rows(count))
    assert read_index_table(tmp_path / "frames.parquet").num_rows == count


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_index(tmp_path / name, rows(100))

    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_file_is_what_the_format_says(tmp_path: Path) -> None:
    write_index(tmp_path / "a", rows(3))

    stream = pq.ParquetFile(tmp_path / "a")
    group = stream.metadata.row_group(0)
    assert {group.column(n).compression for n in range(group.num_columns)} == {"ZSTD"}
    assert stream.schema_arrow.metadata[b"format_version"] == b"1.0"
    assert stream.schema_arrow.names == [f.name for f in dataclasses.fields(FrameRow)]


def test_another_order_of_columns_is_read(tmp_path: Path) -> None:
    write_index(tmp_path / "a", rows(3))
    table = pq.ParquetFile(tmp_path / "a").read()
    pq.write_table(table.select(table.schema.names[::-1]), tmp_path / "b")

    assert read_index(tmp_path / "b") == tuple(rows(3))


def test_other_columns_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a"
    write_index(path, rows(2))
    table = pq.ParquetFile(path).read()
    stamp = table.schema.get_field_index("stamp_ns")
    floats = table["stamp_ns"].cast(pa.float64(), safe=False)
    gaps = pa.array([None, 1.0])
    at = table.schema.get_field_index("tx")
    cases = {
        "column 'qw' is missing": table.drop_columns(["qw"]),
        "column 'stamp_ns' is double, not int64": table.set_column(stamp, "stamp_ns", floats),
        "column 'tx' has 1 nulls": table.set_column(at, "tx", gaps),
        "column 'tx' comes twice": table.append_column("tx", table["tx"]),
        "format_version is ''": table.replace_schema_metadata(None),
    }

    for words, changed in cases.items():
        pq.write_table(changed, path)
        with pytest.raises(FormatError, match=words.replace("'", ".")) as caught:
            read_index(path)
        assert caught.value.where == str(path)


def test_a_file_cut_or_not_parquet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "frames.parquet"
    write_index(path, rows(5))
    data = path.read_bytes()

    for length in [*range(0, len(data), 97), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(FormatError, match="not a whole Parquet file") as caught:
            read_index(path)
        assert caught.value.where == str(path)
    with pytest.raises(FormatError, match="the file is missing"):
        read_index(tmp_path / "nothing")


def test_a_flipped_byte_is_noticed_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "frames.parquet"
    write_index(path, rows(5))
    data = path.read_bytes()

    for place in range(0, len(data) // 2, 7):  # the pages; the footer has no checksum
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x04]) + data[place + 1 :])
        assert rows_or_refusal(path) in (tuple(rows(5)), None), place


def rows_or_refusal(path: Path) -> tuple[FrameRow, ...] | None:
    try:
        return read_index(path)
    except FormatError:
        return None


def test_the_columns_are_in_the_order_of_the_row() -> None:
    assert SCHEMA.names == [field.name for field in dataclasses.fields(FrameRow)]
