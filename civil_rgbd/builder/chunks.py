"""The unit of work: make the frames of one chunk, and leave a record that survives a kill."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from civil_rgbd.builder.originals import Fingerprint
from civil_rgbd.builder.plan import Chunk, PlannedFrames
from civil_rgbd.builder.proof import files_unlike
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.format.atomic import sync_files, whole_file
from civil_rgbd.format.writer import row_paths, write_frame
from civil_rgbd.pipeline.frames import FrameMaker, FrameOutcome
from civil_rgbd.pipeline.prepare import PointCounts
from civil_rgbd.storage.client import Version
from civil_rgbd.storage.noted_path import noted
from civil_rgbd.storage.places import Place, entries_of

BRIDGE = "bridge"
"""Inside the partial folder: what becomes the bridge folder."""

DONE = "done"
"""Inside the partial folder: one record for each finished chunk."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What every chunk of a build has in common; a worker gets it once.

    Attributes:
        recording: where points and images come from.
        recipe: how frames are made.
        frames: the plan's frames; chunks name them by index.
        partial: the folder of the unfinished build.
        durable: bring each chunk's files to the disk before its record: whoever publishes them may
            run on another machine, and cannot.
        files: what the recording is read from, so that another machine can compare.
    """

    recording: Recording
    recipe: Recipe
    frames: PlannedFrames
    partial: Place
    durable: bool = False
    files: tuple[Fingerprint, ...] = ()


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """What became of one planned frame, without its pixels.

    Attributes:
        source_index: which image.
        row: its row in ``frames.parquet``; None when it was dropped.
        dropped: why; None when it was kept.
        points: in its window.
        points_in_view: of those, in the image.
        span_ns: from the window's earliest point to its latest.
        nearest_ns: from the image to the window's nearest point in time.
        pixels_removed: emptied because something stands before what they show.
    """

    source_index: int
    row: FrameRow | None
    dropped: str | None
    points: int
    points_in_view: int
    span_ns: int
    nearest_ns: int
    pixels_removed: int = 0


@dataclass(frozen=True, slots=True)
class ChunkRecord:
    """What became of a chunk.

    Attributes:
        frames: in order.
        point_counts: what became of the points of each scan that was read, by scan.
        versions: of the frames' objects as they were uploaded, by path; {} for files on a disk.
    """

    frames: tuple[FrameRecord, ...]
    point_counts: dict[int, PointCounts]
    versions: Mapping[str, Version] = field(default_factory=dict)

    @property
    def rows(self) -> list[FrameRow]:
        """The rows of the frames that were kept."""
        return [frame.row for frame in self.frames if frame.row is not None]


def run_chunk(
    job: Job, chunk: Chunk, maker: FrameMaker, *, on_frame: Callable[[], object]
) -> ChunkRecord:
    """Make the frames of one chunk and write them; the record comes last.

    Args:
        job: what the chunks share.
        chunk: which frames.
        maker: of the job's recording and recipe; it may have made other chunks before.
        on_frame: called after each frame.

    Returns:
        what became of them.
    """
    planned = job.frames[chunk.first : chunk.stop]
    maker.forget_counts()
    folder, versions = noted(job.partial / BRIDGE)
    frames = []
    for outcome in maker.make(planned):
        frames.append(_record(job, outcome, folder))
        on_frame()
    record = ChunkRecord(tuple(frames), point_counts=maker.point_counts, versions=versions)
    if job.durable:
        sync_files(folder, [path for row in record.rows for path in row_paths(row)])
    name = f"{planned[0].source_index:06d}-{planned[-1].source_index:06d}.json"
    with whole_file(job.partial / DONE / name) as scratch:
        scratch.write_text(json.dumps(_to_document(record)), encoding="utf-8")
    return record


def _record(job: Job, outcome: FrameOutcome, folder: Place) -> FrameRecord:
    row = None
    if outcome.frame is not None:
        row = write_frame(folder, outcome.frame, stage=job.recipe.image)
    return FrameRecord(
        source_index=outcome.source_index,
        row=row,
        dropped=outcome.dropped,
        points=outcome.points,
        points_in_view=outcome.points_in_view,
        span_ns=outcome.span_ns,
        nearest_ns=outcome.nearest_ns,
        pixels_removed=outcome.pixels_removed,
    )


def finished_chunks(partial: Place, within: tuple[int, int] | None = None) -> list[ChunkRecord]:
    """Read the records of a build that was stopped; chunks with a damaged file count as not done.

    Args:
        partial: the folder of the unfinished build.
        within: first and last source index to look at; others may be at work on the rest.

    Returns:
        the chunks whose files are all there with the right bytes.
    """
    read = {
        path: _read_record(path)
        for path in entries_of(partial / DONE)
        if path.suffix == ".json" and (within is None or _touches(path.stem, within))
    }
    found = [record for record in read.values() if record is not None]
    rows = [row for record in found for row in record.rows]
    versions = {path: version for record in found for path, version in record.versions.items()}
    damaged = files_unlike(partial / BRIDGE, rows, versions)
    records = []
    for path, record in read.items():
        files = {file for row in record.rows for file in row_paths(row)} if record else set()
        if record and not files & damaged:
            records.append(record)
        else:
            # The chunk is made again, perhaps cut otherwise: this record must not come back.
            path.unlink(missing_ok=True)
    return records


def _touches(name: str, within: tuple[int, int]) -> bool:
    """Tell whether a record's frames, as its name says them, lie among some frames."""
    first, _, last = name.partition("-")
    return first.isdigit() and last.isdigit() and within[0] <= int(last) and int(first) <= within[1]


def _read_record(path: Place) -> ChunkRecord | None:
    try:
        return _from_document(json.loads(path.read_text("utf-8")))
    except (OSError, ValueError, KeyError, TypeError):
        return None  # a power cut may leave an empty record


def _to_document(record: ChunkRecord) -> dict[str, object]:
    return {
        "frames": [dataclasses.asdict(frame) for frame in record.frames],
        "point_counts": {
            scan: dataclasses.asdict(counts) for scan, counts in record.point_counts.items()
        },
        "versions": dict(record.versions),
    }


def _from_document(document: dict[str, object]) -> ChunkRecord:
    frames, counts = document["frames"], document["point_counts"]
    versions = document.get("versions", {})
    if not (isinstance(frames, list) and isinstance(counts, dict) and isinstance(versions, dict)):
        raise TypeError("the record does not hold frames, point counts and versions")
    return ChunkRecord(
        frames=tuple(
            FrameRecord(**(frame | {"row": FrameRow(**frame["row"]) if frame["row"] else None}))
            for frame in frames
        ),
        point_counts={int(scan): PointCounts(**count) for scan, count in counts.items()},
        versions={path: (size_bytes, etag) for path, (size_bytes, etag) in versions.items()},
    )
