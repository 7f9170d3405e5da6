"""The folder of a bridge: where it is made, whether it is whole already, what its manifest says."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace

from civil_rgbd.builder.chunks import BRIDGE, DONE
from civil_rgbd.builder.provenance import reading_record, recipe_record, software
from civil_rgbd.builder.salvage import salvage_before
from civil_rgbd.constants import BRIDGE_ID_PATTERN
from civil_rgbd.domain.bridge import BridgeInfo, Counts, Manifest, rig_record
from civil_rgbd.domain.frame import QUALITY_PLANES
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import BuildError, FormatError, UsageError
from civil_rgbd.format.atomic import whole_file, writing
from civil_rgbd.format.documents import schema_faults
from civil_rgbd.format.layout import BRIDGES, DEFECTS, MANIFEST, PARTIAL, is_bridge
from civil_rgbd.format.manifest import KIND as MANIFEST_KIND
from civil_rgbd.format.manifest import manifest_to_document, read_manifest
from civil_rgbd.pipeline.prepare import local_origin
from civil_rgbd.storage.places import Place, is_remote, remove_tree

IDENTITY = "build.json"
"""Inside the partial folder: what must be equal for the build to be gone on with."""


def require_free_id(dataset: Place, bridge_id: str) -> None:
    """Refuse an id that is none, or that differs from an existing one only in case.

    Raises:
        UsageError: the id does not fit.
    """
    if not re.fullmatch(BRIDGE_ID_PATTERN, bridge_id):
        raise UsageError(
            f"{bridge_id!r} is no bridge id: letters, digits, - and _, at most 64, beginning "
            "with a letter or digit",
            where="--bridge",
            fix="name the bridge: --bridge B3",
        )
    for parent in (dataset / BRIDGES, dataset / PARTIAL):
        for taken in parent.iterdir() if parent.is_dir() else ():
            if taken.name != bridge_id and taken.name.lower() == bridge_id.lower():
                raise UsageError(
                    f"the bridge {bridge_id!r} differs only in case from {taken.name!r}",
                    where=taken,
                    fix=f"take --bridge {taken.name}, or a different name",
                )


def prepare_partial(partial: Place, identity: Mapping[str, object], *, overwrite: bool) -> None:
    """Make the folder of an unfinished build, or find the one that was stopped.

    Args:
        partial: the folder.
        identity: what must be equal for the build to be gone on with.
        overwrite: throw away an unfinished build that differs.

    Raises:
        BuildError: an unfinished build of something else lies there.
        OutputError: the folder cannot be written.
    """
    found = _found_identity(partial)
    if found is not None and found != identity:
        different = ", ".join(key for key in identity if found.get(key) != identity[key])
        if not overwrite:
            raise BuildError(
                f"an unfinished build lies here that was begun otherwise (different: {different})"
                + _other_sources(found.get("sources"), identity.get("sources")),
                where=partial,
                fix="give --overwrite to throw it away, or run its own command to finish it",
            )
        found = None
    with writing(partial):
        if found is None and partial.exists():
            remove_tree(partial)
        for folder in (DONE, BRIDGE):
            (partial / folder).mkdir(parents=True, exist_ok=True)
    if found is None:
        with whole_file(partial / IDENTITY) as scratch:
            scratch.write_text(json.dumps(identity), encoding="utf-8")


def _found_identity(partial: Place) -> dict[str, object] | None:
    try:
        document = json.loads((partial / IDENTITY).read_text("utf-8"))
    except (OSError, ValueError):
        return None  # none, or cut off by a power failure: nothing to go on with
    return document if isinstance(document, dict) else None


def remove_partial(partial: Place) -> None:
    """Take the folder of a finished build away."""
    with writing(partial):
        remove_tree(partial)


def remove_left_over(partial: Place, identity: Mapping[str, object]) -> None:
    """Take away what a kill left of a build whose bridge is there; other builds' work stays."""
    found = _found_identity(partial)
    if found is None or found == identity:
        remove_partial(partial)


def remove_if_empty(folder: Place) -> None:
    """Take a folder away unless something is in it: another build's unfinished work."""
    with contextlib.suppress(OSError):
        folder.rmdir()


def manifest_before(
    recording: Recording, recipe: Recipe, info: BridgeInfo, overrides: Mapping[str, object]
) -> Manifest:
    """Return the manifest of a bridge that is still to be built: all but the counts."""
    notes = recording.notes
    deskew = notes.deskew
    if deskew == "per_point" and not recipe.accumulate.deskew:
        deskew = "off"
    x, y, z = local_origin(recording.trajectory).tolist()
    return Manifest(
        info=info,
        origin="simulated" if notes.simulated else "rendered",
        sources=recording.sources,
        software=software(),
        counts=Counts(images_seen=len(recording.image_stamps_ns), frames_kept=0),
        reading=reading_record(recording),
        rig=rig_record(recording.rig),
        recipe=recipe_record(recipe, overrides),
        deskew=deskew,
        salvage=notes.salvage,
        map_up=notes.map_up,
        map_origin_m=(x, y, z),
        quality=quality_record(recipe),
        warnings=notes.warnings,
    )


def require_fit_for_schema(wanted: Manifest) -> None:
    """Refuse, before any frame is made, a manifest that could not be written in the end.

    Raises:
        BuildError: it breaks its schema; every fault is listed with its JSON path.
    """
    faults = schema_faults(manifest_to_document(wanted), kind=MANIFEST_KIND)
    if faults:
        listing = "".join(f"\n    {path}: {words}" for path, words in faults)
        raise BuildError(
            f"the manifest that this build would write breaks its schema:{listing}",
            where=f"bridge {wanted.info.bridge_id!r}",
            fix="change what is given there: $.recipe is --recipe and --set, $.rig the rig, "
            "$.sources the recording; a value that is right by docs/format.md is a fault of "
            "civil-rgbd: report it",
        )


def quality_record(recipe: Recipe) -> dict[str, object] | None:
    """Return what a manifest says of the quality planes; None where the recipe asks for none."""
    if recipe.quality is None:
        return None
    planes = [(name, *QUALITY_PLANES[name]) for name in recipe.quality.planes]
    return {
        "planes": [
            {"channel": name, "unit": unit, "description": words} for name, unit, words in planes
        ]
    }


def find_whole(folder: Place, wanted: Manifest, *, overwrite: bool) -> Manifest | None:
    """Return the manifest of a bridge that is built already, as wanted.

    Args:
        folder: of the bridge.
        wanted: the manifest that a build would write, but for its counts.
        overwrite: a bridge that differs is built anew.

    Returns:
        None when there is work to do.

    Raises:
        BuildError: a bridge made otherwise lies there.
    """
    if not (is_bridge(folder) if is_remote(folder) else folder.exists()):
        # On object storage a kill may leave files without a manifest, which are nothing yet.
        if is_remote(folder):
            _refuse_to_lose_defects(folder)
        return None
    there: Manifest | None = None
    with contextlib.suppress(FormatError):
        there = read_manifest(folder / MANIFEST)
    if there is not None:
        a, b = (
            manifest_to_document(manifest) for manifest in (as_begun(there, wanted.counts), wanted)
        )
        different = sorted(key for key in {*a, *b} if a.get(key) != b.get(key))
        if not different:
            return there
        what = f"a bridge lies here that was built otherwise (different: {_in_order(different)})"
        what += _other_sources(a.get("sources"), b.get("sources"))
    else:
        what = "a folder lies here that is no whole bridge"
    if overwrite:
        _refuse_to_lose_defects(folder)
        return None
    raise BuildError(
        what,
        where=folder,
        fix="give --overwrite to replace it, or another --bridge or --out",
    )


def as_begun(there: Manifest, counts: Counts) -> Manifest:
    """Return a manifest as it was before its build, which finds out what else is damaged.

    Args:
        there: of a bridge that was built.
        counts: those to take for the build's.
    """
    return replace(there, counts=counts, salvage=salvage_before(there.salvage))


def _other_sources(then: object, now: object) -> str:
    """Say which source is another file than it was; nothing where none is."""
    if not isinstance(then, list) or not isinstance(now, list) or then == now:
        return ""
    before = {source["name"]: source["sha256"] for source in then}
    changed = [
        f"; {source['name']} had sha256 {before[source['name']]}, it has {source['sha256']}"
        for source in now
        if before.get(source["name"], source["sha256"]) != source["sha256"]
    ]
    return "".join(changed)


def _refuse_to_lose_defects(folder: Place) -> None:
    if (folder / DEFECTS).exists():
        raise BuildError(
            "the bridge to be replaced holds measured defects, which a build cannot make again",
            where=folder / DEFECTS,
            fix="move the file away, build with --overwrite, and look whether its pixels still fit",
        )


def _in_order(keys: list[str]) -> str:
    # What people changed on purpose comes first; versions differ as a matter of course.
    return ", ".join(sorted(keys, key=lambda key: (key != "recipe", key != "sources", key)))
