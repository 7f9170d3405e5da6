"""The demo recording, simulated once and kept in the user's cache."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Final

from civil_rgbd.simulator.recorder import Progress, write_recording
from civil_rgbd.simulator.spec import ScanSpec

CACHE_VARIABLE: Final = "CIVIL_RGBD_CACHE"
"""Environment variable that names the cache folder, whatever the platform's own."""


def cache_folder(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> Path:
    """Return where things that can be made again are kept.

    >>> cache_folder({"XDG_CACHE_HOME": "/var/cache/me"}, "linux").as_posix()
    '/var/cache/me/civil_rgbd'
    """
    own = environment.get(CACHE_VARIABLE)
    if own:
        return Path(own)
    if platform == "win32":
        local = environment.get("LOCALAPPDATA")
        return (Path(local) if local else Path.home() / "AppData" / "Local") / "civil_rgbd"
    if platform == "darwin":
        return Path.home() / "Library" / "Caches" / "civil_rgbd"
    xdg = environment.get("XDG_CACHE_HOME")
    return (Path(xdg) if xdg else Path.home() / ".cache") / "civil_rgbd"


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
    sources = sorted(
        (entry for entry in resources.files(__package__).iterdir() if entry.name.endswith(".py")),
        key=lambda entry: entry.name,
    )
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
