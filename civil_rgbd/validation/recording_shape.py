"""What a recording says before anything is read: types, stamps, notes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS
from civil_rgbd.domain.recording import Recording, RecordingNotes, SourceFile
from civil_rgbd.domain.rig import Rig
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import rigid_fault

DESKEWS: Final = ("per_point", "unavailable", "registered")
"""What ``notes.deskew`` may be."""

_TYPES: Final = {
    "name": str,
    "sources": tuple,
    "notes": RecordingNotes,
    "rig": Rig,
    "trajectory": Trajectory,
    "image_stamps_ns": np.ndarray,
    "scan_stamps_ns": np.ndarray,
    "point_reach_ns": tuple,
}


def shape_fits(recording: Recording) -> Iterator[str]:
    """Yield attributes and methods that are missing or of another type."""
    for name, kind in _TYPES.items():
        if not hasattr(recording, name):
            yield f"it has no {name}"
        elif not isinstance(getattr(recording, name), kind):
            yield f"{name} is a {type(getattr(recording, name)).__name__}, not a {kind.__name__}"
    for name in ("read_scan", "read_image"):
        if not callable(getattr(recording, name, None)):
            yield f"it has no method {name}"
    for name in ("image_stamps_ns", "scan_stamps_ns"):
        stamps = getattr(recording, name, None)
        if isinstance(stamps, np.ndarray) and (stamps.dtype != np.int64 or stamps.ndim != 1):
            yield f"{name} is {stamps.dtype} of shape {stamps.shape}, not int64 of shape (N,)"


def stamps_fit(recording: Recording) -> Iterator[str]:
    """Yield what is wrong with the clocks: nothing there, nothing shared, an impossible reach."""
    rig, trajectory = recording.rig, recording.trajectory
    images_ns = recording.image_stamps_ns + rig.camera_time_offset_ns
    reach = recording.point_reach_ns
    well = len(reach) == 2 and all(isinstance(bound, int) for bound in reach)
    if not well or not reach[0] <= reach[1]:
        yield f"point_reach_ns is {reach!r}, not (earliest, latest) in whole nanoseconds"
    elif max(map(abs, reach)) > MAX_POINT_TIME_OFFSET_NS:
        yield f"point_reach_ns is {reach!r}, further than a message can be long"
    for what, stamps_ns in [("images", images_ns), ("scans", recording.scan_stamps_ns)]:
        if not len(stamps_ns):
            yield f"it has no {what}"
        elif int(stamps_ns.min()) < 0:
            yield f"a stamp of {what} is {int(stamps_ns.min())}, before 1970"
        elif stamps_ns.max() < trajectory.stamps_ns[0] or (
            stamps_ns.min() > trajectory.stamps_ns[-1]
        ):
            yield f"no {what} lie inside the trajectory"
    for name in ("T_body_camera", "T_body_lidar"):
        fault = rigid_fault(getattr(rig, name))
        if fault:
            yield f"{name} is no rigid transform: {fault}"


def notes_fit(recording: Recording) -> Iterator[str]:
    """Yield notes that no manifest can carry."""
    notes = recording.notes
    if notes.deskew not in DESKEWS:
        yield f"deskew is {notes.deskew!r}, not one of {', '.join(DESKEWS)}"
    if notes.deskew == "unavailable" and tuple(recording.point_reach_ns) != (0, 0):
        yield "deskew is unavailable, but point_reach_ns is not (0, 0)"
    if notes.salvage is not None and not (isinstance(notes.salvage, str) and notes.salvage):
        yield f"salvage is {notes.salvage!r}, not None and not words"
    if notes.map_up is not None and abs(np.sqrt(np.square(notes.map_up).sum()) - 1) > 1e-6:
        yield f"map_up {notes.map_up!r} is no unit vector"
    for warning in notes.warnings:
        if not isinstance(warning, str):
            yield f"a warning is a {type(warning).__name__}, not words"


def names_fit(recording: Recording) -> Iterator[str]:
    """Yield names of the recording and its sources that are none, or name a machine's folders."""
    if not recording.name or set(recording.name) & set("/\\"):
        yield f"name is {recording.name!r}: empty, or with folders"
    for source in recording.sources:
        if not isinstance(source, SourceFile):
            yield f"a source is a {type(source).__name__}, not a SourceFile"
        elif not source.name or set(source.name) & set("/\\"):
            yield f"a source is named {source.name!r}: empty, or with folders"
