"""A built bridge: who and what it is, where its frames came from, and what was counted."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import BRIDGE_ID_PATTERN, FORMAT_VERSION
from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.domain.rig import Rig
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.geometry.transforms import rigid_fault

UNSTATED_LICENCE: Final = "LicenseRef-Unstated"
"""The licence of a bridge whose builder named none: nobody may assume any right."""

_SPDX_FORM: Final = r"\(*[A-Za-z0-9.+-]+\)*( (AND|OR|WITH) \(*[A-Za-z0-9.+-]+\)*)*"

ORIGINS: Final = ("rendered", "imported", "simulated")
"""Depth rendered here from points; taken over from another set; rendered from simulated points."""

DESKEWS: Final = ("per_point", "unavailable", "registered", "off")
"""Points moved by their own times; they had none; they were in the map already; not asked for."""


OLD_POINTS_S: Final = 0.25
"""A frame whose nearest point is further away in time was made while no LiDAR measured."""


@dataclass(frozen=True, slots=True)
class Structure:
    """What stands there.

    Attributes:
        type: a word of the schema's list: ``girder``, ``slab``, ``box girder``, ...
        material: a word of the schema's list: ``concrete``, ``steel``, ``masonry``, ...
        year_built: year of completion.
        length_m: length along the road.
        note: anything else that a reader should know.
    """

    type: str | None = None
    material: str | None = None
    year_built: int | None = None
    length_m: float | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True)
class Location:
    """A point on the map, as precise as the owner allows.

    Attributes:
        latitude_deg: WGS 84, north positive.
        longitude_deg: WGS 84, east positive.
        precision_m: the true place lies within this distance; None when it is not said.
    """

    latitude_deg: float
    longitude_deg: float
    precision_m: float | None = None


@dataclass(frozen=True, slots=True)
class Contribution:
    """What a contributor states beyond the description; None where nothing is stated.

    Attributes:
        place_precision: how precisely the owner lets the place be known.
        consent: how the owner agreed.
        calibration_method: how the camera was calibrated to the LiDAR.
        calibration_date: ISO 8601.
        calibration_report: what the calibration gave, in words.
        faces: what was done about faces.
        plates: what was done about number plates.
    """

    place_precision: str | None = None
    consent: str | None = None
    calibration_method: str | None = None
    calibration_date: str | None = None
    calibration_report: str | None = None
    faces: str | None = None
    plates: str | None = None


@dataclass(frozen=True, slots=True)
class BridgeInfo:
    """What people say about a bridge; all of it may be absent but the id and the licence.

    Attributes:
        bridge_id: unique in a dataset, ignoring case.
        licence: SPDX expression; :data:`UNSTATED_LICENCE` where nobody named one.
        name: the bridge's name.
        place: where it stands, in words.
        country: ISO 3166-1 alpha-2.
        region: ISO 3166-2.
        location: where it stands, as coordinates.
        structure: what it is.
        owner: who owns the structure.
        owner_consent: the owner's agreement to publish, in words.
        citation: how to cite the data.
        contact: whom to ask.
        survey_dates: days of the scan, ISO 8601 (``2024-06-01``).
        sensors: sensors and their calibration, in words.
        privacy: how faces and number plates were dealt with.
        note: anything else.
        contribution: what a contributor states; None when nobody stated anything.
    """

    bridge_id: str
    licence: str = UNSTATED_LICENCE
    name: str | None = None
    place: str | None = None
    country: str | None = None
    region: str | None = None
    location: Location | None = None
    structure: Structure | None = None
    owner: str | None = None
    owner_consent: str | None = None
    citation: str | None = None
    contact: str | None = None
    survey_dates: tuple[str, ...] = ()
    sensors: str | None = None
    privacy: str | None = None
    note: str | None = None
    contribution: Contribution | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(BRIDGE_ID_PATTERN, self.bridge_id):
            raise ValueError(f"bridge id {self.bridge_id!r} does not match {BRIDGE_ID_PATTERN}")
        if not re.fullmatch(_SPDX_FORM, self.licence):
            raise ValueError(
                f"the licence {self.licence!r} is no SPDX expression, such as CC-BY-4.0; "
                f"{UNSTATED_LICENCE!r} says that none is stated"
            )


@dataclass(frozen=True, slots=True, eq=False)
class RigRecord:
    """The rig that a bridge was built with, as its manifest keeps it.

    Attributes:
        camera: the raw camera, lens included.
        T_lidar_camera: (4, 4), camera optical frame to LiDAR frame.
        T_body_lidar: (4, 4), LiDAR frame to the body that the trajectory speaks of.
        camera_time_offset_s: was added to image stamps to reach the LiDAR clock.
        body: the body's frame id in the recording.
        lidar_name: the LiDAR.
        camera_name: the camera.
    """

    camera: LensCamera
    T_lidar_camera: NDArray[np.float64]
    T_body_lidar: NDArray[np.float64]
    camera_time_offset_s: float
    body: str
    lidar_name: str
    camera_name: str

    def __post_init__(self) -> None:
        for name in ("T_lidar_camera", "T_body_lidar"):
            fault = rigid_fault(getattr(self, name))
            if fault:
                raise ValueError(f"{name} is no rigid transform: {fault}")
        if not np.isfinite(self.camera_time_offset_s):
            raise ValueError(f"camera_time_offset_s is {self.camera_time_offset_s!r}")


def rig_record(rig: Rig) -> RigRecord:
    """Return what a manifest keeps of a rig."""
    return RigRecord(
        camera=rig.camera,
        T_lidar_camera=rig.T_lidar_camera,
        T_body_lidar=rig.T_body_lidar,
        camera_time_offset_s=rig.camera_time_offset_s,
        body=rig.body,
        lidar_name=rig.lidar_name,
        camera_name=rig.camera_name,
    )


@dataclass(frozen=True, slots=True)
class RecipeRecord:
    """The recipe that a bridge was built with.

    Attributes:
        name: the recipe's name.
        sha256: of the canonical JSON of ``parameters``, lower-case hex.
        parameters: every key of the recipe with the value that was used, by stage.
        overrides: what was changed on the command line, by dotted key.
    """

    name: str
    sha256: str
    parameters: Mapping[str, object]
    overrides: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Software:
    """What made the frames.

    Attributes:
        civil_rgbd: version of this package.
        python: version of the interpreter.
        packages: versions of the packages that touch pixels, by name.
        commit: of the source tree, where it is known.
    """

    civil_rgbd: str
    python: str
    packages: Mapping[str, str]
    commit: str | None = None


@dataclass(frozen=True, slots=True)
class Counts:
    """What went in, what came out, and why the rest did not.

    Attributes:
        images_seen: images in the recording.
        frames_kept: frames in the bridge.
        dropped: images that became no frame, by reason; they and the kept add up to the seen.
        scans_seen: LiDAR messages in the recording.
        scans_read: of those, the ones that the window of some frame looked into.
        points_read: points in the messages that were read, before any filter.
        points_dropped: points that never counted, by reason.
        skipped: other things that reading left out, by name.
        mean_points_in_view: mean number of a frame's points that fell into its image.
        mean_age_span_s: mean time between a frame's oldest and newest point.
        mean_newest_age_s: mean time between a frame's image and its nearest point in time: of past
            points the age of the newest.
        max_newest_age_s: the largest of these times.
        frames_with_old_points: frames for which it is above :data:`OLD_POINTS_S`.
        mean_valid_share: mean share of pixels with depth.
        pixels_without_source: pixels of every image that the raw one does not have.
        pixels_removed_by_visibility: pixels of all frames that were emptied because something
            stands before what they showed; None where the recipe does not look.
    """

    images_seen: int
    frames_kept: int
    dropped: Mapping[str, int] = field(default_factory=dict)
    scans_seen: int | None = None
    scans_read: int | None = None
    points_read: int | None = None
    points_dropped: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    mean_points_in_view: float | None = None
    mean_age_span_s: float | None = None
    mean_newest_age_s: float | None = None
    max_newest_age_s: float | None = None
    frames_with_old_points: int | None = None
    mean_valid_share: float | None = None
    pixels_without_source: int | None = None
    pixels_removed_by_visibility: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Manifest:
    """``manifest.json``: written last, and the only sign that a bridge folder is whole.

    Attributes:
        info: identity and what people say about the bridge.
        origin: one of :data:`ORIGINS`.
        sources: the files behind it.
        reading: how they were read where they could have been read otherwise, by name.
        software: what made it.
        counts: what was seen, kept and dropped.
        rig: how the sensors were mounted; None where an import does not say.
        recipe: how the frames were made; None when they were imported.
        deskew: one of :data:`DESKEWS`; None where an import does not say.
        salvage: None for a whole recording, else in words what was lost.
        map_up: unit vector against gravity, map frame; None when it is not known.
        map_origin_m: where the ring's local frame sits in the map: translation of T_map_local.
        quality: what the quality planes hold; None without them.
        warnings: things that are odd but not fatal, in words.
        format_version: of the folder, ``major.minor``.
        data_version: of the data, chosen by the publisher.
    """

    info: BridgeInfo
    origin: str
    sources: tuple[SourceFile, ...]
    software: Software
    counts: Counts
    reading: Mapping[str, str] = field(default_factory=dict)
    rig: RigRecord | None = None
    recipe: RecipeRecord | None = None
    deskew: str | None = None
    salvage: str | None = None
    map_up: tuple[float, float, float] | None = None
    map_origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quality: Mapping[str, object] | None = None
    warnings: tuple[str, ...] = ()
    format_version: str = FORMAT_VERSION
    data_version: str = "1.0"

    def __post_init__(self) -> None:
        if self.origin not in ORIGINS:
            raise ValueError(f"origin {self.origin!r} is none of {', '.join(ORIGINS)}")
        if self.deskew is not None and self.deskew not in DESKEWS:
            raise ValueError(f"deskew {self.deskew!r} is none of {', '.join(DESKEWS)}")
        if (self.recipe is None) != (self.origin == "imported"):
            raise ValueError(f"origin {self.origin!r} with recipe {self.recipe!r}")
        if self.map_up is not None:
            norm = float(np.sqrt(sum(component**2 for component in self.map_up)))
            if not abs(norm - 1) <= 1e-6:
                raise ValueError(f"map_up has norm {norm!r}, not 1")
        if not np.isfinite(self.map_origin_m).all():
            raise ValueError(f"map_origin_m is {self.map_origin_m!r}")
