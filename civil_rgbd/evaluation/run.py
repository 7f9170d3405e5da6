"""Predict frames, compare with measured depth, score every set of frames from one pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.baselines.model import DepthModel, StoredDepth, predict_frame
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.split import FramesOf, Split
from civil_rgbd.errors import UsageError
from civil_rgbd.evaluation.frames import open_bridges, rows_of
from civil_rgbd.evaluation.metrics import MetricRules, Scores, compute
from civil_rgbd.evaluation.sums import ImageSums, measure_image
from civil_rgbd.format.reader import Bridge
from civil_rgbd.geometry.camera import PinholeCamera

Progress = Callable[[int, int], object]
"""Called with the frames just finished and the frames in all."""


@dataclass(frozen=True, slots=True)
class EvaluationOptions:
    """How to score.

    Attributes:
        rules: which pixels count.
        flip: average with the prediction of the mirrored image, mirrored back.
        on_progress: called as frames are finished.
    """

    rules: MetricRules = field(default_factory=MetricRules)
    flip: bool = False
    on_progress: Progress = lambda _done, _total: None


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """What came out.

    Attributes:
        split: the frames that were scored.
        rules: which pixels counted.
        flip: whether predictions are averages over flips.
        images: sums of each frame, by (bridge, frame).
    """

    split: Split
    rules: MetricRules
    flip: bool
    images: Mapping[tuple[str, str], ImageSums]

    def scores(self, test: str, bridge: str | None = None) -> Scores:
        """Score one of the split's sets of frames, or only its frames of one bridge."""
        return compute(
            [
                self.images[name, frame]
                for name, ids in self.split.tests[test].items()
                for frame in ids
                if bridge in {None, name}
            ],
            rules=self.rules,
        )


def evaluate(
    model: DepthModel | StoredDepth,
    data: Path,
    split: Split,
    options: EvaluationOptions | None = None,
) -> Evaluation:
    """Score a model, or stored predictions, on the test frames of a split.

    Args:
        model: sees an image, or knows a frame.
        data: a dataset folder or one bridge folder.
        split: its ``tests`` are scored; each frame is predicted once.
        options: how.

    Raises:
        UsageError: a frame is not there, there is none, or none has a pixel to score.
        FormatError: a file is damaged, or the model answers with something else than depth.
    """
    options = options or EvaluationOptions()
    _refuse_flipping(model, flip=options.flip)
    frames = split.scored()
    bridges = open_bridges(data, frames)
    rows = rows_of(frames, bridges, where=data)
    images = {}
    for name, row in rows:
        bridge = bridges[name]
        prediction_m = predict_row(model, bridge, name, row, flip=options.flip)
        images[name, row.frame_id] = measure_image(
            prediction_m, bridge.read_depth(row), rules=options.rules
        )
        options.on_progress(1, len(rows))
    _refuse_nothing(images, options.rules, frames, where=data)
    return Evaluation(split, options.rules, options.flip, images)


def _refuse_flipping(model: DepthModel | StoredDepth, *, flip: bool) -> None:
    if flip and not isinstance(model, DepthModel):
        raise UsageError(
            "stored predictions cannot be averaged over flips: nobody predicted mirrored images",
            where="--flip",
            fix="leave --flip out, or average before you store",
        )


def _refuse_nothing(
    images: Mapping[tuple[str, str], ImageSums],
    rules: MetricRules,
    frames: FramesOf,
    *,
    where: object,
) -> None:
    if not images:
        raise UsageError(
            "the split scores no frame", where=where, fix="give a split whose tests hold frames"
        )
    if all(image.valid_px < rules.min_valid_px for image in images.values()):
        most = max(image.valid_px for image in images.values())
        raise UsageError(
            f"no frame of {', '.join(frames)} can be scored: none of {len(images)} has "
            f"{rules.min_valid_px} valid pixels; the most is {most}, between "
            f"{rules.min_depth_m:g} and {rules.max_depth_m:g} m",
            where=where,
            fix="look at the depth: `civil-rgbd validate`; or widen --min-depth and --max-depth",
        )


def predict_row(
    model: DepthModel | StoredDepth, bridge: Bridge, name: str, row: FrameRow, *, flip: bool = False
) -> NDArray[np.float32]:
    """Predict one stored frame: (H, W) float32 metres.

    Args:
        model: sees an image, or knows a frame.
        bridge: that the frame is of.
        name: the bridge's id.
        row: the frame.
        flip: average with the prediction of the mirrored image, mirrored back.

    Raises:
        FormatError: a file is damaged, or the model answers with something else than depth.
    """
    camera = bridge.camera
    if not isinstance(model, DepthModel):
        # No image is decoded for a model that does not look at it: the size alone is asked for.
        blank = np.broadcast_to(np.uint8(0), (camera.height_px, camera.width_px, 3))
        return predict_frame(model, blank, camera, bridge=name, frame=row.frame_id)
    rgb = bridge.read_rgb(row)
    straight = predict_frame(model, rgb, camera, bridge=name, frame=row.frame_id)
    if not flip:
        return straight
    mirrored = predict_frame(
        model,
        np.ascontiguousarray(rgb[:, ::-1]),
        mirrored_camera(camera),
        bridge=name,
        frame=row.frame_id,
    )
    return (straight + mirrored[:, ::-1]) * np.float32(0.5)


def mirrored_camera(camera: PinholeCamera) -> PinholeCamera:
    """Return the camera of the image mirrored left to right."""
    return replace(camera, cx_px=camera.width_px - 1 - camera.cx_px)
