"""A Dask cluster: reached or started, and looked at before anything is sent to it."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import cloudpickle
from distributed import Client, LocalCluster
from tornado.websocket import WebSocketError

from civil_rgbd.builder import cluster_probe
from civil_rgbd.builder.cluster_address import FIX, address_of, refuse_stranger
from civil_rgbd.builder.executor_processes import without_interrupts
from civil_rgbd.builder.originals import Fingerprint, fingerprint
from civil_rgbd.builder.provenance import PIXEL_PACKAGES
from civil_rgbd.errors import BuildError, UsageError
from civil_rgbd.format.atomic import writing
from civil_rgbd.storage.places import Place

_CONNECT_S: Final = 5
_FIRST_WORKER_S: Final = 30


def connect(scheduler: str | None, *, workers: int, stack: ExitStack) -> Client:
    """Reach a running cluster, or start one on this machine.

    Args:
        scheduler: ``tcp://host:port``, or the JSON file that a scheduler wrote; None starts one.
        workers: how many a started one has.
        stack: closes what is opened here.

    Raises:
        UsageError: nobody answers at the address.
        BuildError: the cluster has no workers.
    """
    if scheduler is None:
        # Deaths are counted here, not by the scheduler: it blames neighbours, too.
        with without_interrupts():
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    memory_limit=None,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                    # Without a dashboard there is a server still, at a port that others may have.
                    scheduler_kwargs={"allowed_failures": 0, "dashboard_address": "127.0.0.1:0"},
                )
            )
            return stack.enter_context(Client(cluster))
    stack.enter_context(_without_traces())
    client = stack.enter_context(_client_of(scheduler))
    try:
        client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
    except TimeoutError as error:
        raise BuildError(
            f"the cluster has had no worker for {_FIRST_WORKER_S} s",
            where=scheduler,
            fix="start workers (`dask worker ADDRESS --nthreads 1`), or tell the deployer to: "
            "cluster.scale(8); with cluster.adapt give minimum=1",
        ) from error
    return client


@contextmanager
def _without_traces() -> Iterator[None]:
    """Keep Dask's client from printing traces of a lost connection: we say that it is lost."""
    logger = logging.getLogger("distributed.client")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


def refuse_unreachable(scheduler: str) -> None:
    """Refuse a cluster that does not answer, or whose workers have other packages.

    Raises:
        UsageError: nobody answers at the address.
        BuildError: the cluster has no workers, or their packages differ.
    """
    with ExitStack() as stack:
        _refuse_other_versions(connect(scheduler, workers=0, stack=stack))


def _client_of(scheduler: str) -> Client:
    address = address_of(scheduler)
    refuse_stranger(address, where=scheduler)
    try:
        # Nothing is printed of retries, and nothing is imported from the other side yet.
        return Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError, WebSocketError) as error:
        raise UsageError(
            f"no Dask scheduler answers: {str(error).splitlines()[0]}", where=scheduler, fix=FIX
        ) from error


def refuse_unfit(client: Client, dataset: Place, files: Sequence[Fingerprint]) -> None:
    """Refuse a cluster whose workers would not do the same work on the same data.

    Args:
        client: of the cluster.
        dataset: the dataset folder; its ``.partial`` is there.
        files: what recordings are read from.

    Raises:
        BuildError: a worker lacks a package, has another version, or sees other files.
    """
    _refuse_other_versions(client)
    _refuse_other_files(client, files)
    if isinstance(dataset, Path):  # an object's address is the same everywhere
        _refuse_other_folder(client, dataset)


def _refuse_other_versions(client: Client) -> None:
    names = ["civil-rgbd", *PIXEL_PACKAGES]
    cloudpickle.register_pickle_by_value(cluster_probe)
    try:
        theirs = _ask(client, cluster_probe.installed, names)
    finally:
        cloudpickle.unregister_pickle_by_value(cluster_probe)
    ours = cluster_probe.installed(names)
    faults = [fault for found in theirs.values() for fault in differences(found, ours)]
    _refuse(
        faults,
        theirs,
        "workers have other packages than this machine: the pixels could differ",
        fix="install the same versions there (`pip install civil-rgbd==...`, or one container "
        "image for all), and start the workers again",
    )


def differences(theirs: Mapping[str, str | None], ours: Mapping[str, str | None]) -> list[str]:
    """Say which packages a worker lacks, or has another version of.

    >>> differences({"numpy": None, "numba": "1"}, {"numpy": "2", "numba": "1"})
    ['numpy is missing (here 2)']
    """
    lacking = {cluster_probe.COMMIT: "unknown"}
    return [
        f"{name} {theirs[name] or lacking.get(name, 'is missing')} (here {version})"
        for name, version in ours.items()
        # Where our own commit is not known (an editable install), the manifest claims none.
        if theirs[name] != version and not (name == cluster_probe.COMMIT and version is None)
    ]


def _refuse_other_files(client: Client, files: Sequence[Fingerprint]) -> None:
    faults = [fault for found in _ask(client, unlike, tuple(files)).values() for fault in found]
    _refuse(
        faults,
        client.nthreads(),
        "workers do not see the recordings that this machine sees",
        fix="put the recordings on a file system that all machines mount at the same path",
    )


def unlike(files: Sequence[Fingerprint]) -> list[str]:
    """Say which files look otherwise from here."""
    faults = []
    for expected in files:
        try:
            same = fingerprint(expected.path).same_content(expected)
            reason = "its size or content differs"
        except OSError as error:
            same, reason = False, error.strerror or str(error)
        if not same:
            faults.append(f"{expected.path}: {reason}")
    return faults


def _refuse_other_folder(client: Client, dataset: Path) -> None:
    partial = (dataset / ".partial").absolute()
    note = partial / f".probe-{secrets.token_hex(8)}"
    answer = note.with_name(f"{note.name}.answer")
    try:
        with writing(partial):
            note.write_text(note.name)
        found = _ask(client, answer_note, note, answer)
        faults = [fault for fault in found.values() if fault]
        if not faults and not list(partial.glob(f"{answer.name}.*")):
            faults = [f"{partial} is another folder there"]
    finally:
        for path in partial.glob(f"{note.name}*"):
            path.unlink(missing_ok=True)
    _refuse(
        faults,
        found,
        "workers cannot write to the dataset folder",
        fix="give an --out on a file system that all machines mount at the same path",
    )


def answer_note(note: Path, answer: Path) -> str | None:
    """Read the note that the other machine left, and leave another; say what went wrong."""
    try:
        if note.read_text() != note.name:
            return f"{note.parent} holds something else there"
        answer.with_name(f"{answer.name}.{secrets.token_hex(4)}").write_text("seen")
    except OSError as error:
        return f"{note.parent}: {error.strerror or error}"
    return None


def _ask(client: Client, question: Any, *arguments: object) -> dict[str, Any]:  # noqa: ANN401  # any function
    answers: dict[str, Any] = client.run(question, *arguments)
    return answers


def _refuse(faults: Sequence[str], workers: Iterable[str], what: str, *, fix: str) -> None:
    if not faults:
        return
    different = list(dict.fromkeys(faults))
    raise BuildError(
        f"{what}: {'; '.join(different[:10])}" + ("; ..." if len(different) > 10 else ""),
        where=f"the cluster's workers ({len(list(workers))})",
        fix=fix,
    )
