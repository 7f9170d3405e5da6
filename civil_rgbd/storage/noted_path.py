"""A folder on object storage whose objects' versions are noted as they are written: receipts.

Whoever finds the same size and ETag later, in one listing, knows that the object is still the one
that was uploaded, without reading it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from civil_rgbd.storage.client import Version, ask
from civil_rgbd.storage.places import Place
from civil_rgbd.storage.remote_path import RemotePath


@dataclass(frozen=True, slots=True)
class NotedPath(RemotePath):
    """A name on object storage that takes down what is written at it and below it.

    Attributes:
        within: the name from the noted folder on; "" for the folder itself.
        versions: of the objects that were written, by their names from the folder on.
    """

    within: str = ""
    versions: dict[str, Version] = field(default_factory=dict, compare=False)

    def __truediv__(self, inner: object) -> NotedPath:
        within = f"{self.within}/{inner}" if self.within else str(inner)
        return NotedPath(f"{self.url}/{inner}", within=within, versions=self.versions)

    def write_bytes(self, data: bytes) -> int:
        """Write the whole object; as :meth:`RemotePath.write_bytes`."""
        etag: str | None = ask("write", self.url, data)
        # Some clients do not pass on what the storage answered.
        self.versions[self.within] = len(data), etag or self.stat().etag
        return len(data)


def noted(folder: Place) -> tuple[Place, dict[str, Version]]:
    """Return a folder to write into, and what will be noted; of a disk's folder nothing is."""
    if isinstance(folder, RemotePath):
        path = NotedPath(folder.url)
        return path, path.versions
    return folder, {}
