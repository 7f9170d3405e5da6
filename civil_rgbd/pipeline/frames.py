"""The method on one page: for each planned image its points, its depth, its picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NO_DEPTH_M, NS_PER_S
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recipe import AccumulateStage, Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import ImageDecodeError
from civil_rgbd.geometry.transforms import inverse
from civil_rgbd.pipeline.accumulate import PointWindow, SlidingWindow
from civil_rgbd.pipeline.image import ImageMaker, image_maker
from civil_rgbd.pipeline.mapped_scans import MappedScans
from civil_rgbd.pipeline.prepare import PointCounts
from civil_rgbd.pipeline.quality import quality_planes
from civil_rgbd.pipeline.render import render_depth
from civil_rgbd.pipeline.visibility import closed_front, forget_gone, nearest_surface, remove_hidden
from civil_rgbd.pipeline.winners import find_winners


@dataclass(frozen=True, slots=True, eq=False)
class PlannedFrame:
    """One image that passed the displacement gate.

    Attributes:
        source_index: its place in the recording.
        stamp_ns: corrected stamp, LiDAR clock.
        source_stamp_ns: original stamp, camera clock.
        T_map_camera: (4, 4) float64.
    """

    source_index: int
    stamp_ns: int
    source_stamp_ns: int
    T_map_camera: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FrameOutcome:
    """What became of one planned frame.

    Attributes:
        source_index: which.
        frame: the frame; None when it was dropped.
        dropped: why, in a stable word: ``too-few-points`` or ``image-undecodable``.
        points: in its window.
        points_in_view: of those, in the image and the depth range.
        span_ns: from the window's earliest point to its latest.
        nearest_ns: from the image to the window's nearest point in time.
        pixels_removed: emptied because something stands before what they show.
    """

    source_index: int
    frame: RgbdFrame | None
    dropped: str | None
    points: int
    points_in_view: int
    span_ns: int
    nearest_ns: int
    pixels_removed: int = 0


@dataclass(slots=True)
class FrameMaker:
    """Turns planned images of one recording into frames, in ascending order.

    Attributes:
        recording: where scans and images come from.
        recipe: how.
        images: makes the stored pictures, and knows their camera.
    """

    recording: Recording
    recipe: Recipe
    images: ImageMaker = field(init=False)
    _scans: MappedScans = field(init=False)

    def __post_init__(self) -> None:
        self.images = image_maker(self.recording.rig.camera, self.recipe.image)
        self._scans = MappedScans(self.recording, self.recipe)

    @property
    def point_counts(self) -> dict[int, PointCounts]:
        """What became of the points of each scan that was read, by scan."""
        return self._scans.counts

    def forget_counts(self) -> None:
        """Begin to count points anew: each chunk speaks of its own windows."""
        self._scans.forget_counts()

    def make(self, planned: Sequence[PlannedFrame]) -> Iterator[FrameOutcome]:
        """Make the frames of a chunk, one at a time; its first window is read back until full."""
        window, occluders = self.windows(), self.occluders()
        for plan in planned:
            around = occluders.at(plan.stamp_ns) if occluders else None
            yield self._make_one(plan, window.at(plan.stamp_ns), around)

    def windows(self) -> SlidingWindow:
        """Return a fresh window over the recording's points, in the local frame."""
        return self._sliding(self.recipe.accumulate)

    def occluders(self) -> SlidingWindow | None:
        """Return a fresh window over the points that may hide others; None if none may."""
        stage = self.recipe.visibility
        if stage is None:
            return None
        return self._sliding(
            replace(self.recipe.accumulate, points=stage.points, max_age_s=stage.max_age_s)
        )

    def _sliding(self, stage: AccumulateStage) -> SlidingWindow:
        return SlidingWindow(
            self._scans.read,
            scan_stamps_ns=self.recording.scan_stamps_ns,
            reach_ns=self.recording.point_reach_ns,
            stage=stage,
        )

    def render(
        self, T_map_camera: NDArray[np.float64], window: PointWindow
    ) -> tuple[NDArray[np.float32], int]:
        """Render the window from a camera pose.

        Returns:
            depth (H, W) float32 metres, and how many points fell into it.
        """
        rendered = render_depth(
            window.segments,
            T_camera_local=self.camera_from_local(T_map_camera),
            camera=self.images.camera,
            stage=self.recipe.depth,
        )
        if self.images.missing_pixels:
            rendered.depth_m[~self.images.exists] = NO_DEPTH_M
        return rendered.depth_m, rendered.points_in_view

    def camera_from_local(self, T_map_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``T_camera_local`` (4, 4): from the frame of the windows' points to a camera."""
        T_local_camera = T_map_camera.copy()
        T_local_camera[:3, 3] -= self._scans.origin_map
        return inverse(T_local_camera)

    def remove_hidden(
        self,
        depth_m: NDArray[np.float32],
        T_map_camera: NDArray[np.float64],
        *,
        window: PointWindow,
        around: PointWindow,
    ) -> int:
        """Empty the pixels that show what the camera cannot see, in place; return how many.

        Args:
            depth_m: (H, W) float32 metres, from :meth:`render`.
            T_map_camera: as it was rendered.
            window: which was rendered.
            around: the points that may hide some, those of the window among them or not.
        """
        if self.recipe.visibility is None:
            return 0
        surface_m = nearest_surface(
            depth_m,
            around.beyond(window),
            T_camera_local=self.camera_from_local(T_map_camera),
            camera=self.images.camera,
            limits=self.recipe.depth,
        )
        forget_gone(surface_m, depth_m, camera=self.images.camera, stage=self.recipe.visibility)
        front_m = closed_front(surface_m, camera=self.images.camera, stage=self.recipe.visibility)
        return remove_hidden(depth_m, front_m, stage=self.recipe.visibility)

    def quality(
        self,
        plan: PlannedFrame,
        window: PointWindow,
        depth_m: NDArray[np.float32],
        before_m: NDArray[np.float32],
    ) -> Mapping[str, NDArray[np.float16]] | None:
        """Return the quality planes of a frame; None where the recipe asks for none.

        Args:
            plan: the frame.
            window: which was rendered.
            depth_m: (H, W) float32 metres, as it is stored.
            before_m: (H, W) float32 metres, before hidden pixels were removed.
        """
        if self.recipe.quality is None:
            return None
        winners = find_winners(
            window,
            T_camera_local=self.camera_from_local(plan.T_map_camera),
            camera=self.images.camera,
            limits=self.recipe.depth,
        )
        stamps_ns = np.concatenate([*window.stamps_ns, np.empty(0, dtype=np.int64)])
        return quality_planes(
            depth_m,
            winners,
            ages_s=(plan.stamp_ns - stamps_ns) / NS_PER_S,
            before_m=before_m,
            exists=self.images.exists,
            camera=self.images.camera,
            depth=self.recipe.depth,
            stage=self.recipe.quality,
        )

    def _make_one(
        self, plan: PlannedFrame, window: PointWindow, around: PointWindow | None
    ) -> FrameOutcome:
        # The points decide first: an image whose frame is dropped is never decoded.
        if window.count < self.recipe.accumulate.min_fill * self.recipe.accumulate.points:
            return _outcome(plan, window, dropped="too-few-points")
        try:
            raw_rgb = self.recording.read_image(plan.source_index).rgb
        except ImageDecodeError:
            return _outcome(plan, window, dropped="image-undecodable")
        depth_m, in_view = self.render(plan.T_map_camera, window)
        before_m, removed = depth_m, 0
        if around is not None:
            before_m = depth_m.copy()
            removed = self.remove_hidden(depth_m, plan.T_map_camera, window=window, around=around)
        frame = RgbdFrame(
            source_index=plan.source_index,
            stamp_ns=plan.stamp_ns,
            source_stamp_ns=plan.source_stamp_ns,
            rgb=self.images.make(raw_rgb),
            depth_m=depth_m,
            camera=self.images.camera,
            T_map_camera=plan.T_map_camera,
            quality=self.quality(plan, window, depth_m, before_m),
        )
        made = _outcome(plan, window, frame=frame, points_in_view=in_view)
        return replace(made, pixels_removed=removed)


def _outcome(
    plan: PlannedFrame,
    window: PointWindow,
    *,
    frame: RgbdFrame | None = None,
    dropped: str | None = None,
    points_in_view: int = 0,
) -> FrameOutcome:
    return FrameOutcome(
        source_index=plan.source_index,
        frame=frame,
        dropped=dropped,
        points=window.count,
        points_in_view=points_in_view,
        span_ns=window.span_ns,
        nearest_ns=window.nearest_ns(plan.stamp_ns),
    )
