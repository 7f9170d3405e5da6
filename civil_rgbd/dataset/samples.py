"""From a row of the index to tensors."""

from __future__ import annotations

import os
from functools import cache
from typing import Any, Final

import cv2
import numpy as np
import OpenEXR
import torch
from numpy.typing import NDArray
from torch.utils.data import get_worker_info

from civil_rgbd.constants import NO_DEPTH_M
from civil_rgbd.dataset.index import FrameIndex
from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.images import read_image
from civil_rgbd.format.quality_exr import read_quality

TENSORS: Final = ("image", "depth", "valid", "intrinsics", "T_map_camera")
"""Keys of a sample whose values are tensors."""


def read_sample(index: FrameIndex, place: int, *, quality: bool = False) -> dict[str, Any]:
    """Decode one frame.

    Args:
        index: the frames.
        place: which of them, 0 <= place < len(index).
        quality: decode its quality planes as well.

    Returns:
        ``image`` (3, H, W) uint8, ``depth`` (1, H, W) float32 metres, ``valid`` (1, H, W) bool,
        ``intrinsics`` (3, 3) float32, ``T_map_camera`` (4, 4) float64, ``bridge`` str, ``frame``
        str, ``stamp_ns`` int; with ``quality`` also ``quality``, a dictionary of (1, H, W) float32
        by the names of ``index.quality_planes``. Writing to a tensor changes no other sample.

    Raises:
        FormatError: a file is missing, damaged, or of another size than its camera.
    """
    _keep_to_one_thread(os.getpid(), is_worker=get_worker_info() is not None)
    bridge = int(index.bridge_numbers[place])
    folder, (height, width) = index.folders[bridge], index.sizes_px[bridge].tolist()
    rgb_path = folder / index.rgb_paths[place].decode()
    rgb = read_image(rgb_path)
    if rgb.shape != (height, width, 3):
        raise FormatError(
            f"the image is {rgb.shape[1]} x {rgb.shape[0]} px; the camera has {width} x {height}",
            where=rgb_path,
            fix="build the bridge again, or download it again",
        )
    image = torch.from_numpy(_channels_first(rgb))  # now, while the pixels are in the cache
    depth_m = read_depth(folder / index.depth_paths[place].decode(), size=(height, width))
    sample = {
        "image": image,
        "depth": torch.from_numpy(np.require(depth_m, requirements=["C", "W"]))[None],
        "valid": torch.from_numpy(depth_m > NO_DEPTH_M)[None],
        "intrinsics": torch.from_numpy(index.intrinsics[bridge].copy()),
        "T_map_camera": torch.from_numpy(index.T_map_camera[place].copy()),
        "bridge": index.bridges[bridge],
        "frame": index.frame_ids[place].decode(),
        "stamp_ns": int(index.stamps_ns[place]),
    }
    if quality:
        planes = read_quality(folder / index.quality_paths[place].decode(), size=(height, width))
        sample["quality"] = {
            name: torch.from_numpy(planes[name].astype(np.float32))[None]
            for name in index.quality_planes
        }
    return sample


def read_window(index: FrameIndex, places: range, *, quality: bool = False) -> dict[str, Any]:
    """Decode neighbouring frames of one bridge.

    Args:
        index: the frames.
        places: T of them, of one bridge.
        quality: decode their quality planes as well.

    Returns:
        as :func:`read_sample`, each tensor with a first axis of T; ``bridge`` str, ``frame`` a list
        of T str, ``stamp_ns`` (T,) int64.

    Raises:
        FormatError: a file is missing, damaged, or of another size than its camera.
    """
    samples = [read_sample(index, place, quality=quality) for place in places]
    stacked: dict[str, Any] = {
        name: torch.stack([sample[name] for sample in samples]) for name in TENSORS
    }
    if quality:
        stacked["quality"] = {
            name: torch.stack([sample["quality"][name] for sample in samples])
            for name in index.quality_planes
        }
    return {
        **stacked,
        "bridge": samples[0]["bridge"],
        "frame": [sample["frame"] for sample in samples],
        "stamp_ns": torch.tensor([sample["stamp_ns"] for sample in samples], dtype=torch.int64),
    }


def stop_decoder_threads() -> None:
    """Stop OpenEXR's threads in this process, so that it can be forked.

    Threads do not survive a fork: a child that finds its parent's pool waits for it for ever.
    """
    OpenEXR.set_global_thread_count(0)


@cache
def _keep_to_one_thread(process: int, *, is_worker: bool) -> None:  # noqa: ARG001 - the cache's key
    """Tell the decoders, once in each process, to start no threads: the workers are many enough."""
    stop_decoder_threads()
    if is_worker:  # the main process belongs to the user, who may want OpenCV's threads
        # 0, not 1: with 1 a forked OpenCV waits for the end of the parent's threads, and hangs.
        cv2.setNumThreads(0)


def _channels_first(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    planes: NDArray[np.uint8] = np.empty((3, *rgb.shape[:2]), dtype=np.uint8)
    cv2.split(rgb, [planes[0], planes[1], planes[2]])  # four times as fast as numpy's transposition
    return planes
