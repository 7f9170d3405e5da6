"""Where a recording's camera model comes from: the rig file, or CameraInfo."""

from __future__ import annotations

from dataclasses import dataclass

from civil_rgbd.conversion.beside import camera_of_rig, lens_remarks
from civil_rgbd.conversion.camera_info import CameraInfo, camera_from_info, parse_camera_info
from civil_rgbd.conversion.cdr import decoding
from civil_rgbd.conversion.gathering import GatheredCameraInfo
from civil_rgbd.conversion.ros_choice import choose_camera_info
from civil_rgbd.conversion.topics import Topic, TopicTable
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera


@dataclass(frozen=True, slots=True, eq=False)
class CameraSource:
    """The chosen camera.

    Attributes:
        camera: the model.
        frame: of the images; empty when not named.
        name: ``rig``, or the CameraInfo's topic.
        rectified: the images are rectified already.
        warnings: what is odd about it.
        topic: of CameraInfo; None for a rig file's camera.
    """

    camera: LensCamera
    frame: str
    name: str
    rectified: bool
    warnings: tuple[str, ...] = ()
    topic: Topic | None = None


def choose_camera(
    table: TopicTable, options: RecordingOptions, images: Topic | None, *, where: object
) -> CameraSource:
    """Find the camera: in the rig file, else in the images' CameraInfo.

    Args:
        table: the recording's topics.
        options: what the user says.
        images: the chosen topic; None for images beside the recording.
        where: the file, for errors.

    Raises:
        UsageError: several CameraInfo topics fit.
        RecordingError: there is no camera model, or none that is known.
    """
    frame = images.gathered.frame if images else ""
    by_topic = images is not None and "_rect" in images.name
    rectified = by_topic or options.rectified or options.rig.rectified
    if options.rig.camera is not None or images is None:
        camera = camera_of_rig(options, rectified=rectified, where=where)
        warnings = lens_remarks(options, rectified=rectified)
        return CameraSource(camera, frame, "rig", rectified, warnings)
    topic = choose_camera_info(table, options, images, where=where)
    gathered = topic.gathered if topic else None
    info: CameraInfo | None = None
    if isinstance(gathered, GatheredCameraInfo):
        with decoding("CameraInfo", where=where):
            info = parse_camera_info(memoryview(gathered.message), gathered.read)
    if topic is None or info is None or not info.calibrated:
        table.refuse_other_encodings("camera_info", where=where)
        raise RecordingError(
            "the recording holds no camera model"
            + (": CameraInfo says that the camera is not calibrated (K is zero)" if info else ""),
            where=where,
            fix="give the camera in a rig file (--rig), or record sensor_msgs/CameraInfo",
        )
    camera = camera_from_info(info, rectified=rectified, where=where)
    remarks = _remarks(topic, info, rectified=rectified)
    return CameraSource(camera, frame or info.frame, topic.name, rectified, remarks, topic)


def _remarks(topic: Topic, info: CameraInfo, *, rectified: bool) -> tuple[str, ...]:
    warnings = []
    differing = topic.gathered.differing if isinstance(topic.gathered, GatheredCameraInfo) else 0
    if differing:
        warnings.append(f"{differing} CameraInfo messages differ from the first, which is used")
    if rectified and not any(info.p):
        warnings.append("the images are rectified but CameraInfo has no P: K is used instead")
    return tuple(warnings)
