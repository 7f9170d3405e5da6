"""KITTI's depth layout, with the file lists that BTS and ZoeDepth train on.

A bridge becomes a drive: ``ID/image_02/data/``, ``ID/proj_depth/groundtruth/image_02/`` (16-bit
PNG, metres x 256, 0 = none). A line of a list is ``image depth focal``, paths from the export's
folder: both programs join it to their ``data_path`` and ``gt_path`` (``bts_dataloader.py`` of
cleinc/bts, ``data_mono.py`` of isl-org/ZoeDepth). KITTI has no poses here; ours go to
``ID/poses.txt``.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.exporters.files import copy_image, numbers, write_depth_png, write_lines
from civil_rgbd.exporters.poses import transform_of
from civil_rgbd.exporters.report import ExportOptions, Losses
from civil_rgbd.exporters.selection import Chosen, rows_in

SCALE: Final = 256.0
"""Stored depth units a metre; the furthest is 255.99 m."""

_LARGEST_INPUT: Final = (352, 704)
"""Height and width of BTS' crops of KITTI; never larger than the images, multiples of 32."""

_BTS_STRIDE: Final = 32


def write(folder: Path, chosen: Sequence[Chosen], options: ExportOptions) -> Losses:
    """Write bridges as drives, and the lists of their frames.

    Returns:
        what is lost.

    Raises:
        FormatError: a frame is damaged.
    """
    losses = Losses(["quality planes, defects and the manifest's counts have no place"])
    lines: dict[tuple[str, str], str] = {}
    for one in chosen:
        for row in one.rows:
            lines[one.bridge_id, row.frame_id] = _write_frame(folder, one, row, losses)
            options.on_frame()
        _write_documents(folder / one.bridge_id, one)
    write_lines(folder / "all_files_with_gt.txt", lines.values())
    names = ["all"]
    for split, parts in options.splits.items():
        ids = [
            (one.bridge_id, row.frame_id)
            for one in chosen
            for row in rows_in(one.rows, parts.get(one.bridge_id, ()))
        ]
        if ids:
            write_lines(folder / f"{split}_files_with_gt.txt", [lines[key] for key in ids])
            names.append(split)
    write_lines(folder / "README.txt", _readme(chosen, names))
    return losses


def _write_frame(folder: Path, one: Chosen, row: FrameRow, losses: Losses) -> str:
    name = f"{row.source_index:010d}"  # as KITTI names frames
    drive = folder / one.bridge_id
    image = copy_image(one.bridge, row, drive / "image_02" / "data" / name)
    depth = drive / "proj_depth" / "groundtruth" / "image_02" / f"{name}.png"
    write_depth_png(one.bridge, row, depth, scale=SCALE, losses=losses)
    paths = (path.relative_to(folder).as_posix() for path in (image, depth))
    return f"{' '.join(paths)} {one.bridge.camera.fx_px:.4f}"


def _write_documents(drive: Path, one: Chosen) -> None:
    camera = one.bridge.camera
    P = (camera.fx_px, 0, camera.cx_px, 0, 0, camera.fy_px, camera.cy_px, 0, 0, 0, 1, 0)
    size = numbers(camera.width_px, camera.height_px)
    write_lines(drive / "calib_cam_to_cam.txt", [f"S_rect_02: {size}", f"P_rect_02: {numbers(*P)}"])
    write_lines(drive / "poses.txt", [numbers(*transform_of(r)[:3].ravel()) for r in one.rows])
    write_lines(drive / "image_02" / "timestamps.txt", [_date(row.stamp_ns) for row in one.rows])


def _date(stamp_ns: int) -> str:
    """Write a stamp as KITTI does.

    >>> _date(1_317_042_145_964_389_445)
    '2011-09-26 13:02:25.964389445'
    """
    whole, rest = divmod(stamp_ns, NS_PER_S)
    day = dt.datetime(1970, 1, 1, tzinfo=dt.UTC) + dt.timedelta(seconds=whole)
    return f"{day:%Y-%m-%d %H:%M:%S}.{rest:09d}"


def _readme(chosen: Sequence[Chosen], names: Sequence[str]) -> list[str]:
    cameras = [one.bridge.camera for one in chosen]
    height = min(_LARGEST_INPUT[0], max(32, min(c.height_px for c in cameras) // 32 * 32))
    width = min(_LARGEST_INPUT[1], max(32, min(c.width_px for c in cameras) // 32 * 32))
    train = "train" if "train" in names else names[-1]
    test = next((name for name in ("test", "val", "validation") if name in names), train)
    return [
        "RGB-D frames of bridges in KITTI's depth layout: 16-bit PNG, metres x 256, 0 = none.",
        f"Lists (image, depth, focal length in pixels): {', '.join(names)}.",
        "HERE is this folder. No crop for KITTI's own image size: these images are smaller.",
        "",
        "BTS (https://github.com/cleinc/bts, pytorch/):",
        "  python bts_main.py --mode train --dataset kitti --encoder densenet161_bts \\",
        f"    --data_path HERE --gt_path HERE --filenames_file HERE/{train}_files_with_gt.txt \\",
        f"    --input_height {height} --input_width {width} --max_depth 80 \\",
        "    --do_random_rotate --degree 1.0 --model_name bridges --log_directory models",
        *_of_whole_images(chosen),
        "",
        "ZoeDepth (https://github.com/isl-org/ZoeDepth):",
        "  python train_mono.py -m zoedepth -d kitti --data_path=HERE --gt_path=HERE \\",
        "    --data_path_eval=HERE --gt_path_eval=HERE --do_kb_crop=0 --garg_crop=0 \\",
        f"    --filenames_file=HERE/{train}_files_with_gt.txt \\",
        f"    --filenames_file_eval=HERE/{test}_files_with_gt.txt",
    ]


def _of_whole_images(chosen: Sequence[Chosen]) -> list[str]:
    """Say so where BTS' network, which halves images five times, cannot take whole ones."""
    sizes = {(one.bridge.camera.width_px, one.bridge.camera.height_px) for one in chosen}
    odd = sorted(size for size in sizes if any(length % _BTS_STRIDE for length in size))
    if not odd:
        return []
    named = ", ".join(f"{width} x {height}" for width, height in odd)
    return [
        f"It trains on crops, but evaluates whole images, in multiples of {_BTS_STRIDE} pixels:",
        f"{named} will not do. A camera of 1280 x 720 gives such images at an image.scale of 0.8.",
    ]
