"""Prove a bridge from its recording: render some of its frames again, and compare pixel hashes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.builder.bridge import as_begun, manifest_before
from civil_rgbd.builder.executors import use_one_thread
from civil_rgbd.builder.plan import plan_frames
from civil_rgbd.builder.provenance import software
from civil_rgbd.builder.recipes import recipe_from_document, recipe_sha256
from civil_rgbd.domain.bridge import Manifest, Software
from civil_rgbd.domain.frame import FrameRow, RgbdFrame
from civil_rgbd.domain.recipe import ImageStage, Recipe
from civil_rgbd.domain.recording import Recording, SourceFile
from civil_rgbd.errors import BuildError
from civil_rgbd.format.hashes import pixel_sha256
from civil_rgbd.format.images import decode_image, encode_image
from civil_rgbd.format.manifest import manifest_to_document
from civil_rgbd.format.quality_exr import quality_sha256
from civil_rgbd.format.reader import Bridge
from civil_rgbd.geometry.transforms import quaternion_from_matrix
from civil_rgbd.pipeline.frames import FrameMaker, PlannedFrame

_SAME: Final = ("rig", "reading", "deskew", "salvage", "map_origin_m")
"""What of a manifest says how its recording was read."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A frame that came out otherwise.

    Attributes:
        bridge_id: of which bridge.
        frame_id: which.
        of: ``rgb``, ``depth``, ``quality`` or ``frame``.
        what: in words.
        share: of the pixels that differ; None where none could be compared.
        largest: difference of two pixels: levels of a colour, or metres.
    """

    bridge_id: str
    frame_id: str
    of: str
    what: str
    share: float | None = None
    largest: float | None = None


@dataclass(frozen=True, slots=True)
class Rebuilt:
    """What rendering some frames of a bridge again showed.

    Attributes:
        bridge_id: which.
        frames: how many were rendered.
        differences: those that came out otherwise; () proves the others.
        versions: packages that have another version here, ``name: then, now``.
        proved: every source's hash is the manifest's.
    """

    bridge_id: str
    frames: int
    differences: tuple[Difference, ...]
    versions: tuple[str, ...]
    proved: bool

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return dataclasses.asdict(self)


def choose_frames(
    rows: Mapping[str, Sequence[FrameRow]], count: int, *, seed: int
) -> dict[str, list[FrameRow]]:
    """Draw frames of several bridges, each as likely as any other.

    Args:
        rows: of each bridge.
        count: how many; all of them when there are fewer.
        seed: the same seed draws the same.

    Returns:
        by bridge, ascending; bridges of which none was drawn are left out.
    """
    every = [(bridge_id, row) for bridge_id in sorted(rows) for row in rows[bridge_id]]
    generator = np.random.default_rng(seed)
    drawn = generator.choice(len(every), size=min(count, len(every)), replace=False)
    chosen: dict[str, list[FrameRow]] = {}
    for place in sorted(drawn.tolist()):
        bridge_id, row = every[place]
        chosen.setdefault(bridge_id, []).append(row)
    return chosen


def refuse_imported(manifest: Manifest) -> None:
    """Refuse to rebuild what was not rendered here.

    Raises:
        BuildError: the bridge was imported.
    """
    if manifest.recipe is None:
        raise BuildError(
            "the bridge was imported: its frames were rendered by others, and no recipe makes them "
            "again",
            where=manifest.info.bridge_id,
            fix="leave --rebuild out: the hashes of its files are checked all the same",
        )


def rebuild_frames(
    bridge: Bridge,
    recording: Recording,
    rows: Sequence[FrameRow],
    *,
    on_frame: Callable[[], object] = lambda: None,
) -> Rebuilt:
    """Render frames again as the manifest says, and compare them with what is stored.

    Args:
        bridge: a bridge that was rendered.
        recording: opened as the manifest says it was.
        rows: of the frames to render.
        on_frame: called after each.

    Raises:
        BuildError: the bridge was imported, or the recording is another one or read otherwise.
    """
    use_one_thread()
    manifest = bridge.manifest
    recipe = _recipe_of(manifest)
    _refuse_other_recording(manifest, recording, recipe)
    planned = {frame.source_index: frame for frame in plan_frames(recording, recipe).frames}
    maker = FrameMaker(recording, recipe)
    differences: list[Difference] = []
    for row in rows:
        differences += _compare(bridge, row, planned.get(row.source_index), maker)
        on_frame()
    return Rebuilt(
        bridge_id=manifest.info.bridge_id,
        frames=len(rows),
        differences=tuple(differences),
        versions=tuple(_other_versions(manifest.software, software())),
        proved=all(source.sha256 for source in manifest.sources),
    )


def _recipe_of(manifest: Manifest) -> Recipe:
    refuse_imported(manifest)
    record = manifest.recipe
    assert record is not None  # noqa: S101  # an imported bridge was refused
    recipe = recipe_from_document({**record.parameters, "name": record.name}, where="manifest.json")
    if recipe_sha256(recipe) != record.sha256:
        raise BuildError(
            f"the manifest's recipe has sha256 {recipe_sha256(recipe)} here, {record.sha256} there",
            where=manifest.info.bridge_id,
            fix=f"verify with the release that built it: civil-rgbd {manifest.software.civil_rgbd}",
        )
    return recipe


def _refuse_other_recording(manifest: Manifest, recording: Recording, recipe: Recipe) -> None:
    """Refuse a recording whose frames need not be those of the bridge."""
    _refuse_other_sources(manifest, recording.sources)
    now = manifest_to_document(manifest_before(recording, recipe, manifest.info, {}))
    then = manifest_to_document(as_begun(manifest, manifest.counts))
    faults = []
    for key in _SAME:
        if now[key] == then[key]:
            continue
        if isinstance(now[key], dict) and isinstance(then[key], dict):
            faults += [
                f"{key}.{name} was {then[key].get(name)!r}, is {now[key].get(name)!r}"
                for name in sorted({*now[key], *then[key]})
                if now[key].get(name) != then[key].get(name)
            ]
        else:
            faults.append(f"{key} was {then[key]!r}, is {now[key]!r}")
    if faults:
        raise BuildError(
            f"the recording is read otherwise than for the bridge: {'; '.join(faults)}",
            where=manifest.info.bridge_id,
            fix="give the options that the build had (--rig, --trajectory, topics, --pose-of, "
            "...), or --survey with the survey that it was built from",
        )


def _refuse_other_sources(manifest: Manifest, sources: Sequence[SourceFile]) -> None:
    # Where nobody took a hash, the size has to do: such a bridge is not proved.
    unknown = not all(source.sha256 for source in (*manifest.sources, *sources))
    then, now = (
        sorted(("" if unknown else str(source.sha256), source.size_bytes) for source in some)
        for some in (manifest.sources, sources)
    )
    if then != now:
        raise BuildError(
            f"these are not the bridge's sources: the manifest names {_said(manifest.sources)}; "
            f"given are {_said(sources)}",
            where=manifest.info.bridge_id,
            fix="give the very files: --source FILE, and what lay beside them with the options of "
            "the build (--trajectory and the like)",
        )


def _said(sources: Sequence[SourceFile]) -> str:
    return ", ".join(f"{s.name} ({s.size_bytes} bytes, sha256 {s.sha256})" for s in sources)


def _compare(
    bridge: Bridge, row: FrameRow, plan: PlannedFrame | None, maker: FrameMaker
) -> list[Difference]:
    found = Difference(bridge.manifest.info.bridge_id, row.frame_id, "frame", "")
    if plan is None:
        return [replace(found, what="the recipe does not choose this image")]
    if (plan.stamp_ns, plan.source_stamp_ns) != (row.stamp_ns, row.source_stamp_ns):
        what = f"its stamp is {plan.stamp_ns} ns, stored is {row.stamp_ns} ns"
        return [replace(found, what=what)]
    (outcome,) = maker.make([plan])
    frame = outcome.frame
    if frame is None:
        return [replace(found, what=f"it is dropped: {outcome.dropped}")]
    differences = []
    if not _same_pose(frame, row):
        differences.append(replace(found, what="its pose is another one"))
    rgb = _as_stored(frame, maker.recipe.image)
    if pixel_sha256(rgb) != row.rgb_pixel_sha256:
        differences.append(_in_pixels(replace(found, of="rgb"), rgb, bridge.read_rgb(row)))
    if pixel_sha256(frame.depth_m) != row.depth_pixel_sha256:
        stored_m = bridge.read_depth(row)
        differences.append(_in_pixels(replace(found, of="depth"), frame.depth_m, stored_m))
    stored = bridge.read_quality(row)
    if frame.quality and stored and quality_sha256(frame.quality) != row.quality_pixel_sha256:
        planes = [np.stack([of[name] for name in sorted(of)], 2) for of in (frame.quality, stored)]
        differences.append(_in_pixels(replace(found, of="quality"), *planes))
    return differences


def _as_stored(frame: RgbdFrame, stage: ImageStage) -> NDArray[np.uint8]:
    """Return the colours as a reader of the stored file sees them: JPEG changes them."""
    if stage.codec != "jpeg":
        return frame.rgb
    data = encode_image(
        frame.rgb, codec=stage.codec, quality=stage.quality, subsampling=stage.subsampling
    )
    return decode_image(data, where=frame.frame_id)


def _same_pose(frame: RgbdFrame, row: FrameRow) -> bool:
    x, y, z = frame.T_map_camera[:3, 3].tolist()
    quaternion = quaternion_from_matrix(frame.T_map_camera[:3, :3]).tolist()
    return (x, y, z, *quaternion) == (row.tx, row.ty, row.tz, row.qx, row.qy, row.qz, row.qw)


def _in_pixels(
    found: Difference, made: NDArray[np.generic], stored: NDArray[np.generic]
) -> Difference:
    """Say how far two pictures of one frame are apart."""
    a, b = made.astype(np.float64), stored.astype(np.float64)
    apart = np.abs(a - b)
    different = apart.any(axis=2) if apart.ndim == 3 else apart > 0
    share, largest = float(different.mean()), float(apart.max())
    unit = "m" if found.of == "depth" else "levels"
    what = f"{100 * share:.3g} % of the pixels differ, by at most {largest:.6g} {unit}"
    if not share:
        what = "the stored pixels are the same, but the index has another hash of them"
    return replace(found, what=what, share=share, largest=largest)


def _other_versions(then: Software, now: Software) -> list[str]:
    before = {"civil_rgbd": then.civil_rgbd, "python": then.python, **then.packages}
    after = {"civil_rgbd": now.civil_rgbd, "python": now.python, **now.packages}
    return [
        f"{name}: {before.get(name, 'none')} then, {after.get(name, 'none')} now"
        for name in sorted({*before, *after})
        if before.get(name) != after.get(name)
    ]
