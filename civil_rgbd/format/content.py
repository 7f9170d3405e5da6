"""What some frames hold, as one hash: results of other data are told from results of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.split import FramesOf
from civil_rgbd.format.hashes import document_sha256, file_sha256
from civil_rgbd.format.reader import Bridge
from civil_rgbd.storage.places import Place, is_remote


def frames_sha256(bridges: Mapping[str, Bridge], frames: FramesOf, *, opened: bool = False) -> str:
    """Return the hash of cameras, colour images and depth of some frames, lower-case hex.

    Args:
        bridges: by id; all that ``frames`` names.
        frames: frame ids by bridge; ids that a bridge does not have do not enter.
        opened: read the files, where they lie on this machine, instead of believing what the index
            says of them: a file that was changed since is noticed. Whole data give the same hash
            either way.
    """
    return document_sha256(
        {
            name: {
                "camera": astuple(bridges[name].camera),
                "frames": [
                    [row.frame_id, *_hashes(bridges[name], row, opened=opened)]
                    for row in bridges[name].rows
                    if row.frame_id in wanted
                ],
            }
            for name, wanted in ((name, frozenset(ids)) for name, ids in frames.items())
            if wanted
        }
    )


def _hashes(bridge: Bridge, row: FrameRow, *, opened: bool) -> tuple[str, str]:
    said = (row.rgb_file_sha256, row.depth_file_sha256)
    if not opened:
        return said
    paths = (bridge.folder / row.rgb_path, bridge.folder / row.depth_path)
    return (_file_hash(paths[0], said[0]), _file_hash(paths[1], said[1]))


def _file_hash(path: Place, said: str) -> str:
    # What is needed and not there is refused where it is read.
    return said if is_remote(path) or not path.is_file() else file_sha256(path)
