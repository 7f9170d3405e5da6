"""The demo recording, simulated once and kept in the user's cache."""

from __future__ import annotations

import hashlib
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from civil_rgbd.resources import cache_folder
from civil_rgbd.simulator.recorder import Progress, write_recording
from civil_rgbd.simulator.spec import ScanSpec


def cached_demo_recording(
    spec: ScanSpec | None = None, *, progress: Progress | None = None
) -> Path:
    """Return the demo recording, simulating it when the cache lacks it.

    Args:
        spec: the scan; None is the demo, with its fixed seed.
        progress: called with (images newly done, images in all) while simulating.

    Returns:
        an MCAP file in the user's cache. Its folder goes by a hash of the spec and the simulator,
        so that another release never finds what this one wrote.

    Raises:
        OutputError: the cache cannot be written.
    """
    spec = spec or ScanSpec()
    key = hashlib.sha256(f"{spec.text()}\n{_simulator_sha256()}".encode()).hexdigest()[:16]
    path = cache_folder() / f"simulated-{key}" / f"{spec.bridge}.mcap"
    if not path.exists():
        write_recording(path, spec, overwrite=True, progress=progress)
    return path


def _simulator_sha256() -> str:
    return hashlib.sha256(b"".join(source.read_bytes() for source in _sources())).hexdigest()


def _sources() -> list[Traversable]:
    rooms = (resources.files(__package__), resources.files(__package__) / "sites")
    return [
        entry
        for room in rooms
        for entry in sorted(room.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(".py")
    ]
