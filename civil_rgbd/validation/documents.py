"""Are a bridge's documents there, whole, and in agreement with each other?"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

import numpy as np

from civil_rgbd.domain.bridge import UNSTATED_LICENCE, Manifest
from civil_rgbd.domain.defect import DefectRecord
from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.defects import defects_from_document
from civil_rgbd.format.documents import read_document, schema_faults
from civil_rgbd.format.hashes import document_sha256
from civil_rgbd.format.index import read_index
from civil_rgbd.format.intrinsics import camera_from_document
from civil_rgbd.format.layout import DEFECTS, FRAMES, INTRINSICS, MANIFEST, POSES
from civil_rgbd.format.manifest import manifest_from_document
from civil_rgbd.format.poses import FramePoses, poses_from_document
from civil_rgbd.format.versions import FormatVersionWarning, current_document
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.storage.places import Place
from civil_rgbd.validation.report import Finding

_Noun = TypeVar("_Noun")

_INTRINSICS_TOLERANCE_PX: Final = 1e-6
_MEAN_TOLERANCE: Final = 1e-4  # the mean of float32 shares, however it was summed

_MACHINE: Final = re.compile(
    r"""(?:^|[\s"'=(\[,;:])(?:
      file://\S
      | ~[\w-]*[/\\]
      | /(?:home|Users|root|tmp|var|mnt|media|opt|srv|usr|private|Volumes)/
      | (?:/[\w.@+-]+)+\.(?:mcap|bag|db3|toml|yaml|yml|json|parquet|exr|jpg|png|csv|txt|py)\b
      | [A-Za-z]:[\\/][^/\\]
      | \\\\[\w.-]+\\
      | https?://(?:localhost|127\.|\[::1\])
      | [\w.-]+@[\w.-]+:[/~\w]
    )""",
    re.VERBOSE,
)
"""Absolute paths and hosts. A topic such as /livox/lidar, an address and a URL are none."""


@dataclass(slots=True)
class BridgeDocuments:
    """What could be read of a bridge; None where a document is missing or damaged."""

    manifest: Manifest | None = None
    camera: PinholeCamera | None = None
    poses: FramePoses | None = None
    rows: tuple[FrameRow, ...] | None = None
    defects: tuple[DefectRecord, ...] = ()
    findings: list[Finding] = field(default_factory=list)


def read_documents(folder: Place, bridge: str) -> BridgeDocuments:
    """Read all documents of a bridge as far as they go.

    Args:
        folder: the bridge folder.
        bridge: its name in findings.

    Returns:
        what was read, and what is wrong with each document by itself.
    """
    read = BridgeDocuments()
    found = read.findings
    read.manifest = load(folder / MANIFEST, "manifest", manifest_from_document, bridge, found)
    read.camera = load(folder / INTRINSICS, "intrinsics", camera_from_document, bridge, found)
    read.poses = load(folder / POSES, "poses", poses_from_document, bridge, found)
    if (folder / DEFECTS).exists():
        defects = load(folder / DEFECTS, "defects", defects_from_document, bridge, found)
        read.defects = defects or ()
    read.rows = _load_index(folder / FRAMES, bridge, found)
    return read


def load(
    path: Place,
    kind: str,
    from_document: Callable[..., _Noun],
    bridge: str | None,
    found: list[Finding],
) -> _Noun | None:
    """Read one JSON document with its full schema; None when it cannot be used.

    Args:
        path: the file.
        kind: its schema.
        from_document: makes the noun of a parsed document.
        bridge: the bridge's name; None for the dataset's document.
        found: what is wrong is added here.
    """

    def add(code: str, message: str) -> None:
        found.append(Finding(code, message, path.name, bridge))

    try:
        document = read_document(path)
    except FormatError as error:
        missing = "manifest-missing" if kind == "manifest" else "document-missing"
        add("document-unreadable" if path.exists() else missing, error.what)
        return None
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FormatVersionWarning)
            document = current_document(document, kind=kind, where=path.name)
    except FormatError as error:
        add("version-unsupported", error.what)
        return None
    for warning in caught:
        add("version-newer", str(warning.message))
    for text in _strings(document):
        if _MACHINE.search(text):
            add("machine-path", f"{text!r} speaks of one machine")
    faults = schema_faults(document, kind=kind)
    for place, words in faults:
        add("document-schema", f"{place}: {words}")
    try:
        return None if faults else from_document(document, where=path.name)
    except FormatError as error:
        add("document-value", error.what)
        return None


def _strings(value: Any) -> Iterator[str]:  # noqa: ANN401  # JSON
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield key
            yield from _strings(item)
    elif isinstance(value, list):
        for item in value:
            yield from _strings(item)


def _load_index(path: Place, bridge: str, found: list[Finding]) -> tuple[FrameRow, ...] | None:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FormatVersionWarning)
            rows = read_index(path)
    except FormatError as error:
        code = "index-unreadable" if path.exists() else "document-missing"
        found.append(Finding(code, error.what, path.name, bridge))
        return None
    found += [Finding("version-newer", str(w.message), path.name, bridge) for w in caught]
    return rows


def check_manifest(read: BridgeDocuments, bridge: str, *, in_dataset: bool) -> Iterator[Finding]:
    """Does the manifest fit the folder, its own hash, and the frames that are there?

    Args:
        read: the bridge's documents.
        bridge: the folder's name.
        in_dataset: the folder lies in a dataset, so that its name is its id.
    """
    manifest = read.manifest
    if manifest is None:
        return
    info = manifest.info

    def finding(code: str, message: str) -> Finding:
        return Finding(code, message, MANIFEST, bridge)

    if in_dataset and info.bridge_id != bridge:
        yield finding("bridge-id-mismatch", f"bridge_id is {info.bridge_id!r}")
    if info.licence == UNSTATED_LICENCE:
        yield finding("licence-unstated", f"the licence is {info.licence}")
    if manifest.recipe is not None:
        digest = document_sha256(manifest.recipe.parameters)
        if digest != manifest.recipe.sha256:
            yield finding("recipe-hash", f"is {manifest.recipe.sha256}, should be {digest}")
        for place, words in schema_faults(dict(manifest.recipe.parameters), kind="recipe"):
            yield finding("document-schema", f"$.recipe.parameters{place[1:]}: {words}")
    for message in _count_faults(manifest, read.rows):
        yield finding("counts-mismatch", message)


def _count_faults(manifest: Manifest, rows: tuple[FrameRow, ...] | None) -> Iterator[str]:
    counts = manifest.counts
    total = counts.frames_kept + sum(counts.dropped.values())
    if total != counts.images_seen:
        yield (
            f"{counts.frames_kept} kept and {total - counts.frames_kept} dropped are not the "
            f"{counts.images_seen} images seen"
        )
    if rows is None:
        return
    if len(rows) != counts.frames_kept:
        yield f"frames_kept is {counts.frames_kept}, {FRAMES} has {len(rows)} rows"
    if rows and counts.mean_valid_share is not None:
        mean = float(np.mean([row.valid_share for row in rows]))
        if not abs(mean - counts.mean_valid_share) <= _MEAN_TOLERANCE:
            yield f"mean_valid_share is {counts.mean_valid_share:.6f}, of the rows {mean:.6f}"


def check_intrinsics(read: BridgeDocuments, bridge: str) -> Iterator[Finding]:
    """Does the stored camera fit its own image, and the rig's camera at the recipe's scale?"""
    camera = read.camera
    if camera is None:
        return
    inside = (
        -0.5 <= camera.cx_px <= camera.width_px - 0.5
        and -0.5 <= camera.cy_px <= camera.height_px - 0.5
    )
    if not inside:
        message = (
            f"the principal point ({camera.cx_px:.3f}, {camera.cy_px:.3f}) lies outside the "
            f"{camera.width_px} x {camera.height_px} image"
        )
        yield Finding("intrinsics-principal-point", message, INTRINSICS, bridge)
    scale = recipe_value(read.manifest, "image", "scale")
    if read.manifest is None or read.manifest.rig is None or scale is None:
        return
    expected = read.manifest.rig.camera.pinhole.scaled(scale)
    if _distance_px(camera, expected) > _INTRINSICS_TOLERANCE_PX:
        message = f"is {camera}, the rig's camera at scale {scale} is {expected}"
        yield Finding("intrinsics-recipe", message, INTRINSICS, bridge)


def _distance_px(a: PinholeCamera, b: PinholeCamera) -> float:
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    return max(abs(float(getattr(a, name)) - float(getattr(b, name))) for name in names)


def recipe_value(manifest: Manifest | None, stage: str, key: str) -> float | None:
    """Return a number of the recipe; None for an imported bridge, or where there is none."""
    if manifest is None or manifest.recipe is None:
        return None
    values: Any = manifest.recipe.parameters.get(stage)
    value: Any = values.get(key) if isinstance(values, dict) else None
    return float(value) if type(value) in (int, float) else None  # True is an int, too


def check_defects(read: BridgeDocuments, bridge: str) -> Iterator[Finding]:
    """Do the defects name frames of this bridge, each with an id of its own?"""
    frames = {row.frame_id for row in read.rows or ()}
    seen: set[str] = set()
    for defect in read.defects:
        if read.rows is not None and defect.frame_id not in frames:
            message = f"defect {defect.defect_id} is marked in frame {defect.frame_id}"
            yield Finding("defect-frame-unknown", message, DEFECTS, bridge)
        if defect.defect_id in seen:
            yield Finding("defect-duplicate", f"id {defect.defect_id}", DEFECTS, bridge)
        seen.add(defect.defect_id)
