"""What a dataset or bridge holds, from its documents alone: no image and no table is opened."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from civil_rgbd.format.datasets import UNNAMED, read_dataset
from civil_rgbd.format.intrinsics import read_intrinsics
from civil_rgbd.format.layout import DATASET, INTRINSICS, MANIFEST, PARTIAL, bridge_folders
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.storage.places import Place, files_below, place_of


@dataclass(frozen=True, slots=True)
class BridgeSummary:
    """One bridge in a few words.

    Attributes:
        bridge_id: which.
        name: the bridge's name; None when nobody said it.
        origin: ``rendered``, ``imported`` or ``simulated``.
        recipe: name of the recipe; None when imported.
        changed: recipe keys that were set by hand, as ``key=value``.
        licence: SPDX expression.
        frames: how many.
        images_seen: how many images the source has.
        width_px: columns of an image.
        height_px: rows of an image.
        coverage: mean share of pixels with depth; None when the manifest does not state it.
        size_bytes: of all files.
        sources: names of the files behind it.
        salvage: what was lost of a damaged source; None for a whole one.
        warnings: what was odd.
    """

    bridge_id: str
    name: str | None
    origin: str
    recipe: str | None
    changed: tuple[str, ...]
    licence: str
    frames: int
    images_seen: int
    width_px: int
    height_px: int
    coverage: float | None
    size_bytes: int
    sources: tuple[str, ...]
    salvage: str | None
    warnings: tuple[str, ...]

    def to_lines(self) -> Iterator[str]:
        """Return it for people."""
        title = f" ({self.name})" if self.name else ""
        recipe = ", ".join((self.recipe, *self.changed)) if self.recipe else "none"
        covered = "on a share of pixels that the manifest does not state"
        if self.coverage is not None:
            covered = f"in {self.coverage:.1%} of the pixels"
        yield f"{self.bridge_id}{title}: {self.frames} frames of {self.images_seen} images"
        yield f"  image     {self.width_px} x {self.height_px}, depth {covered}"
        yield f"  recipe    {recipe} ({self.origin})"
        yield f"  source    {', '.join(self.sources) or 'none named'}"
        yield f"  licence   {self.licence}"
        yield f"  size      {_megabytes(self.size_bytes)}"
        if self.salvage:
            yield f"  salvaged  {self.salvage}"
        for warning in self.warnings:
            yield f"  note      {warning}"


@dataclass(frozen=True, slots=True)
class Summary:
    """What lies in one place.

    Attributes:
        location: the folder, as it was given.
        dataset: name of the dataset; None for one bridge, or without ``dataset.json``.
        bridges: every whole bridge.
        splits: names of the splits.
        unfinished: ids of bridges whose build was stopped.
    """

    location: str
    dataset: str | None
    bridges: tuple[BridgeSummary, ...]
    splits: tuple[str, ...]
    unfinished: tuple[str, ...]

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        return {
            **dataclasses.asdict(self),
            "frames": sum(bridge.frames for bridge in self.bridges),
            "size_bytes": sum(bridge.size_bytes for bridge in self.bridges),
        }

    def to_text(self) -> str:
        """Return it for people."""
        frames = sum(bridge.frames for bridge in self.bridges)
        size = _megabytes(sum(bridge.size_bytes for bridge in self.bridges))
        title = f" ({self.dataset})" if self.dataset not in (None, UNNAMED) else ""
        count = f"{len(self.bridges)} bridge{'' if len(self.bridges) == 1 else 's'}"
        lines = [f"{self.location}{title}: {count}, {frames} frames, {size}"]
        for bridge in self.bridges:
            lines += bridge.to_lines()
        if self.splits:
            lines.append(f"splits: {', '.join(self.splits)}")
        lines += [
            f"unfinished: {bridge}; the same build, started again, goes on with it"
            for bridge in self.unfinished
        ]
        return "\n".join(lines)


def summarise(location: str | Place) -> Summary:
    """Say what a dataset or a bridge holds.

    Args:
        location: a dataset folder or one bridge folder.

    Raises:
        FormatError: there is none, or a document is missing or damaged.
    """
    location = place_of(location)
    bridges = tuple(summarise_bridge(folder) for folder in bridge_folders(location).values())
    path, partial = location / DATASET, location / PARTIAL
    dataset = read_dataset(path) if path.is_file() else None
    unfinished = sorted(e.name for e in partial.iterdir() if e.is_dir()) if partial.is_dir() else []
    return Summary(
        location=str(location),
        dataset=dataset.name if dataset else None,
        bridges=bridges,
        splits=tuple(sorted(dataset.splits)) if dataset else (),
        unfinished=tuple(unfinished),
    )


def summarise_bridge(folder: Place) -> BridgeSummary:
    """Say what one bridge holds.

    Raises:
        FormatError: its manifest or its intrinsics are missing or damaged.
    """
    manifest, camera = read_manifest(folder / MANIFEST), read_intrinsics(folder / INTRINSICS)
    recipe = manifest.recipe
    return BridgeSummary(
        bridge_id=manifest.info.bridge_id,
        name=manifest.info.name,
        origin=manifest.origin,
        recipe=recipe.name if recipe else None,
        changed=tuple(f"{k}={v}" for k, v in recipe.overrides.items()) if recipe else (),
        licence=manifest.info.licence,
        frames=manifest.counts.frames_kept,
        images_seen=manifest.counts.images_seen,
        width_px=camera.width_px,
        height_px=camera.height_px,
        coverage=manifest.counts.mean_valid_share,
        size_bytes=sum(files_below(folder).values()),
        sources=tuple(source.name for source in manifest.sources),
        salvage=manifest.salvage,
        warnings=manifest.warnings,
    )


def _megabytes(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:,.1f} MB" if size_bytes >= 100_000 else f"{size_bytes / 1e3:.1f} kB"
