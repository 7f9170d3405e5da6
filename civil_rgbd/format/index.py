"""``frames.parquet``: one row a frame."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.versions import FormatVersionWarning, parse_version
from civil_rgbd.storage.places import Place, is_remote

_TYPES: Final = {
    "source_index": pa.int64(),
    "stamp_ns": pa.int64(),
    "source_stamp_ns": pa.int64(),
    **dict.fromkeys(("tx", "ty", "tz", "qx", "qy", "qz", "qw"), pa.float64()),
    **dict.fromkeys(("valid_share", "depth_min_m", "depth_max_m"), pa.float32()),
}
_NULLABLE: Final = {"quality_path", "quality_file_sha256", "quality_pixel_sha256"}
_VERSION_KEY: Final = b"format_version"
_DAMAGE: Final = (pa.ArrowException, OSError, ValueError, KeyError, OverflowError, MemoryError)
"""What pyarrow raises on a damaged file; UnicodeDecodeError is a ValueError."""
_FIX: Final = "build the bridge again, or download it again; docs/format.md lists the columns"

SCHEMA: Final = pa.schema(
    [
        pa.field(column.name, _TYPES.get(column.name, pa.string()), column.name in _NULLABLE)
        for column in dataclasses.fields(FrameRow)
    ]
)
"""Names, types and order of the columns."""


def write_index(path: Place, rows: Sequence[FrameRow]) -> None:
    """Write ``frames.parquet``, whole or not at all; the same rows give the same bytes.

    Args:
        path: the file to make; its folder exists.
        rows: in the order of their ids.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = {name: [getattr(row, name) for row in rows] for name in SCHEMA.names}
    schema = SCHEMA.with_metadata({_VERSION_KEY: FORMAT_VERSION.encode()})
    table = pa.Table.from_pydict(columns, schema=schema)
    with whole_file(path) as scratch:
        pq.write_table(table, scratch, compression="zstd", write_page_checksum=True)


def read_index_table(path: Place) -> pa.Table:
    """Read ``frames.parquet`` as a table of exactly the columns of :data:`SCHEMA`.

    Raises:
        FormatError: the file is missing, damaged, or has other columns.
    """
    try:
        # One thread: a forked worker must not wait for a pool that only its parent has.
        source = pa.BufferReader(path.read_bytes()) if is_remote(path) else path
        with pq.ParquetFile(source, pre_buffer=False, page_checksum_verification=True) as stream:
            table = stream.read(use_threads=False)
        table.validate(full=True)
    except FileNotFoundError as error:
        raise FormatError("the file is missing", where=path, fix=_FIX) from error
    except _DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(
            f"this is not a whole Parquet file: {reason}", where=path, fix=_FIX
        ) from error
    return _checked(table, path)


def _checked(table: pa.Table, path: Place) -> pa.Table:
    names = table.schema.names
    twice = sorted({name for name in names if names.count(name) > 1})
    faults = [f"column {name!r} comes twice" for name in twice]
    faults += _unknown_columns(table, path)
    for field in SCHEMA if not twice else ():
        if field.name not in names:
            faults.append(f"column {field.name!r} is missing")
        elif table.schema.field(field.name).type != field.type:
            kind = table.schema.field(field.name).type
            faults.append(f"column {field.name!r} is {kind}, not {field.type}")
        elif not field.nullable and table[field.name].null_count:
            faults.append(f"column {field.name!r} has {table[field.name].null_count} nulls")
    if faults:
        raise FormatError(f"the frame index has faults: {'; '.join(faults)}", where=path, fix=_FIX)
    return table.select(SCHEMA.names)


def _unknown_columns(table: pa.Table, path: Place) -> list[str]:
    """The columns that are faults; those of a newer minor are only warned of."""
    metadata = table.schema.metadata or {}
    text = metadata.get(_VERSION_KEY, b"").decode("ascii", "replace")
    theirs, ours = parse_version(text, where=path), parse_version(FORMAT_VERSION, where=path)
    if theirs[0] > ours[0]:
        raise FormatError(
            f"format version {text} is newer than {FORMAT_VERSION}, the newest that this "
            "release reads",
            where=path,
            fix="install a newer civil-rgbd: `pip install --upgrade civil-rgbd`",
        )
    unknown = sorted(set(table.schema.names) - set(SCHEMA.names))
    if unknown and theirs > ours:
        warnings.warn(
            f"{path} follows format {text}, newer than {FORMAT_VERSION}: "
            f"ignored {', '.join(unknown)}",
            FormatVersionWarning,
            stacklevel=2,
        )
        return []
    return [f"column {name!r} is unknown" for name in unknown]


def read_index(path: Place) -> tuple[FrameRow, ...]:
    """Read ``frames.parquet``.

    Returns:
        one row a frame, in the file's order.

    Raises:
        FormatError: the file is missing, damaged, or has other columns.
    """
    return rows_from_table(read_index_table(path))


def rows_from_table(table: pa.Table) -> tuple[FrameRow, ...]:
    """Turn a table of the columns of :data:`SCHEMA` into rows."""
    columns = [table[name].to_pylist() for name in SCHEMA.names]
    return tuple(FrameRow(*values) for values in zip(*columns, strict=True))
