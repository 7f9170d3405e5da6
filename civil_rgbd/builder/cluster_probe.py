"""What a cluster's worker has installed: sent there by value, for it may lack this package."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path

COMMIT = "civil-rgbd of commit"
"""The key of the commit, beside those of the packages."""


def installed(names: Sequence[str]) -> dict[str, str | None]:
    """Return the versions of packages by name, None for those that are missing, and Python's.

    With them goes the commit that civil-rgbd was built from, None where nobody knows.
    """
    found: dict[str, str | None] = {"Python": ".".join(platform.python_version_tuple()[:2])}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    found[COMMIT] = _commit()
    return found


def _commit() -> str | None:
    try:
        place = distribution("civil-rgbd").locate_file("civil_rgbd/source_commit.txt")
        return Path(str(place)).read_text("ascii").strip()
    except (PackageNotFoundError, OSError):
        return None
