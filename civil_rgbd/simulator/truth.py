"""What a simulated recording does not say: true poses, true dimensions, true depth.

Kept in a folder of its own beside the recording. Only the simulator, benchmarks and tests read it.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.domain.frame import frame_id_from
from civil_rgbd.errors import OutputError
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import quaternion_from_matrix
from civil_rgbd.simulator.camera import raw_camera, true_depth
from civil_rgbd.simulator.catalogue import site_for
from civil_rgbd.simulator.sightings import seen_spalls
from civil_rgbd.simulator.spall import Spall
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.walk import (
    T_IMU_LIDAR,
    T_LIDAR_CAMERA,
    camera_poses,
    image_instants_ns,
    imu_poses,
    pose_stamps_ns,
)
from civil_rgbd.storage.whole_files import scratch_beside

_SCENE = "scene.json"
_COLUMNS = "stamp_ns,tx,ty,tz,qx,qy,qz,qw"


def truth_folder(recording: Path) -> Path:
    """Return where the truth of a recording lies.

    >>> truth_folder(Path("scans/raw.mcap")).as_posix()
    'scans/raw.truth'
    """
    return recording.with_name(f"{recording.stem}.truth")


def write_truth(
    recording: Path, spec: ScanSpec, *, depth_camera: PinholeCamera | None = None
) -> Path:
    """Write the truth of a recording beside it, replacing what is there; whole or absent.

    Args:
        recording: the file that it is the truth of.
        spec: what it was simulated from.
        depth_camera: the pinhole to write the depth of every image for; None writes no depth.

    Returns:
        the folder: ``scene.json`` (the recording's name, dimensions, spalls, what moves, sensors,
        spec), ``scene.ply`` (the faces of all that stands), ``defects.json`` (each spall in the
        image that sees it best, in pixels of ``depth_camera`` or else of the raw images without
        their lens),
        ``images.csv`` (``T_map_camera`` of each image at its true instant), ``poses.csv``
        (``T_map_imu``, 200 Hz), ``depth/000000.npy`` (float64 metres, 0 where the sky is).

    Raises:
        OutputError: it cannot be written.
    """
    folder = truth_folder(recording)
    scratch = scratch_beside(folder)
    try:
        try:
            scratch.mkdir(parents=True)
            _write_documents(scratch, spec, recording.name)
            _write_defects(scratch, spec, depth_camera or raw_camera(spec.image_scale).pinhole)
            if depth_camera is not None:
                _write_depth(scratch / "depth", spec, depth_camera)
            remove_truth(recording)
            scratch.rename(folder)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        raise OutputError(
            f"cannot write the truth: {error.strerror or error}",
            where=folder,
            fix="free some space, or make the folder writable, or write elsewhere",
        ) from error
    return folder


def require_free_truth(recording: Path, *, overwrite: bool) -> None:
    """Refuse to write a recording where the truth of another one lies.

    ``raw.mcap`` and ``raw.bag`` would have the same folder.

    Args:
        recording: the file to be written.
        overwrite: a truth whose recording is gone may be replaced.

    Raises:
        OutputError: the folder is another's, or no truth, or may not be replaced.
    """
    folder = truth_folder(recording)
    if not folder.exists():
        return
    said = _recording_of(folder)
    if said is None:
        what, fix = "and says of no recording that it is its truth", "move it away"
    elif (owner := recording.with_suffix(Path(said).suffix)) != recording and owner.exists():
        what, fix = f"the truth of {owner.name}", f"move {owner.name} and it away"
    elif not overwrite and not recording.exists():
        what, fix = f"the truth of {owner.name}, which is gone", "give --overwrite"
    else:
        return  # it goes with the recording that is replaced
    raise OutputError(
        f"{folder.name} is there already, {what}",
        where=folder,
        fix=f"choose another name, or {fix}",
    )


def _recording_of(folder: Path) -> str | None:
    """Return the name of the recording that a truth is of; None where it does not say."""
    try:
        document = json.loads((folder / _SCENE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    name = document.get("recording") if isinstance(document, dict) else None
    return name if isinstance(name, str) else None


def remove_truth(recording: Path) -> bool:
    """Remove the truth of a recording, and say whether there was one.

    Raises:
        OutputError: it cannot be removed.
    """
    folder = truth_folder(recording)
    try:
        if not folder.exists():
            return False
        shutil.rmtree(folder)
    except OSError as error:
        raise OutputError(
            f"cannot remove the truth of another scan: {error.strerror or error}",
            where=folder,
            fix="remove the folder, or write elsewhere",
        ) from error
    return True


def _write_documents(folder: Path, spec: ScanSpec, recording: str) -> None:
    site = site_for(spec)
    scene = site.scene
    document = {
        "recording": recording,
        "spec": spec.document(),
        "dimensions_m": scene.dimensions_m,
        "spalls": [_spall_document(spall, spec.map_offset_m) for spall in site.spalls],
        "movers": [
            {"name": mover.name, "motion": type(mover.motion).__name__, **asdict(mover.motion)}
            for mover in site.movers
        ],
        "raw_camera": asdict(raw_camera(spec.image_scale)),
        "T_imu_lidar": T_IMU_LIDAR.tolist(),
        "T_lidar_camera": T_LIDAR_CAMERA.tolist(),
    }
    text = json.dumps(document, indent=2) + "\n"
    (folder / _SCENE).write_text(text, encoding="utf-8")
    mesh = scene.mesh()
    mesh.apply_translation(spec.map_offset_m)
    (folder / "scene.ply").write_bytes(mesh.export(file_type="ply"))
    instants, stamps = image_instants_ns(spec), pose_stamps_ns(spec)
    poses = camera_poses(spec, instants)
    turns = np.array([quaternion_from_matrix(R) for R in poses[:, :3, :3]]).reshape(-1, 4)
    _write_poses(folder / "images.csv", instants, poses[:, :3, 3], turns)
    _write_poses(folder / "poses.csv", stamps, *imu_poses(spec, stamps))


def _spall_document(spall: Spall, offset_m: tuple[float, ...]) -> dict[str, object]:
    return {
        "name": spall.name,
        "part": spall.part,
        "severity": spall.severity,
        "length_m": spall.length_m,
        "width_m": spall.width_m,
        "depth_m": spall.depth_m,
        "area_m2": spall.area_m2,
        "centre_map_m": (spall.centre_m + offset_m).tolist(),
        "deepest_map_m": (spall.deepest_m + offset_m).tolist(),
        "along": spall.along.tolist(),
        "up": spall.up.tolist(),
        "normal": spall.normal.tolist(),
        "outline_map_m": (spall.outline_m + offset_m).tolist(),
    }


def _write_defects(folder: Path, spec: ScanSpec, camera: PinholeCamera) -> None:
    defects = [asdict(record) for record in seen_spalls(spec, camera)]
    document = {"format_version": FORMAT_VERSION, "defects": defects}
    text = json.dumps(document, indent=2) + "\n"
    (folder / "defects.json").write_text(text, encoding="utf-8")


def _write_poses(
    path: Path,
    stamps_ns: NDArray[np.int64],
    translations_m: NDArray[np.float64],
    quaternions_xyzw: NDArray[np.float64],
) -> None:
    rows = np.hstack([translations_m, quaternions_xyzw]).tolist()
    lines = [
        ",".join(map(repr, (stamp, *row)))
        for stamp, row in zip(stamps_ns.tolist(), rows, strict=True)
    ]
    path.write_text("\n".join([_COLUMNS, *lines]) + "\n", encoding="utf-8")


def _write_depth(folder: Path, spec: ScanSpec, camera: PinholeCamera) -> None:
    folder.mkdir()
    for index in range(len(image_instants_ns(spec))):
        np.save(folder / f"{frame_id_from(index)}.npy", true_depth(spec, index, camera))
