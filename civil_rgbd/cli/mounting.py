"""What a build says of the camera's mounting before it starts, and whether it seems inverted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from civil_rgbd.domain.recording import Recording
    from civil_rgbd.health.direction import DirectionReport

_IMAGES: Final = 4
"""Some hundredths of a second each; `civil-rgbd rig check` looks at more."""


def say_mounting(recording: Recording, *, rig_given: bool) -> None:
    """Say on stderr how the camera sits, where a rig file says so; and if it seems inverted.

    Args:
        recording: opened.
        rig_given: the user gave a rig file.
    """
    from civil_rgbd.geometry.words import extrinsics_in_words

    if recording.notes.simulated and not rig_given:
        return  # the simulator knows which way round its camera sits
    if rig_given:
        words = extrinsics_in_words(recording.rig.T_lidar_camera)
        click.echo(f"rig: {words}", err=True)
    report = _compared(recording)
    if report is not None and report.verdict == "inverse":
        for line in _warning(report, rig_given=rig_given):
            click.echo(line, err=True)


def _compared(recording: Recording) -> DirectionReport | None:
    from civil_rgbd.errors import CivilRgbdError
    from civil_rgbd.health.direction import compare_directions

    try:
        return compare_directions(recording, _IMAGES)
    except CivilRgbdError:
        return None  # what cannot be read, the build tells of itself


def _warning(report: DirectionReport, *, rig_given: bool) -> list[str]:
    from civil_rgbd.geometry.transforms import inverse
    from civil_rgbd.geometry.words import extrinsics_in_words

    T_lidar_camera = report.T_lidar_camera
    images = f"{report.images} images say"
    place = "in place of what the rig file says of the camera" if rig_given else "by --rig"
    return [
        f"warning: rig-inverted: {images} that the camera's mounting is the wrong way round",
        f"  as given: {extrinsics_in_words(T_lidar_camera)}",
        f"    {report.given.in_words}",
        f"  inverse:  {extrinsics_in_words(inverse(T_lidar_camera))}",
        f"    {report.inverse.in_words}",
        f"  fix: look closer with `civil-rgbd rig check`; to turn it round, say {place}:",
        f"    {report.turned_round}",
    ]
