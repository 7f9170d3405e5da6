"""``manifest.json``: written last, and the only sign that a bridge folder is whole."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from civil_rgbd.domain.bridge import Counts, Manifest, RecipeRecord, RigRecord, Software
from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.errors import FormatError
from civil_rgbd.format.bridge_info import info_from_document, info_to_document
from civil_rgbd.format.documents import check_document, read_document, write_document
from civil_rgbd.format.intrinsics import pinhole_from
from civil_rgbd.format.versions import Document, current_document
from civil_rgbd.geometry.camera import LensCamera
from civil_rgbd.storage.places import Place

KIND: Final = "manifest"


def read_manifest(path: Place) -> Manifest:
    """Read ``manifest.json``.

    Raises:
        FormatError: the file is missing, damaged, or breaks its schema.
    """
    return manifest_from_document(read_document(path), where=path)


def manifest_from_document(document: Document, *, where: object) -> Manifest:
    """Turn a parsed ``manifest.json`` into a manifest.

    Raises:
        FormatError: it breaks its schema, or describes what cannot be.
    """
    document = current_document(document, kind=KIND, where=where)
    check_document(document, kind=KIND, where=where)
    try:
        return _manifest_from(document, where)
    except (ValueError, OverflowError) as error:
        raise FormatError(
            f"this describes no bridge: {error}",
            where=where,
            fix="mend the value; docs/format.md explains every key",
        ) from error


def _manifest_from(document: Document, where: object) -> Manifest:
    map_up = document["map_up"]
    return Manifest(
        info=info_from_document({**document["bridge"], "contribution": document["contribution"]}),
        origin=document["origin"],
        sources=tuple(SourceFile(**source) for source in document["sources"]),
        software=Software(**document["software"]),
        counts=Counts(**document["counts"]),
        reading=document["reading"],
        rig=_rig_from(document["rig"], where),
        recipe=RecipeRecord(**document["recipe"]) if document["recipe"] else None,
        deskew=document["deskew"],
        salvage=document["salvage"],
        map_up=None if map_up is None else _three(map_up),
        map_origin_m=_three(document["map_origin_m"]),
        quality=document["quality"],
        warnings=tuple(document["warnings"]),
        format_version=document["format_version"],
        data_version=document["data_version"],
    )


def _three(values: list[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _rig_from(rig: Document | None, where: object) -> RigRecord | None:
    if rig is None:
        return None
    camera = rig["camera"]
    return RigRecord(
        camera=LensCamera(
            pinhole=pinhole_from(camera["pinhole"], where=where),
            lens=camera["lens"],
            coefficients=tuple(float(value) for value in camera["coefficients"]),
        ),
        T_lidar_camera=np.array(rig["T_lidar_camera"], dtype=np.float64),
        T_body_lidar=np.array(rig["T_body_lidar"], dtype=np.float64),
        camera_time_offset_s=float(rig["camera_time_offset_s"]),
        body=rig["body"],
        lidar_name=rig["lidar_name"],
        camera_name=rig["camera_name"],
    )


def manifest_to_document(manifest: Manifest) -> Document:
    """Turn a manifest into the document that :func:`manifest_from_document` reads."""
    bridge = info_to_document(manifest.info)
    contribution = bridge.pop("contribution")
    document: Document = _plain(
        {
            "format_version": manifest.format_version,
            "data_version": manifest.data_version,
            "status": "complete",
            "origin": manifest.origin,
            "bridge": bridge,
            "rig": None if manifest.rig is None else _rig_to(manifest.rig),
            "recipe": None if manifest.recipe is None else _recipe_to(manifest.recipe),
            "sources": [_source_to(source) for source in manifest.sources],
            "reading": dict(sorted(manifest.reading.items())),
            "software": _software_to(manifest.software),
            "counts": _counts_to(manifest.counts),
            "deskew": manifest.deskew,
            "salvage": manifest.salvage,
            "map_up": manifest.map_up,
            "map_origin_m": manifest.map_origin_m,
            "quality": manifest.quality,
            "contribution": contribution,
            "warnings": manifest.warnings,
        }
    )
    return document


def quality_channels(manifest: Manifest) -> tuple[str, ...]:
    """Return the names of a bridge's quality planes, in order; () for none."""
    planes: Any = (manifest.quality or {}).get("planes", ())
    return tuple(sorted(plane["channel"] for plane in planes))


def _source_to(source: SourceFile) -> Document:
    document = dataclasses.asdict(source)
    if document["etag"] is None:
        del document["etag"]
    return document


def _recipe_to(recipe: RecipeRecord) -> Document:
    return {
        "name": recipe.name,
        "sha256": recipe.sha256,
        "parameters": recipe.parameters,
        "overrides": recipe.overrides,
    }


def _rig_to(rig: RigRecord) -> Document:
    return {
        "camera": {
            "pinhole": dataclasses.asdict(rig.camera.pinhole),
            "lens": rig.camera.lens,
            "coefficients": rig.camera.coefficients,
        },
        "T_lidar_camera": rig.T_lidar_camera,
        "T_body_lidar": rig.T_body_lidar,
        "camera_time_offset_s": rig.camera_time_offset_s,
        "body": rig.body,
        "lidar_name": rig.lidar_name,
        "camera_name": rig.camera_name,
    }


def _software_to(software: Software) -> Document:
    return {
        "civil_rgbd": software.civil_rgbd,
        "commit": software.commit,
        "python": software.python,
        "packages": dict(sorted(software.packages.items())),
    }


def _counts_to(counts: Counts) -> Document:
    document = dataclasses.asdict(counts)
    if counts.pixels_removed_by_visibility is None:
        del document["pixels_removed_by_visibility"]
    for key, value in document.items():
        if isinstance(value, dict):  # by name: the order of counting must not reach the file
            document[key] = dict(sorted(value.items()))
    return document


def _plain(value: Any) -> Any:  # noqa: ANN401  # JSON
    """Mappings, sequences and numpy's numbers as JSON has them."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def write_manifest(path: Place, manifest: Manifest) -> None:
    """Write ``manifest.json``, whole or not at all.

    Raises:
        FormatError: the manifest breaks its schema; nothing is written.
        OutputError: the file cannot be written.
    """
    write_document(path, manifest_to_document(manifest), kind=KIND)
