"""The work that no build can avoid: what the codecs and hashes of its frames cost by themselves.

Decode the raw image, undistort and resize it, encode it, decode it again for its pixel hash, encode
the EXR, hash files and pixels. Images are read from the file by the ``mcap`` package.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from civil_rgbd.builder.executors import use_one_thread
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.converters import open_recording
from civil_rgbd.format.depth_exr import write_depth
from civil_rgbd.format.hashes import bytes_sha256, pixel_sha256
from civil_rgbd.format.images import decode_image, encode_image
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.pipeline.image import image_maker

TURN_ABOUT = 32  # frames: two workers take turns at runs of frames, so each reads half of the file


def codec_seconds(source: Path, recipe_name: str, built: Path, *, workers: int = 1) -> float:
    """Return how long the codec work of a built bridge takes; reading is not counted.

    Args:
        source: the recording, MCAP.
        recipe_name: by which it was built.
        built: the bridge folder.
        workers: processes that share the frames; each runs on one core.

    Returns:
        seconds of the clock, of the worker that took longest.
    """
    if workers == 1:
        return _part(source, recipe_name, built, 0, 1)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        parts = [
            pool.submit(_part, source, recipe_name, built, part, workers) for part in range(workers)
        ]
        return max(part.result() for part in parts)


def _part(source: Path, recipe_name: str, built: Path, part: int, parts: int) -> float:
    use_one_thread()
    recipe = load_recipe(recipe_name)
    bridge = read_bridge(built)
    maker = image_maker(open_recording(source).rig.camera, recipe.image)
    stage = recipe.image
    rows = {
        row.source_index: row
        for place, row in enumerate(bridge.rows)
        if place // TURN_ABOUT % parts == part
    }
    scratch = built.parent / f"depth{part}.exr"
    total = 0.0
    for index, raw in _raw_images(source):
        row = rows.get(index)
        if row is None:
            continue
        depth_m = bridge.read_depth(row)  # not counted: the build has it in memory
        started = time.perf_counter()
        rgb = maker.make(decode_image(raw, where="benchmark"))
        encoded = encode_image(
            rgb, codec=stage.codec, quality=stage.quality, subsampling=stage.subsampling
        )
        stored = write_depth(scratch, depth_m, sync=False)
        for hashed in (encoded, stored):
            bytes_sha256(hashed)
        pixel_sha256(decode_image(encoded, where="benchmark"))
        pixel_sha256(depth_m)
        total += time.perf_counter() - started
    scratch.unlink(missing_ok=True)
    return total


def _raw_images(source: Path) -> Iterator[tuple[int, bytes]]:
    with source.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = [
            channel.topic
            for channel in reader.get_summary().channels.values()
            if channel.topic.endswith("/compressed")
        ]
        for index, (_, _, _, image) in enumerate(reader.iter_decoded_messages(topics=topics)):
            yield index, bytes(image.data)
