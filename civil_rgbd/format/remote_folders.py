"""Files and folders on object storage that are whole or absent: there the manifest is the rename.

An object appears whole by itself. A folder is whole once it has its last object, which readers look
for; copies are made within the storage, so that what a build made over hours does not travel again.
"""

from __future__ import annotations

from collections.abc import Callable

from civil_rgbd.errors import OutputError
from civil_rgbd.storage.lease import refuse_lost_leases
from civil_rgbd.storage.remote_path import RemotePath, each_at_once


def publish_objects(
    partial: RemotePath, destination: RemotePath, *, replace: bool, last: str
) -> None:
    """Make a finished folder appear by its last object.

    Of an old folder the last object goes first: from then on until the new one comes there is
    none. A kill in between loses nothing: all of the new folder still lies in ``partial``.

    Args:
        partial: the finished folder.
        destination: where it belongs, in the same bucket.
        replace: take the place of an existing folder; without it one is an error.
        last: name of the object that makes a folder whole.

    Raises:
        OutputError: ``destination`` exists, or the lock on it was lost.
        StorageError: the storage cannot be reached, or refuses.
    """
    new, old = partial.files_below(), destination.files_below()
    if last in old and not replace:
        raise OutputError(
            "the folder exists already", where=destination, fix="give --overwrite to replace it"
        )
    refuse_lost_leases()
    if last in old:
        (destination / last).unlink()
    each_at_once((destination / name).unlink for name in old.keys() - new.keys() - {last})
    each_at_once(_copy(partial / name, destination / name) for name in sorted(new.keys() - {last}))
    if destination.files_below() != {n: size for n, size in new.items() if n != last}:
        raise OutputError(
            "another process writes into the folder",
            where=destination,
            fix="see that nothing else writes there, and run the same command again",
        )
    refuse_lost_leases()
    (partial / last).copy_to(destination / last)
    partial.remove_tree()


def _copy(source: RemotePath, target: RemotePath) -> Callable[[], None]:
    return lambda: source.copy_to(target)


def keep_only(partial: RemotePath, wanted: set[str]) -> None:
    """Delete what is not wanted in a folder; see that all that is wanted is there.

    Raises:
        OutputError: something is missing.
        StorageError: the storage cannot be reached, or refuses.
    """
    there = partial.files_below().keys()
    missing = wanted - there
    if missing:
        raise OutputError(
            f"{len(missing)} files of the bridge are missing, the first is {min(missing)}",
            where=partial,
            fix="start the build again; was the folder touched while it was written?",
        )
    each_at_once((partial / name).unlink for name in there - wanted)
