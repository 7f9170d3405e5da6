"""Walks through the five simulated bridges, rendered as a build does it, beside the true depth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from measured_code import measuring_key
from numpy.typing import NDArray

from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.builder.recipes import load_recipe, recipe_parameters
from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recipe import Recipe, VisibilityStage
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.accumulate import PointWindow
from civil_rgbd.pipeline.frames import FrameMaker, PlannedFrame
from civil_rgbd.pipeline.visibility import nearest_surface
from civil_rgbd.simulator.camera import pinhole_rays, raw_camera, true_camera_pose
from civil_rgbd.simulator.catalogue import caster_for
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec, usual_spec
from civil_rgbd.simulator.walk import START_NS, image_instants_ns

BRIDGES: Final = ("B1", "B2", "B3", "B4", "B5")
OTHER, RAILING, SOFFIT = 0, 1, 2
"""What a pixel truly shows, as far as it matters here."""

_WARM_UP_S = 9  # the slowest and densest window is full by then
_IMAGE_HZ = 0.5


@dataclass(frozen=True)
class Walk:
    """How one bridge is walked through.

    Attributes:
        bridge: ``B1`` to ``B5``.
        speed_m_s: of the walk.
        points: of a frame.
        drift: recorded poses drift as in the field.
        moving: cars and people move about.
        seconds: length of the walk.
        image_scale: stored size / raw size.
    """

    bridge: str
    speed_m_s: float = 1.0
    points: int = 250_000
    drift: bool = False
    moving: bool = False
    seconds: int = 44
    image_scale: float = 0.6

    @property
    def spec(self) -> ScanSpec:
        """What is simulated: noise, lost pulses and the vendor's pattern as in the field."""
        usual = usual_spec(self.bridge)
        drift = {} if self.drift else {"drift_m_per_root_s": 0.0, "yaw_drift_deg_per_root_s": 0.0}
        return replace(
            usual,
            seconds=float(self.seconds),
            image_rate_hz=_IMAGE_HZ,
            speed_m_s=self.speed_m_s,
            stands_s=0.0,
            moving=int(self.moving),
            **drift,
        )

    @property
    def recipe(self) -> Recipe:
        """``250k-clean`` with this walk's points."""
        recipe = load_recipe("250k-clean", ["select.min_displacement_m=0.0"])
        stage = recipe.visibility or VisibilityStage()
        times = self.points / recipe.accumulate.points
        return replace(
            recipe,
            accumulate=replace(recipe.accumulate, points=self.points),
            image=replace(recipe.image, scale=self.image_scale),
            visibility=replace(stage, points=round(stage.points * times)),
        )


@dataclass(frozen=True)
class Frames:
    """The frames of one walk.

    Attributes:
        depth_m: (F, H, W) float32, before anything is removed; 0 = nothing measured.
        surface_m: (F, H, W) float32, the least depth of the points that may hide others.
        truth_m: (F, H, W) float32, at the image's instant from the true pose; 0 = sky.
        kind: (F, H, W) uint8, what the truth shows: :data:`OTHER`, :data:`RAILING`, ...
        camera: the pinhole of all of them.
    """

    depth_m: NDArray[np.float32]
    surface_m: NDArray[np.float32]
    truth_m: NDArray[np.float32]
    kind: NDArray[np.uint8]
    camera: PinholeCamera


def walked(walk: Walk, cache: Path) -> Frames:
    """Return the frames of a walk, from the cache where it has those of this very code."""
    asked = {"walk": asdict(walk), "spec": walk.spec.text(), "recipe": _drawn(walk.recipe)}
    key = measuring_key(json.dumps(asked, sort_keys=True), _MEASURING)
    path = cache / f"{walk.bridge}-{key}.npz"
    names = ("depth_m", "surface_m", "truth_m", "kind")
    if not path.exists():
        columns = zip(*simulated(walk), strict=True)
        cache.mkdir(parents=True, exist_ok=True)
        scratch = path.with_suffix(".partial.npz")
        np.savez_compressed(scratch, **dict(zip(names, map(np.stack, columns), strict=True)))
        scratch.replace(path)
    with np.load(path) as stored:
        camera = raw_camera(walk.spec.image_scale).pinhole.scaled(walk.image_scale)
        return Frames(*(stored[name] for name in names), camera)


_MEASURING: Final = ("visibility_scenes",)


def _drawn(recipe: Recipe) -> dict[str, object]:
    """What of a recipe decides the stored arrays: how holes are closed does not."""
    stages = recipe_parameters(recipe)
    points = stages["visibility"]["points"], stages["visibility"]["max_age_s"]
    return stages | {"visibility": points}


def warm_frames(maker: FrameMaker) -> Iterator[tuple[PlannedFrame, PointWindow, PointWindow]]:
    """Walk over the frames whose windows are full: each with its points, and those that occlude."""
    window, occluders = maker.windows(), maker.occluders()
    for plan in plan_frames(maker.recording, maker.recipe).frames:
        if occluders is not None and plan.source_index >= _WARM_UP_S * _IMAGE_HZ:
            yield plan, window.at(plan.stamp_ns), occluders.at(plan.stamp_ns)


def simulated(walk: Walk) -> Iterator[tuple[NDArray[np.generic], ...]]:
    """Render the frames of a walk, one after the other."""
    maker = FrameMaker(SimulatedRecording(walk.spec), walk.recipe)
    for plan, inner, outer in warm_frames(maker):
        depth_m, _ = maker.render(plan.T_map_camera, inner)
        surface_m = nearest_surface(
            depth_m,
            outer.beyond(inner),
            T_camera_local=maker.camera_from_local(plan.T_map_camera),
            camera=maker.images.camera,
            limits=maker.recipe.depth,
        )
        yield depth_m, surface_m, *truth_of(walk.spec, plan.source_index, maker.images.camera)


def truth_of(
    spec: ScanSpec, image_index: int, camera: PinholeCamera
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return what the camera truly sees: depth (H, W) float32, and kind (H, W) uint8."""
    T = true_camera_pose(spec, image_index)
    x, y = (plane.ravel() for plane in pinhole_rays(camera))
    rays = np.stack([T[i, 0] * x + T[i, 1] * y + T[i, 2] for i in range(3)], axis=1)
    caster = caster_for(spec)
    instant_s = (int(image_instants_ns(spec)[image_index]) - START_NS) / NS_PER_S
    depth_m, triangles = caster.at(instant_s).distances(T[np.newaxis, :3, 3], rays)
    parts = caster.site.parts[triangles]
    kind = np.select([parts == "railing", parts == "soffit"], [RAILING, SOFFIT], OTHER)
    kind[depth_m == 0] = OTHER
    size = (camera.height_px, camera.width_px)
    return depth_m.reshape(size).astype(np.float32), kind.reshape(size).astype(np.uint8)
