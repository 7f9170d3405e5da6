"""What a taken-over bridge was made from."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.format.hashes import file_sha256
from civil_rgbd.importers.rendered_set import RenderedSet


def set_source(opened: RenderedSet) -> SourceFile:
    """Return the one entry that stands for all files of a set.

    Its hash is that of a list, one line a file, sorted by name: ``<sha256>  <name>``, as
    ``sha256sum`` prints it. So `sha256sum FILES | LC_ALL=C sort -k 2 | sha256sum` gives it again. A
    line an image would make a manifest of thousands.

    Args:
        opened: the set; the files are those it was read from, named from its root with forward
            slashes; files from elsewhere by their bare name.
    """
    files = {_name(path, opened.root): path for path in opened.files}
    lines = [f"{file_sha256(path)}  {name}\n" for name, path in sorted(files.items())]
    return SourceFile(
        name=opened.root.resolve().name or "set",
        size_bytes=sum(path.stat().st_size for path in files.values()),
        sha256=hashlib.sha256("".join(lines).encode("utf-8")).hexdigest(),
        converter=opened.importer,
    )


def _name(path: Path, root: Path) -> str:
    relative = os.path.relpath(path.resolve(), root.resolve()) if path.is_relative_to(root) else ""
    return relative.replace(os.sep, "/") if relative and ".." not in relative else path.name
