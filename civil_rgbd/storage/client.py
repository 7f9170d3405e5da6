"""The one door to object storage: every request goes through :func:`ask`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from civil_rgbd.errors import MissingExtraError, UsageError
from civil_rgbd.storage.refusals import refusal

WEB: Final = ("http", "https")
"""Protocols that only read."""

_OBSTORE: Final = {"s3": "s3", "gs": "gs", "gcs": "gs", "az": "az", "abfs": "az"}
SETTINGS: Final = ("AWS_", "GOOGLE_", "AZURE_")
"""How the variables begin that say who we are to a storage, and where it is."""


@dataclass(frozen=True, slots=True)
class ObjectInfo:
    """What the storage says of an object, or of names that begin alike.

    Attributes:
        name: the last part of its name.
        size_bytes: its length; 0 for a folder.
        etag: changes whenever it is written; None where the server gives none.
        modified_s: when it was written, seconds since the Unix epoch by the server's clock.
        is_folder: it stands for names that begin alike.
    """

    name: str
    size_bytes: int
    etag: str | None
    modified_s: float
    is_folder: bool = False


Version = tuple[int, str | None]
"""Size in bytes and ETag of an object: another one has written it when they differ."""


class ConditionError(Exception):
    """An object was to be written on a condition that does not hold."""


def is_web(url: str) -> bool:
    """Tell whether a URL is an ordinary link: it only reads, and may have a query."""
    return url.partition("://")[0].lower() in WEB


def shown(url: str) -> str:
    """Return a URL for messages: a link's query may be a signature."""
    return url.partition("?")[0] if is_web(url) else url


def ask(verb: str, url: str, *arguments: object) -> Any:  # noqa: ANN401  # each verb has its own answer
    """Ask the storage for something, in this process or, after a fork, by a helper process.

    Args:
        verb: a method of :class:`civil_rgbd.storage.objects.Objects`.
        url: of the object.
        arguments: the rest, as the verb takes it.

    Raises:
        StorageError: the storage cannot be reached, or refuses.
        MissingExtraError: what speaks this protocol is not installed.
        ConditionError: the condition of a write does not hold.
    """
    from civil_rgbd.storage import relay

    if relay.is_needed():
        return relay.ask(verb, url, arguments)
    return perform(verb, url, arguments)


def perform(verb: str, url: str, arguments: tuple[object, ...]) -> Any:  # noqa: ANN401  # as ask
    """Do in this process what :func:`ask` asks for."""
    protocol = url.partition("://")[0].lower()
    settings = tuple(sorted((k, v) for k, v in os.environ.items() if k.startswith(SETTINGS)))
    objects = _objects_of(protocol + "?" * ("?" in url), os.getpid(), settings)
    method: Callable[..., Any] = getattr(objects, verb)
    try:
        return method(objects.key(url), *(_key(objects, argument) for argument in arguments))
    except ConditionError:
        raise
    except Exception as error:
        said = refusal(error, where=shown(url), writing=verb in {"write", "copy", "delete"})
        if said is error:
            raise
        raise said from error


def _key(objects: Any, argument: object) -> object:  # noqa: ANN401  # Objects, imported late
    return objects.key(argument) if isinstance(argument, str) and "://" in argument else argument


@lru_cache(maxsize=32)
def _objects_of(kind: str, process: int, settings: tuple[tuple[str, str], ...]) -> Any:  # noqa: ANN401  # Objects, imported late
    """Connect, once a process and once for each set of credentials.

    ``kind`` is the protocol; ``https?`` when the URL has a query, which obstore would drop.
    """
    del process, settings
    from civil_rgbd.storage.objects import Objects

    protocol = kind.removesuffix("?")
    if protocol in _OBSTORE or kind in WEB:
        try:
            from civil_rgbd.storage.obstore_face import obstore_face
        except ImportError:
            pass  # other packages may speak it
        else:
            from civil_rgbd.storage import relay

            relay.note_threads()
            return Objects(obstore_face(_OBSTORE.get(protocol, protocol)))
    return Objects(_by_fsspec(protocol))


def _by_fsspec(protocol: str) -> Any:  # noqa: ANN401  # fsspec publishes no types
    try:
        import fsspec

        return fsspec.filesystem(protocol, use_listings_cache=False, skip_instance_cache=True)
    except ImportError as error:
        package = "aiohttp" if protocol in WEB else "civil-rgbd[s3]"
        raise MissingExtraError(
            f"{protocol}:// is read by a package that is not installed",
            where=f"{protocol}://",
            fix=f'pip install "{package}"',
        ) from error
    except ValueError as error:
        raise UsageError(
            f"nothing here speaks {protocol}://",
            where=f"{protocol}://",
            fix="give a path, s3://BUCKET/KEY, gs://, az://, or https:// for a recording",
        ) from error
