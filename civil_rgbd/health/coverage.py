"""What a recipe would make of the recording: how many frames, and how many pixels with depth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.transforms import compose
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.sampling import image_stamps
from civil_rgbd.pipeline.frames import FrameMaker
from civil_rgbd.pipeline.select import far_enough

_RENDERED: Final = 4


def coverage_figures(recording: Recording, recipe: Recipe) -> Iterator[Figure]:
    """Pass the images through the recipe's displacement gate, and render a few of them.

    Args:
        recording: with poses.
        recipe: how frames would be made.
    """
    stamps_ns = np.sort(image_stamps(recording))
    gap_ns = round(recipe.poses.max_gap_s * 1e9)
    posed = stamps_ns[recording.trajectory.covers(stamps_ns, max_gap_ns=gap_ns)]
    if not len(posed):
        yield Figure("frames", 0.0, "no image lies inside the trajectory")
        yield Figure("coverage", None, "there are no frames")
        return
    poses = compose(recording.trajectory.transforms_at(posed), recording.rig.T_body_camera)
    kept = far_enough(poses[:, :3, 3], min_displacement_m=recipe.select.min_displacement_m)
    shares, short = [], 0
    maker = FrameMaker(recording, recipe)
    windows = maker.windows()
    wanted = recipe.accumulate.min_fill * recipe.accumulate.points
    try:
        for place in sorted({*_places(len(kept))}):
            window = windows.at(int(posed[kept[place]]))
            if window.count < wanted:
                short += 1
                continue
            depth_m, _ = maker.render(poses[kept[place]], window)
            shares.append(100 * float((depth_m > 0).mean()))
    except RecordingError as error:
        yield Figure("frames", float(len(kept)), f"of {len(stamps_ns)} images")
        yield Figure("coverage", None, error.what)
        return
    if not shares:
        why = f"fewer than {wanted:,.0f} points lie around each of {short} images"
        fix = "scan for longer, or take a recipe of fewer points"
        yield Figure("frames", 0.0, f"with {recipe.name}: {why}", fix=fix)
        yield Figure("coverage", None, why)
        return
    said = f"of {len(stamps_ns)} images with {recipe.name}, less the first while points are few"
    yield Figure("frames", float(len(kept)), said)
    said = f"{recipe.name}; {min(shares):.0f} to {max(shares):.0f} % in {len(shares)} images"
    yield Figure("coverage", float(np.mean(shares)), said)


def _places(count: int) -> list[int]:
    """Return some images, not the first: too few points lie before it."""
    places: list[int] = np.linspace(count / _RENDERED, count - 1, _RENDERED).astype(int).tolist()
    return places
