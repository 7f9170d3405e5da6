"""What a manifest says of a bridge, in rows for people."""

from __future__ import annotations

import json
from collections.abc import Iterator

from civil_rgbd.domain.bridge import BridgeInfo, Contribution, Manifest
from civil_rgbd.geometry.words import extrinsics_in_words, mounting_in_words

_NOT_SAID = "not said"


def statement_rows(manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Yield what people state of the bridge, the sensors and the privacy: (what, words) each."""
    yield from _people(manifest.info)
    yield from _sensors(manifest)


def _people(info: BridgeInfo) -> Iterator[tuple[str, str]]:
    stated = info.contribution or Contribution()
    yield "place", _joined(info.place, info.region or info.country)
    yield "known to", _joined(stated.place_precision, _coordinates(info))
    structure = info.structure
    if structure is not None:
        year = f"built {structure.year_built}" if structure.year_built else None
        length = f"{structure.length_m:g} m long" if structure.length_m else None
        yield "structure", _joined(structure.type, structure.material, year, length, structure.note)
    yield "owner", info.owner or _NOT_SAID
    yield "consent", _joined(stated.consent, info.owner_consent)
    yield "licence", info.licence
    yield "citation", info.citation or _NOT_SAID
    yield "contact", info.contact or _NOT_SAID
    yield "survey", ", ".join(info.survey_dates) or _NOT_SAID
    yield "faces", _joined(stated.faces)
    yield "number plates", _joined(stated.plates)
    yield "privacy", info.privacy or _NOT_SAID
    if info.note:
        yield "note", info.note


def _coordinates(info: BridgeInfo) -> str | None:
    at = info.location
    if at is None:
        return None
    within = "" if at.precision_m is None else f" within {at.precision_m:g} m"
    return f"{at.latitude_deg:g}, {at.longitude_deg:g}{within}"


def _sensors(manifest: Manifest) -> Iterator[tuple[str, str]]:
    stated = manifest.info.contribution or Contribution()
    yield "sensors", manifest.info.sensors or _NOT_SAID
    yield "calibration", _joined(stated.calibration_method, stated.calibration_date)
    yield "calibration report", stated.calibration_report or _NOT_SAID
    rig = manifest.rig
    if rig is None:
        yield "rig", "not recorded: the depth was not rendered here"
        return
    pinhole = rig.camera.pinhole
    yield "LiDAR", rig.lidar_name
    size = f"{pinhole.width_px} x {pinhole.height_px}"
    focal = f"fx {pinhole.fx_px:.1f}, fy {pinhole.fy_px:.1f} px"
    yield "camera", f"{rig.camera_name}: {size}, {focal}, lens {rig.camera.lens}"
    yield "camera in the LiDAR frame", extrinsics_in_words(rig.T_lidar_camera)
    body = f"body of the poses ({rig.body})"
    yield "LiDAR on the body", mounting_in_words(rig.T_body_lidar, what="LiDAR", seen_from=body)
    yield "camera's clock", f"{rig.camera_time_offset_s:+.6f} s to the LiDAR's"


def making_rows(manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Yield how the frames were made: (what, words) each."""
    recipe = manifest.recipe
    if recipe is not None:
        changed = ", ".join(f"{key} = {value}" for key, value in recipe.overrides.items())
        yield "recipe", _joined(recipe.name, f"changed: {changed}" if changed else None)
        for stage, values in recipe.parameters.items():
            yield f"recipe, {stage}", json.dumps(values).strip("{}").replace('"', "")
    yield "points moved by their own time", manifest.deskew or _NOT_SAID
    if manifest.salvage:
        yield "salvaged", manifest.salvage
    for source in manifest.sources:
        words = f"{source.name}, {source.size_bytes:,} bytes, by {source.converter}"
        yield "source", f"{words}\n{source.sha256 or 'its sha256 was not taken'}"
    for how, words in sorted(manifest.reading.items()):
        yield f"read: {how}", words
    yield "made by", f"civil_rgbd {manifest.software.civil_rgbd}"
    for warning in manifest.warnings:
        yield "odd", warning


def _joined(*words: str | None) -> str:
    return ", ".join(word for word in words if word) or _NOT_SAID
