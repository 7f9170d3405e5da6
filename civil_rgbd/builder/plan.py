"""What a build will do, known before it starts: which images become frames, in which chunks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.transforms import compose
from civil_rgbd.pipeline.frames import PlannedFrame
from civil_rgbd.pipeline.select import far_enough

CHUNK_FRAMES = 64
"""Most frames in a chunk: some seconds of work, beside which the warm-up of a window is small."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedFrames(Sequence[PlannedFrame]):
    """Planned images, ascending, in arrays: those of hours take little, a run of them nothing.

    Attributes:
        source_indices: (F,) int64, places in the recording.
        stamps_ns: (F,) int64, corrected stamps, LiDAR clock.
        source_stamps_ns: (F,) int64, original stamps, camera clock.
        T_map_camera: (F, 4, 4) float64.
    """

    source_indices: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    source_stamps_ns: NDArray[np.int64]
    T_map_camera: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.source_indices)

    @overload
    def __getitem__(self, place: int) -> PlannedFrame: ...
    @overload
    def __getitem__(self, place: slice) -> PlannedFrames: ...
    def __getitem__(self, place: int | slice) -> PlannedFrame | PlannedFrames:
        """Return one frame, or a view of a run of them."""
        if isinstance(place, slice):
            return PlannedFrames(
                self.source_indices[place],
                self.stamps_ns[place],
                self.source_stamps_ns[place],
                self.T_map_camera[place],
            )
        return PlannedFrame(
            source_index=int(self.source_indices[place]),
            stamp_ns=int(self.stamps_ns[place]),
            source_stamp_ns=int(self.source_stamps_ns[place]),
            T_map_camera=self.T_map_camera[place],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Which images become frames.

    Attributes:
        frames: the images that passed the gate, ascending.
        images_seen: images in the recording.
        dropped: images that did not pass, by reason.
    """

    frames: PlannedFrames
    images_seen: int
    dropped: dict[str, int]


@dataclass(frozen=True, slots=True)
class Chunk:
    """A run of planned frames that one worker makes.

    Attributes:
        number: counts from 0.
        first: index of its first frame in the plan.
        stop: index after its last.
    """

    number: int
    first: int
    stop: int


def plan_frames(recording: Recording, recipe: Recipe) -> Plan:
    """Choose the images that become frames, by their stamps and poses alone.

    Args:
        recording: its image stamps, time offset, trajectory and extrinsics are used.
        recipe: its stages ``poses`` and ``select``.

    Returns:
        the plan; every image is in it, kept or counted.

    Raises:
        RecordingError: no image has a pose.
    """
    stamps_ns = recording.image_stamps_ns + recording.rig.camera_time_offset_ns
    dropped: dict[str, int] = {}
    posed = _with_a_pose(recording, recipe, stamps_ns, dropped)
    T_map_camera = compose(
        recording.trajectory.transforms_at(stamps_ns[posed]), recording.rig.T_body_camera
    )
    kept = far_enough(T_map_camera[:, :3, 3], min_displacement_m=recipe.select.min_displacement_m)
    if len(kept) < len(posed):
        dropped["image-too-near-previous"] = len(posed) - len(kept)
    chosen = posed[kept]
    frames = PlannedFrames(
        source_indices=chosen.astype(np.int64),
        stamps_ns=stamps_ns[chosen],
        source_stamps_ns=recording.image_stamps_ns[chosen],
        T_map_camera=T_map_camera[kept],
    )
    return Plan(frames=frames, images_seen=len(stamps_ns), dropped=dropped)


def _with_a_pose(
    recording: Recording,
    recipe: Recipe,
    stamps_ns: NDArray[np.int64],
    dropped: dict[str, int],
) -> NDArray[np.intp]:
    """Return the indices of the images that have a pose; count the others in ``dropped``."""
    trajectory = recording.trajectory
    gap_ns = round(recipe.poses.max_gap_s * NS_PER_S)
    usable = np.ones(len(stamps_ns), dtype=np.bool_)
    for reason, keep in (
        (
            "image-outside-trajectory",
            (stamps_ns >= trajectory.start_ns) & (stamps_ns <= trajectory.end_ns),
        ),
        ("image-in-pose-gap", trajectory.covers(stamps_ns, max_gap_ns=gap_ns)),
        ("image-pose-quality-low", _well_posed(recording, recipe, stamps_ns)),
    ):
        _drop(usable, keep, dropped, reason)
    # Last, so that one stray stamp outside the trajectory does not cost the images after it.
    _drop(usable, _ascending(stamps_ns, among=usable), dropped, "image-stamp-not-ascending")
    if not usable.any():
        raise RecordingError(
            f"none of the {len(stamps_ns)} images has a pose: {in_words(dropped)}; there are "
            f"{len(trajectory.stamps_ns)} poses",
            where=recording.name,
            fix="check the camera's time offset, raise poses.max_gap_s, or lower poses.min_quality",
        )
    return np.flatnonzero(usable)


def _well_posed(
    recording: Recording, recipe: Recipe, stamps_ns: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell the images whose pose is good enough.

    Raises:
        RecordingError: the recipe asks for a quality, and nobody judged the poses.
    """
    if recipe.poses.min_quality <= 0:
        return np.ones(len(stamps_ns), dtype=np.bool_)
    if recording.trajectory.quality is None:
        raise RecordingError(
            f"poses.min_quality is {recipe.poses.min_quality:g}, but the poses have no quality",
            where=recording.name,
            fix="compute poses with `civil-rgbd poses`, which writes POSES.quality.csv beside them "
            "(keep the two files together), or set poses.min_quality = 0",
        )
    good: NDArray[np.bool_] = recording.trajectory.quality_at(stamps_ns) >= recipe.poses.min_quality
    return good


def _drop(
    usable: NDArray[np.bool_], keep: NDArray[np.bool_], dropped: dict[str, int], reason: str
) -> None:
    """Take images out of ``usable`` and count them; each for its first reason."""
    count = int((usable & ~keep).sum())
    if count:
        dropped[reason] = count
    usable &= keep


def _ascending(stamps_ns: NDArray[np.int64], *, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell the images whose stamp is later than that of every usable image before them."""
    ascending = np.ones(len(stamps_ns), dtype=np.bool_)
    stamps = stamps_ns[among]
    if len(stamps):
        ascending[np.flatnonzero(among)[1:]] = stamps[1:] > np.maximum.accumulate(stamps)[:-1]
    return ascending


def chunks_of(todo: list[int], *, workers: int) -> list[Chunk]:
    """Cut the frames that are still to be made into runs.

    Args:
        todo: indices into the plan's frames, ascending; finished frames are missing.
        workers: each should get some chunks, so that none waits long for another.

    Returns:
        chunks of neighbouring frames; what they hold does not change what is built.
    """
    # One worker waits for nobody; several share a short recording, two chunks each.
    share = len(todo) if workers == 1 else -(-len(todo) // (2 * workers))
    size = max(1, min(CHUNK_FRAMES, share))
    chunks: list[Chunk] = []
    first = 0
    for at in range(1, len(todo) + 1):
        run_ends = at == len(todo) or todo[at] != todo[at - 1] + 1
        if run_ends or at - first == size:
            chunks.append(Chunk(len(chunks), todo[first], todo[at - 1] + 1))
            first = at
    return chunks


def in_words(counts: Mapping[str, int]) -> str:
    """Say counts by reason in one line."""
    return ", ".join(f"{reason} {count}" for reason, count in counts.items()) or "none"
