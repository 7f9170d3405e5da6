"""What a manifest says was lost: what is known before a build, and what the build finds besides."""

from __future__ import annotations

import re
from typing import Final

_FOUND: Final = re.compile(
    r"(^|; )\d+ scans? of the \d+ that were read are damaged inside and left out$"
)


def salvage_after(said: str | None, *, unreadable: int, read: int) -> str | None:
    """Add to what the recording lost as a whole the messages that turned out to be damaged.

    Args:
        said: of the recording, before the build.
        unreadable: how many scans turned out to be damaged inside.
        read: how many scans the build read.

    >>> salvage_after("the file is cut", unreadable=1, read=60)
    'the file is cut; 1 scan of the 60 that were read are damaged inside and left out'
    """
    if not unreadable:
        return said
    scans = "1 scan" if unreadable == 1 else f"{unreadable} scans"
    left_out = f"{scans} of the {read} that were read are damaged inside and left out"
    return f"{said}; {left_out}" if said else left_out


def salvage_before(said: str | None) -> str | None:
    """Return what :func:`salvage_after` was given: only the build knows what it added.

    >>> salvage_before(salvage_after("the file is cut", unreadable=2, read=60))
    'the file is cut'
    >>> salvage_before(salvage_after(None, unreadable=1, read=60)) is None
    True
    """
    return _FOUND.sub("", said) or None if said else None
