"""What a cluster's worker has installed: sent there by value, for it may lack this package."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version


def installed(names: Sequence[str]) -> dict[str, str | None]:
    """Return the versions of packages by name, None for those that are missing, and Python's."""
    found: dict[str, str | None] = {"Python": ".".join(platform.python_version_tuple()[:2])}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found
