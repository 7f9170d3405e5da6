"""What publishing a bridge needs beside its chunks: known before any is made, and kept on disk."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from civil_rgbd.builder.plan import Plan
from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BuildError, FormatError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.intrinsics import camera_from_document, camera_to_document
from civil_rgbd.format.manifest import manifest_from_document, manifest_to_document
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.pipeline.image import ImageMaker
from civil_rgbd.storage.places import Place

FACTS = "facts.json"
"""Inside the partial folder."""


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A planned bridge, without its recording.

    Attributes:
        manifest: as it will be, but for the counts.
        camera: of every image.
        images_seen: images in the recording.
        images_dropped: images that the plan leaves out, by reason.
        planned: source indices of the plan's frames, ascending.
        scans_seen: LiDAR messages in the recording.
        skipped: things that reading left out, by name.
        pixels_without_source: pixels of every image that the raw one does not have.
    """

    manifest: Manifest
    camera: PinholeCamera
    images_seen: int
    images_dropped: Mapping[str, int]
    planned: tuple[int, ...]
    scans_seen: int
    skipped: Mapping[str, int]
    pixels_without_source: int


def facts_of(wanted: Manifest, plan: Plan, recording: Recording, images: ImageMaker) -> Facts:
    """Gather them.

    Args:
        wanted: the manifest to be, without counts.
        plan: which images become frames.
        recording: what is counted.
        images: knows the stored camera.
    """
    return Facts(
        manifest=wanted,
        camera=images.camera,
        images_seen=plan.images_seen,
        images_dropped=plan.dropped,
        planned=tuple(plan.frames.source_indices.tolist()),
        scans_seen=len(recording.scan_stamps_ns),
        skipped=recording.notes.counts,
        pixels_without_source=images.missing_pixels,
    )


def write_facts(partial: Place, facts: Facts) -> None:
    """Keep them in the folder of an unfinished build.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {
        "manifest": manifest_to_document(facts.manifest),
        "camera": camera_to_document(facts.camera),
        "images_seen": facts.images_seen,
        "images_dropped": dict(facts.images_dropped),
        "planned": list(facts.planned),
        "scans_seen": facts.scans_seen,
        "skipped": dict(facts.skipped),
        "pixels_without_source": facts.pixels_without_source,
    }
    with whole_file(partial / FACTS) as scratch:
        scratch.write_text(json.dumps(document), encoding="utf-8")


def read_facts(partial: Place) -> Facts:
    """Read what :func:`write_facts` kept.

    Raises:
        BuildError: there is nothing to go on with, or it is damaged.
    """
    path = partial / FACTS
    try:
        document: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return Facts(
            manifest=manifest_from_document(document["manifest"], where=path),
            camera=camera_from_document(document["camera"], where=path),
            images_seen=document["images_seen"],
            images_dropped=document["images_dropped"],
            planned=tuple(document["planned"]),
            scans_seen=document["scans_seen"],
            skipped=document["skipped"],
            pixels_without_source=document["pixels_without_source"],
        )
    except (OSError, ValueError, KeyError, TypeError, FormatError) as error:
        raise BuildError(
            f"the plan of this unfinished build cannot be read: {error}",
            where=path,
            fix="run one of its build commands again: each writes the plan",
        ) from error
