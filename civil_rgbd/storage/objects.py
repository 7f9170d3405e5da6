"""What we ask of object storage, in the words of fsspec: objects are read, written, listed."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Any

from civil_rgbd.storage.client import WEB, ConditionError, ObjectInfo, Version


class Objects:
    """One protocol's objects.

    Args:
        filesystem: fsspec's face of it. obstore's and s3fs's write on conditions; with any other a
            condition is looked up before, which two writers in the same instant could both pass.
    """

    def __init__(self, filesystem: Any) -> None:  # noqa: ANN401  # fsspec publishes no types
        self._fs = filesystem
        protocol = filesystem.protocol
        self._protocols = {protocol} if isinstance(protocol, str) else set(protocol)
        self._knows_conditions = bool({"s3", "gs", "az"} & self._protocols)
        self._is_obstore = type(filesystem).__module__.startswith("civil_rgbd.")

    def key(self, url: str) -> str:
        """Return the name that fsspec wants: a link whole, else without the protocol."""
        return url if self._protocols & set(WEB) else url.partition("://")[2]

    def head(self, key: str) -> ObjectInfo | None:
        """Return what there is of this name; None when there is no such object."""
        try:
            info = self._fs.head(key) if self._is_obstore else self._fs.info(key)
        except FileNotFoundError:
            return None
        found = _info(info)
        return None if found.is_folder else found

    def holds_any(self, key: str) -> bool:
        """Tell whether there is an object whose name goes on from here."""
        if self._is_obstore:
            return bool(self._fs.holds_any(key))
        return bool(self.list(key))

    def list(self, key: str) -> list[ObjectInfo]:
        """Return what lies directly below, by name."""
        try:
            entries: Iterable[Any] = self._fs.ls(key, detail=True)
        except FileNotFoundError as error:
            if _lacks_bucket(error):
                raise
            return []
        found = [_info(entry) for entry in entries if entry["name"].strip("/") != key.strip("/")]
        return sorted(found, key=lambda info: info.name)

    def list_all(self, key: str) -> dict[str, Version]:
        """Return size and ETag of all objects below, by name from here on."""
        start = len(key.rstrip("/")) + 1
        entries: dict[str, Any]
        entries = self._fs.list_all(key) if self._is_obstore else self._fs.find(key, detail=True)
        found = {name.lstrip("/")[start:]: _info(entries[name]) for name in sorted(entries)}
        return {name: (info.size_bytes, info.etag) for name, info in found.items()}

    def read(
        self, key: str, start: int | None = None, end: int | None = None, etag: str | None = None
    ) -> bytes | None:
        """Return an object's bytes, all or a range; None when it, or one of this ETag, is gone."""
        try:
            if self._is_obstore:
                data: bytes = self._fs.cat_file(key, start=start, end=end, if_match=etag)
            elif start is None:
                data = self._fs.cat_file(key)
            else:
                data = self._fs.cat_file(key, start=start, end=end)
            if etag is not None and not self._is_obstore:
                # No condition on reading: the version is still the one, so it was while we read.
                info = self.head(key)
                return data if info is not None and info.etag == etag else None
        except ConditionError:
            return None
        except FileNotFoundError as error:
            if _lacks_bucket(error):
                raise
            return None
        return data

    def write(
        self, key: str, data: bytes, *, absent: bool = False, etag: str | None = None
    ) -> str | None:
        """Write a whole object.

        Args:
            key: its name.
            data: its bytes.
            absent: only when there is none of this name.
            etag: only when there is one with this ETag.

        Returns:
            its ETag, where the storage says it.

        Raises:
            ConditionError: the condition does not hold.
        """
        options: dict[str, Any] = {}
        if absent or etag is not None:
            if not self._knows_conditions:
                self._look_before(key, absent=absent, etag=etag)
            elif absent:
                options["mode"] = "create"
            else:
                options["if_match" if self._is_obstore else "IfMatch"] = etag
        try:
            answer = self._fs.pipe_file(key, data, **options)
        except Exception as error:
            if options and _is_condition(error):
                raise ConditionError(str(error)) from error
            raise
        if isinstance(answer, str):
            return answer
        info = self.head(key) if absent or etag is not None else None
        return info.etag if info else None

    def write_on(self, key: str, data: bytes, condition: str | None) -> str | None:
        """Write an object that is to be absent (None) or to have an ETag; as :meth:`write`."""
        return self.write(key, data, absent=condition is None, etag=condition)

    def _look_before(self, key: str, *, absent: bool, etag: str | None) -> None:
        there = self.head(key)
        if (there is not None) if absent else (there is None or there.etag != etag):
            raise ConditionError(key)

    def copy(self, key: str, target: str) -> None:
        """Copy an object within the storage."""
        self._fs.cp_file(key, target)

    def delete(self, key: str) -> None:
        """Delete an object; one that is not there is no error."""
        try:
            self._fs.rm_file(key)
        except FileNotFoundError as error:
            if _lacks_bucket(error):
                raise


def _info(info: dict[str, Any]) -> ObjectInfo:
    etag = next((info[key] for key in ("e_tag", "ETag", "etag") if info.get(key)), None)
    modified = info.get("last_modified") or info.get("LastModified") or info.get("created")
    return ObjectInfo(
        name=info.get("name", info.get("path", "")).rstrip("/").rpartition("/")[2],
        size_bytes=int(info.get("size") or 0),
        etag=etag,
        modified_s=modified.timestamp() if isinstance(modified, datetime) else 0.0,
        is_folder=info.get("type") == "directory",
    )


def _lacks_bucket(error: FileNotFoundError) -> bool:
    return "NoSuchBucket" in str(error) or "bucket does not exist" in str(error)


def _is_condition(error: Exception) -> bool:
    names = {kind.__name__ for kind in type(error).__mro__}
    known = {"ConditionError", "AlreadyExistsError", "PreconditionError", "FileExistsError"}
    said = str(error)
    return bool(names & known) or "PreconditionFailed" in said or "pre-conditions" in said
