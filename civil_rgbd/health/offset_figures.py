"""What the images' turning says of the clocks, as figures: time offset, and whether it stays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from civil_rgbd.domain.recording import Recording
from civil_rgbd.health.checks import CHECKS, Figure
from civil_rgbd.health.constancy import Change
from civil_rgbd.health.turning import TimeOffset


def offset_figure(recording: Recording, offset: TimeOffset) -> Figure:
    """Judge the time offset; a number to write down is given only where one fits all through.

    Args:
        recording: its rig is what the offset adds to.
        offset: from :func:`civil_rgbd.health.turning.time_offset`.
    """
    change = offset.change
    also = f"; {change.words}" if change.words else ""
    if offset.offset_s is None:
        return Figure("time-offset", None, offset.why_not + also)
    whole_s = recording.rig.camera_time_offset_s + offset.offset_s
    fix = f"write camera_time_offset_s = {whole_s:.4f} into the rig file (--rig)"
    if change.certain:
        fix = f"no single number fits: {change.words}; {CHECKS['clock-drift'].fix}"
    return Figure(
        "time-offset",
        1000 * abs(offset.offset_s),
        f"{1000 * offset.offset_s:+.1f} ms are to be added to the images' stamps to agree with the "
        f"poses{also}; the sensors turn at {offset.rate_rad_s:.2f} rad/s RMS",
        fix=fix,
        sigma=1000 * offset.sigma_s,
    )


def change_figures(change: Change) -> Iterator[Figure]:
    """Say how far the camera's clock drifts or steps, where the images' turning is sure of it.

    Args:
        change: of the time offset.
    """
    if change.change_s is None or not change.certain:
        return
    value, sigma = 1000 * abs(change.change_s), 1000 * change.sigma_s
    if value > CHECKS["clock-drift"].limit:
        said = f"by how images and poses turn, the time offset does not stay: {change.words}"
        yield Figure("clock-drift", value, said, sigma=sigma)


def largest_of_each(figures: Iterable[Figure]) -> list[Figure]:
    """Keep one figure of each code: the largest that is known."""
    kept: dict[str, Figure] = {}
    for figure in figures:
        before = kept.get(figure.code)
        if before is None or _size(figure) > _size(before):
            kept[figure.code] = figure
    return list(kept.values())


def _size(figure: Figure) -> float:
    return -1.0 if figure.value is None else figure.value
