"""A file or folder on object storage, with the methods of :class:`pathlib.Path` that we use.

It holds a name and nothing open, so it can be pickled, and forked or spawned workers can use it.
Object storage has no folders: one "is there" when an object's name begins with its own.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Final
from urllib.parse import unquote, urlsplit

from civil_rgbd.storage.client import ObjectInfo, Version, ask, is_web
from civil_rgbd.storage.range_file import RangeFile

_BUFFER_BYTES: Final = 1 << 14
_AT_ONCE: Final = 16  # requests in flight for copying and deleting: each waits for the network


@dataclass(frozen=True, slots=True)
class RemoteStat:
    """What :meth:`RemotePath.stat` tells.

    Attributes:
        st_size: bytes.
        etag: changes whenever the object is written; None where the server gives none.
        st_mtime_ns: when it was written, by the server's clock, which counts seconds.
    """

    st_size: int
    etag: str | None
    st_mtime_ns: int


@dataclass(frozen=True, slots=True, order=True)
class RemotePath:
    """A name on object storage.

    Attributes:
        url: ``s3://bucket/key``, without a slash at the end.
        pinned: size and ETag that the object must have when it is read; None for any.
    """

    url: str
    pinned: tuple[int, str | None] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "url", self.url if is_web(self.url) else self.url.rstrip("/"))

    def __repr__(self) -> str:
        return f"RemotePath({str(self)!r})"

    def __str__(self) -> str:
        # A signature in a link is as good as a password: it belongs into no message and no log.
        return self.url.partition("?")[0] + ("?..." if is_web(self.url) and "?" in self.url else "")

    def __truediv__(self, inner: object) -> RemotePath:
        return RemotePath(f"{self.url}/{inner}")

    @property
    def protocol(self) -> str:
        """What stands before ``://``."""
        return self.url.partition("://")[0].lower()

    @property
    def name(self) -> str:
        """The last part; of the bucket alone its name."""
        if is_web(self.url):
            return unquote(urlsplit(self.url).path.rstrip("/").rpartition("/")[2])
        return self.url.partition("://")[2].rpartition("/")[2]

    @property
    def suffix(self) -> str:
        """The name's ending, with its dot."""
        stem, dot, ending = self.name.rpartition(".")
        return f"{dot}{ending}" if stem and ending else ""

    @property
    def stem(self) -> str:
        """The name without its ending."""
        return self.name.removesuffix(self.suffix) if self.suffix else self.name

    @property
    def parent(self) -> RemotePath:
        """The folder around it; a bucket is its own."""
        head, slash, _ = self.url.partition("://")[2].rpartition("/")
        return RemotePath(f"{self.protocol}://{head}") if slash else self

    def with_name(self, name: str) -> RemotePath:
        """Return a neighbour."""
        return self.parent / name

    def absolute(self) -> RemotePath:
        """Return itself: a URL is absolute."""
        return self

    def resolve(self) -> RemotePath:
        """Return itself: there are no links."""
        return self

    def stat(self) -> RemoteStat:
        """Ask for size and ETag of an object.

        Raises:
            FileNotFoundError: there is no such object.
            StorageError: the storage cannot be reached, or refuses.
        """
        info: ObjectInfo | None = ask("head", self.url)
        if info is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return RemoteStat(info.size_bytes, info.etag, round(info.modified_s * 1e9))

    def pin(self) -> RemotePath:
        """Return the same name, bound to the object as it is now: reading another is an error.

        Raises:
            FileNotFoundError: there is no such object.
            StorageError: the storage cannot be reached, or refuses.
        """
        stat = self.stat()
        return replace(self, pinned=(stat.st_size, stat.etag))

    def is_file(self) -> bool:
        """Tell whether there is an object of this name."""
        return ask("head", self.url) is not None

    def is_dir(self) -> bool:
        """Tell whether there is an object below this name."""
        return bool(ask("holds_any", self.url))

    def exists(self) -> bool:
        """Tell whether there is an object of this name, or one below it."""
        return self.is_file() or self.is_dir()

    def is_symlink(self) -> bool:
        """Say no: there are no links."""
        return False

    def iterdir(self) -> Iterator[RemotePath]:
        """Yield what lies directly below, by name."""
        for info in ask("list", self.url):
            yield self / info.name

    def glob(self, pattern: str) -> Iterator[RemotePath]:
        """Yield what lies directly below and fits a pattern without folders, by name."""
        return (path for path in self.iterdir() if fnmatchcase(path.name, pattern))

    def files_below(self) -> dict[str, int]:
        """Return the size in bytes of every object below, by its name from here on."""
        return {name: size_bytes for name, (size_bytes, _) in self.versions_below().items()}

    def versions_below(self) -> dict[str, Version]:
        """Return size and ETag of every object below, by its name from here on."""
        found: dict[str, Version] = ask("list_all", self.url)
        return found

    def read_bytes(self) -> bytes:
        """Read the whole object.

        Raises:
            FileNotFoundError: there is no such object.
            StorageError: the storage cannot be reached, or refuses.
        """
        data: bytes | None = ask("read", self.url)
        if data is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return data

    def read_text(self, encoding: str = "utf-8") -> str:
        """Read the whole object as text; errors as :meth:`read_bytes`."""
        return self.read_bytes().decode(encoding)

    def open(self, mode: str = "rb", buffering: int = -1) -> io.BufferedReader:
        """Open the object for reading by ranges.

        Raises:
            FileNotFoundError: there is no such object.
            StorageError: the storage cannot be reached, or refuses.
        """
        if mode != "rb":
            raise ValueError(f"mode {mode!r}: objects are written whole, by write_bytes")
        size_bytes, etag = self.pinned or self.pin().pinned or (0, None)
        raw = RangeFile(self.url, size_bytes, etag)
        return io.BufferedReader(raw, max(buffering, _BUFFER_BYTES))

    def write_bytes(self, data: bytes) -> int:
        """Write the whole object: readers see the old one or the new one, never a part.

        Raises:
            StorageError: the storage cannot be reached, or refuses.
        """
        ask("write", self.url, data)
        return len(data)

    def copy_to(self, target: RemotePath) -> None:
        """Copy the object within the storage; its bytes do not travel.

        Raises:
            StorageError: the storage cannot be reached, or refuses.
        """
        ask("copy", self.url, target.url)

    def unlink(self, *, missing_ok: bool = True) -> None:
        """Delete the object."""
        del missing_ok  # the storage does not say whether there was one
        ask("delete", self.url)

    def mkdir(self, *, parents: bool = False, exist_ok: bool = False) -> None:
        """Do nothing: a folder is there once something is in it."""

    def rmdir(self) -> None:
        """Do nothing: a folder goes with the last thing in it."""

    def remove_tree(self) -> None:
        """Delete every object below."""
        each_at_once((self / name).unlink for name in self.files_below())


def each_at_once(tasks: Iterable[Callable[[], object]]) -> None:
    """Call many functions that each wait for the network; the first error is raised."""
    with ThreadPoolExecutor(max_workers=_AT_ONCE) as pool:
        for future in [pool.submit(task) for task in tasks]:
            future.result()
