"""The datasets: frames, and windows of neighbouring frames."""

from __future__ import annotations

import itertools
import operator
import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Dataset

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.dataset.index import FrameIndex, read_index
from civil_rgbd.dataset.samples import read_sample, read_window, stop_decoder_threads
from civil_rgbd.dataset.splits import FrameChoice
from civil_rgbd.dataset.transforms import Transform
from civil_rgbd.errors import UsageError
from civil_rgbd.storage.places import place_of


class BridgeDataset(Dataset[dict[str, Any]]):
    """Frames of one or more bridges, as tensors.

    A sample is a dictionary:

    - ``image`` (3, H, W) uint8, red first
    - ``depth`` (1, H, W) float32, metres along the optical axis, 0 = nothing measured
    - ``valid`` (1, H, W) bool, where depth was measured
    - ``intrinsics`` (3, 3) float32; pixel (0, 0) is a pixel's centre
    - ``T_map_camera`` (4, 4) float64, takes points of the camera's optical frame to the map
    - ``bridge`` str, ``frame`` str, ``stamp_ns`` int
    - on request ``quality``, a dictionary of (1, H, W) float32 by :attr:`quality_planes`

    Samples collate by default. Images of one bridge have one size; bridges may differ, and a batch
    that mixes sizes needs a ``transform`` that makes them equal. Frames come in the order of bridge
    ids, and of a bridge in the order of stamps, however they were asked for. Nothing is kept open,
    so workers share nothing: fork and spawn both do.

    Args:
        location: a dataset folder or one bridge folder; may be a URL such as ``s3://sets/all``.
        bridges: id or ids of bridges; None for all.
        split: name of a split in ``dataset.json``; None for all frames.
        frames: frame ids, in any of the bridges, or frame ids by bridge; None for all.
        transform: a function of the sample, applied last; it is sent to workers.
        quality: give the quality planes too, those that every chosen bridge has.

    Raises:
        UsageError: a bridge, split or frame is not there, or no frame is left; or quality planes
            are asked for, and the bridges have none in common.
        FormatError: a document in the folder breaks the format.
    """

    def __init__(
        self,
        location: str | os.PathLike[str],
        *,
        bridges: str | Iterable[str] | None = None,
        split: str | None = None,
        frames: FrameChoice | None = None,
        transform: Transform | None = None,
        quality: bool = False,
    ) -> None:
        stop_decoder_threads()
        self._index = read_index(place_of(location), bridges=bridges, split=split, frames=frames)
        self._transform = transform
        self._quality = quality
        _require_planes(self._index, location, asked=quality)

    @property
    def quality_planes(self) -> tuple[str, ...]:
        """Names of the quality planes that every bridge here has, in order."""
        return self._index.quality_planes

    @property
    def bridges(self) -> tuple[str, ...]:
        """Ids of the bridges that have a frame here."""
        return self._index.bridges

    @property
    def sizes_px(self) -> dict[str, tuple[int, int]]:
        """Height and width of the images of each bridge."""
        sizes = zip(self._index.bridges, self._index.sizes_px.tolist(), strict=True)
        return {bridge: (height, width) for bridge, (height, width) in sizes}

    def __len__(self) -> int:
        """Count the frames."""
        return len(self._index)

    def __getitem__(self, place: int) -> dict[str, Any]:
        """Decode one frame.

        Raises:
            IndexError: there are fewer frames.
            FormatError: one of its files is missing or damaged.
        """
        sample = read_sample(self._index, _place_in(len(self), place), quality=self._quality)
        return sample if self._transform is None else self._transform(sample)


class BridgeSequenceDataset(Dataset[dict[str, Any]]):
    """Windows of neighbouring frames of one bridge, as tensors.

    A sample is that of :class:`BridgeDataset` with a first axis of T = ``length``: ``image``
    (T, 3, H, W), ``depth`` and ``valid`` (T, 1, H, W), ``intrinsics`` (T, 3, 3), ``T_map_camera``
    (T, 4, 4), ``stamp_ns`` (T,) int64; ``frame`` is a list of T str, ``bridge`` one str.

    Neighbours follow each other in their bridge folder. A window reaches neither over the end of a
    bridge, nor over a frame that the choice leaves out, nor over a pause longer than ``max_gap_s``.

    Args:
        location: a dataset folder or one bridge folder; may be a URL such as ``s3://sets/all``.
        length: frames in a window.
        stride: frames from the start of a window to the start of the next.
        max_gap_s: the longest time between two neighbours; None for no limit.
        bridges: id or ids of bridges; None for all.
        split: name of a split in ``dataset.json``; None for all frames.
        frames: frame ids, in any of the bridges, or frame ids by bridge; None for all.
        transform: a function of the window, applied last; it is sent to workers.
        quality: give the quality planes too: ``quality``, (T, 1, H, W) each.

    Raises:
        UsageError: as :class:`BridgeDataset`; or no window fits.
        FormatError: a document in the folder breaks the format.
    """

    def __init__(
        self,
        location: str | os.PathLike[str],
        *,
        length: int = 2,
        stride: int = 1,
        max_gap_s: float | None = None,
        bridges: str | Iterable[str] | None = None,
        split: str | None = None,
        frames: FrameChoice | None = None,
        transform: Transform | None = None,
        quality: bool = False,
    ) -> None:
        if min(length, stride) < 1:
            raise UsageError(
                f"a window of {length} frames every {stride} frames does not exist",
                where=location,
                fix="give a length and a stride of at least 1",
            )
        stop_decoder_threads()
        self._index = read_index(place_of(location), bridges=bridges, split=split, frames=frames)
        self._length = length
        self._transform = transform
        self._quality = quality
        _require_planes(self._index, location, asked=quality)
        runs = _unbroken_runs(self._index, max_gap_s=max_gap_s)
        self._starts = np.concatenate(
            [np.arange(first, end - length + 1, stride, dtype=np.int64) for first, end in runs]
        )
        if not len(self._starts):
            longest = max(end - first for first, end in runs)
            raise UsageError(
                f"no window of {length} neighbouring frames fits: "
                f"the longest unbroken run has {longest} of the {len(self._index)} frames",
                where=location,
                fix="ask for shorter windows, a larger max_gap_s, or more frames",
            )

    @property
    def bridges(self) -> tuple[str, ...]:
        """Ids of the bridges that have a chosen frame; not each need have a window."""
        return self._index.bridges

    def __len__(self) -> int:
        """Count the windows."""
        return len(self._starts)

    def __getitem__(self, place: int) -> dict[str, Any]:
        """Decode one window.

        Raises:
            IndexError: there are fewer windows.
            FormatError: one of its files is missing or damaged.
        """
        start = int(self._starts[_place_in(len(self), place)])
        places = range(start, start + self._length)
        window = read_window(self._index, places, quality=self._quality)
        return window if self._transform is None else self._transform(window)


def _require_planes(index: FrameIndex, location: object, *, asked: bool) -> None:
    if asked and not index.quality_planes:
        raise UsageError(
            f"the bridges {', '.join(index.bridges)} have no quality plane in common",
            where=location,
            fix="build them by a recipe with a table [quality], or choose bridges that have some",
        )


def _unbroken_runs(index: FrameIndex, *, max_gap_s: float | None) -> list[tuple[int, int]]:
    """Return (first, end) of the longest stretches in which each frame neighbours the next."""
    joined: NDArray[np.bool_] = (np.diff(index.bridge_numbers) == 0) & (np.diff(index.rows) == 1)
    if max_gap_s is not None:
        joined &= np.diff(index.stamps_ns) <= max_gap_s * NS_PER_S
    breaks = np.flatnonzero(~joined) + 1
    edges = [0, *breaks.tolist(), len(index)]
    return list(itertools.pairwise(edges))


def _place_in(count: int, place: int) -> int:
    number = operator.index(place)
    if not -count <= number < count:
        raise IndexError(f"place {number} of a dataset of {count}")
    return number % count
