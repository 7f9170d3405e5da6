"""Which importer reads which calibration; the formats are a closed set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.transforms import compose, inverse
from civil_rgbd.resources import nearest
from civil_rgbd.trajectories.rig_importers import (
    camera_yaml,
    direct_visual,
    fast_livo2,
    kalibr,
    livox_camera_calib,
    opencalib,
    r3live,
)
from civil_rgbd.trajectories.rig_importers.documents import Document, read_document
from civil_rgbd.trajectories.rig_importers.values import ImportedRig, Request

_LOOP_M: Final = 0.02
_LOOP_RAD: Final = 0.01
"""How far three transforms in a ring may miss closing; calibrations of one rig differ by less."""


@dataclass(frozen=True, slots=True)
class RigFormat:
    """One format.

    Attributes:
        what: the program, and its files.
        fits: whether a file is of this format.
        rig_from: reads its files.
    """

    what: str
    fits: Callable[[Document], bool]
    rig_from: Callable[[list[Document], Request], ImportedRig]


FORMATS: Final = {
    "r3live": RigFormat("R3LIVE: r3live_config.yaml", r3live.fits, r3live.rig_from),
    "fast-livo2": RigFormat(
        "FAST-LIVO2: avia.yaml, camera_pinhole.yaml", fast_livo2.fits, fast_livo2.rig_from
    ),
    "direct-visual": RigFormat(
        "direct_visual_lidar_calibration: calib.json", direct_visual.fits, direct_visual.rig_from
    ),
    "opencalib": RigFormat(
        "OpenCalib: *-extrinsic.json, *-intrinsic.json", opencalib.fits, opencalib.rig_from
    ),
    "kalibr": RigFormat("Kalibr: camchain-imucam.yaml", kalibr.fits, kalibr.rig_from),
    "ros-camera-info": RigFormat(
        "ROS camera_calibration: camera.yaml", camera_yaml.fits_ros, camera_yaml.rig_from
    ),
    "livox-camera-calib": RigFormat(
        "livox_camera_calib: extrinsic.txt, calib.yaml",
        livox_camera_calib.fits,
        livox_camera_calib.rig_from,
    ),
    "opencv": RigFormat("OpenCV: camera.yml", camera_yaml.fits_opencv, camera_yaml.rig_from),
}
"""By name; what is asked first when nobody names a format stands first."""


def import_rig(
    paths: Sequence[Path], format_name: str | None = None, request: Request | None = None
) -> tuple[str, ImportedRig]:
    """Read a calibration.

    Args:
        paths: its file, or its files where a program writes several.
        format_name: key of :data:`FORMATS`; None = told by the content.
        request: what the user adds.

    Returns:
        the format's name, and what the calibration says.

    Raises:
        UsageError: no such file or format, or a value is missing or is none.
        MissingExtraError: a YAML file, and PyYAML is not installed.
    """
    documents = [read_document(path) for path in paths]
    if format_name is None:
        format_name = _told_by_content(documents)
    elif format_name not in FORMATS:
        raise UsageError(
            f"no calibration format is called {format_name!r}",
            where="--from",
            fix=nearest(format_name, FORMATS),
        )
    elif not FORMATS[format_name].fits(documents[0]):
        others = [name for name, known in FORMATS.items() if known.fits(documents[0])]
        raise UsageError(
            f"the file is none of {FORMATS[format_name].what}",
            where=documents[0].path,
            fix=f"it looks like --from {others[0]}" if others else "check the file and --from",
        )
    return format_name, FORMATS[format_name].rig_from(documents, request or Request())


def _told_by_content(documents: list[Document]) -> str:
    for name, known in FORMATS.items():
        if all(known.fits(document) for document in documents):
            return name
    listing = "; ".join(f"{name} ({known.what})" for name, known in FORMATS.items())
    raise UsageError(
        "the calibration is of no format that is known",
        where=", ".join(str(document.path) for document in documents),
        fix=f"formats: {listing}",
    )


def merged(base: RigFile, new: RigFile) -> RigFile:
    """Lay an imported rig over another; what the new one says counts.

    Raises:
        UsageError: the transforms of both contradict each other.
    """
    extrinsics = {**base.extrinsics, **new.extrinsics}
    keys = [("imu", "lidar"), ("lidar", "camera"), ("imu", "camera")]
    if all(key in extrinsics for key in keys):
        T_imu_lidar, T_lidar_camera, T_imu_camera = (extrinsics[key] for key in keys)
        off = compose(inverse(T_imu_camera), T_imu_lidar, T_lidar_camera)
        off_m = float(np.sqrt((off[:3, 3] ** 2).sum()))
        off_rad = float(np.abs(off[:3, :3] - np.eye(3)).max())
        if off_m > _LOOP_M or off_rad > _LOOP_RAD:
            raise UsageError(
                f"T_imu_camera and T_imu_lidar T_lidar_camera contradict each other by {off_m:.3f} "
                f"m and {off_rad:.3f} rad",
                where="--onto",
                fix="take one of the three out of the rig file that is built on",
            )
    return replace(
        base,
        camera=new.camera or base.camera,
        rectified=base.rectified and new.camera is None,
        extrinsics=extrinsics,
        camera_time_offset_s=(
            base.camera_time_offset_s
            if new.camera_time_offset_s is None
            else new.camera_time_offset_s
        ),
        camera_name=new.camera_name or base.camera_name,
        lidar_name=new.lidar_name or base.lidar_name,
        map_up=new.map_up or base.map_up,
    )
