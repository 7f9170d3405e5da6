"""What a bridge was made from and with: enough to make it again, nothing about the machine."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import Distribution, PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from civil_rgbd import __version__
from civil_rgbd.builder.recipes import recipe_parameters, recipe_sha256
from civil_rgbd.domain.bridge import Manifest, RecipeRecord, Software
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.format.manifest import manifest_to_document
from civil_rgbd.resources import source_commit

PIXEL_PACKAGES = ("numpy", "numba", "opencv-python-headless", "OpenEXR")
"""The packages whose versions can change a stored pixel or byte."""


def software() -> Software:
    """Return the versions of what makes the frames."""
    return Software(
        civil_rgbd=__version__,
        python=platform.python_version(),
        packages={name: _version(name) for name in PIXEL_PACKAGES},
        commit=_commit(),
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"  # for example opencv-python in the place of opencv-python-headless


def _commit() -> str | None:
    """The commit that was built, as the build wrote it down, else as pip did (PEP 610)."""
    stamped = source_commit()
    if stamped is not None:
        return stamped
    try:
        text = Distribution.from_name("civil-rgbd").read_text("direct_url.json")
    except PackageNotFoundError:
        return None
    commit = json.loads(text).get("vcs_info", {}).get("commit_id") if text else None
    return str(commit) if commit else None


def recipe_record(recipe: Recipe, overrides: Mapping[str, object]) -> RecipeRecord:
    """Return what a manifest keeps of a recipe: every key, and what was set by hand."""
    return RecipeRecord(
        name=recipe.name,
        sha256=recipe_sha256(recipe),
        parameters=recipe_parameters(recipe),
        overrides=overrides,
    )


def reading_record(recording: Recording) -> dict[str, str]:
    """Return how a recording was read, with a hash of the poses: they may come from a file."""
    trajectory = recording.trajectory
    poses = _sha256(trajectory.stamps_ns, trajectory.translations_m, trajectory.quaternions_xyzw)
    return recording.notes.reading | {"poses_sha256": poses}


def build_identity(wanted: Manifest, recording: Recording) -> dict[str, Any]:
    """Return what must be equal for an unfinished build to be gone on with.

    Args:
        wanted: the manifest to be, without counts.
        recording: its stamps count.

    Returns:
        a JSON document, one key a cause, so that a difference can be named.
    """
    document = manifest_to_document(wanted)
    causes = ("recipe", "sources", "reading", "rig", "deskew", "salvage", "software")
    return {cause: document[cause] for cause in causes} | {
        "messages": _sha256(recording.image_stamps_ns, recording.scan_stamps_ns)
    }


def _sha256(*arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
