"""obstore behind fsspec's face, with conditions, bounded waiting, and the usual credentials."""

from __future__ import annotations

import os
from datetime import timedelta
from typing import Any, Final
from urllib.parse import urlsplit

import obstore
from obstore.exceptions import PreconditionError
from obstore.fsspec import FsspecStore
from obstore.store import from_url

from civil_rgbd.storage.client import WEB, ConditionError
from civil_rgbd.storage.credentials import s3_settings

_RETRIES: Final = {
    "max_retries": 4,
    "retry_timeout": timedelta(seconds=20),
    "backoff": {
        "init_backoff": timedelta(seconds=0.2),
        "max_backoff": timedelta(seconds=3),
        "base": 2,
    },
}
"""A server that does not answer is said so within half a minute."""


class ObstoreFace(FsspecStore):  # type: ignore[misc]  # see pyproject: Any to us
    """What fsspec does not pass on: conditions on reading and writing, and whole listings.

    What we call is no coroutine: obstore's answers of coroutines arrive from threads of its own,
    and a process that ends while one is at it is aborted (signal 6, after all was done).
    """

    cachable = False

    def store_of(self, key: str) -> tuple[Any, str]:
        """Return the store of a key's bucket, and the key within it."""
        if self.protocol in WEB:
            parts = urlsplit(key)
            return self._kept_store(f"{parts.scheme}://{parts.netloc}"), parts.path.lstrip("/")
        bucket, _, inner = key.partition("/")
        return self._kept_store(f"{self.protocol}://{bucket}"), inner

    def _kept_store(self, url: str) -> Any:  # noqa: ANN401  # a class for each provider
        # No lru_cache: fsspec calls two faces equal whose credentials differ.
        stores: dict[str, Any] = self.__dict__.setdefault("_stores", {})
        if url not in stores:
            stores[url] = _store(self.protocol, url)
        return stores[url]

    def _construct_store(self, bucket: str) -> Any:  # noqa: ANN401  # as above
        return self._kept_store(f"{self.protocol}://{bucket}")

    def head(self, key: str) -> dict[str, Any]:
        """Ask for one object, and not whether the name is a folder."""
        store, inner = self.store_of(key)
        if not inner:
            raise FileNotFoundError(key)
        found = obstore.head(store, inner)
        return {**found, "name": found["path"], "type": "file"}

    def holds_any(self, key: str) -> bool:
        """Tell whether any name goes on from here, by one page of the listing."""
        store, inner = self.store_of(key)
        return any(len(page) for page in obstore.list(store, inner or None, chunk_size=1))

    def list_all(self, key: str) -> dict[str, Any]:
        """Return what is said of all objects below, by name with the bucket."""
        store, inner = self.store_of(key)
        bucket = key.partition("/")[0]
        return {
            f"{bucket}/{entry['path']}": entry
            for page in obstore.list(store, inner or None, chunk_size=1000)
            for entry in page
        }

    def cat_file(
        self,
        path: str,
        start: int | None = None,
        end: int | None = None,
        if_match: str | None = None,
        **_more: object,
    ) -> bytes:
        """Read an object, or a range of it, if it has the ETag that is named."""
        store, inner = self.store_of(path)
        options: dict[str, Any] = {"if_match": if_match} if if_match else {}
        if start is not None:
            options["range"] = (start, end)
        try:
            data = obstore.get(store, inner, options=options).bytes()
        except PreconditionError as error:
            raise ConditionError(path) from error
        return bytes(data.to_bytes())

    def pipe_file(
        self,
        path: str,
        value: bytes,
        mode: str = "overwrite",
        if_match: str | None = None,
        **_more: object,
    ) -> str | None:
        """Write an object on a condition; return its ETag."""
        store, inner = self.store_of(path)
        how: Any = {"e_tag": if_match} if if_match else mode
        etag: str | None = obstore.put(store, inner, value, mode=how)["e_tag"]
        return etag

    def ls(self, path: str, *, detail: bool = True, **_more: object) -> list[Any]:
        """List what lies directly below."""
        store, inner = self.store_of(path)
        bucket = path.partition("/")[0]
        page = obstore.list_with_delimiter(store, inner)
        found = [
            {**entry, "name": f"{bucket}/{entry['path']}", "type": "file"}
            for entry in page["objects"]
        ] + [
            {"name": f"{bucket}/{prefix}", "size": 0, "type": "directory"}
            for prefix in page["common_prefixes"]
        ]
        if not found:
            raise FileNotFoundError(path)
        return found if detail else [entry["name"] for entry in found]

    def cp_file(self, path1: str, path2: str, **_more: object) -> None:
        """Copy an object within its bucket."""
        store, inner = self.store_of(path1)
        obstore.copy(store, inner, self.store_of(path2)[1])

    def rm_file(self, path: str) -> None:
        """Delete an object."""
        store, inner = self.store_of(path)
        obstore.delete(store, inner)


def obstore_face(protocol: str) -> ObstoreFace:
    """Return obstore's face for ``s3``, ``gs``, ``az``, ``http`` or ``https``."""
    return ObstoreFace(protocol, skip_instance_cache=True)


def _store(protocol: str, url: str) -> Any:  # noqa: ANN401  # a class for each provider
    client: dict[str, Any] = {"connect_timeout": "5s", "timeout": "120s"}
    more: dict[str, Any] = {}
    if protocol == "s3":
        settings = s3_settings(os.environ)
        client["allow_http"] = (settings.endpoint or "").startswith("http://")
        more = {"config": settings.config, "credential_provider": settings.provider}
    elif protocol == "http":
        client["allow_http"] = True
    more = {key: value for key, value in more.items() if value is not None}
    return from_url(url, client_options=client, retry_config=_RETRIES, **more)
