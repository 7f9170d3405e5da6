"""Downloads that break off go on; what is not what was promised is not kept."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from civil_rgbd.contribution import fetch
from civil_rgbd.contribution.fetch import fetch_archive, fetch_text
from civil_rgbd.errors import DownloadError

from .server import Shelf, serving

DATA = bytes(range(256)) * 4000
SHA256 = hashlib.sha256(DATA).hexdigest()


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch, "_PAUSE_S", 0.0)


@pytest.fixture
def shelf() -> Shelf:
    return Shelf({"/a.tar": DATA})


@pytest.fixture
def address(shelf: Shelf) -> Iterator[str]:
    with serving(shelf) as address:
        yield address


def fetched(address: str, folder: Path, *, sha256: str = SHA256, size: int = len(DATA)) -> Path:
    return fetch_archive(f"{address}/a.tar", folder, name="a.tar", sha256=sha256, size_bytes=size)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_file_arrives(address: str, tmp_path: Path) -> None:
    assert fetched(address, tmp_path).read_bytes() == DATA
    assert names(tmp_path) == {"a.tar"}


def test_a_download_that_breaks_off_goes_on_where_it_was(
    shelf: Shelf, address: str, tmp_path: Path
) -> None:
    shelf.cut_after = [300_000, 300_000]

    assert fetched(address, tmp_path).read_bytes() == DATA
    starts = [int(asked.removeprefix("bytes=").rstrip("-")) for asked in shelf.asked[1:] if asked]
    assert shelf.asked[0] is None
    assert len(starts) == 2
    assert 0 < starts[0] < starts[1] < len(DATA)


def test_the_next_run_goes_on_with_what_the_last_one_left(
    shelf: Shelf, address: str, tmp_path: Path
) -> None:
    (tmp_path / "a.tar.part").write_bytes(DATA[:600_000])

    assert fetched(address, tmp_path).read_bytes() == DATA
    assert shelf.asked == ["bytes=600000-"]


def test_a_whole_part_needs_no_server(tmp_path: Path) -> None:
    (tmp_path / "a.tar.part").write_bytes(DATA)

    assert fetched("http://127.0.0.1:9", tmp_path).read_bytes() == DATA


def test_a_server_without_ranges_is_asked_from_the_beginning(
    shelf: Shelf, address: str, tmp_path: Path
) -> None:
    shelf.ranges = False
    (tmp_path / "a.tar.part").write_bytes(b"other bytes")

    assert fetched(address, tmp_path).read_bytes() == DATA


@pytest.mark.parametrize("left", [b"wrong" * 1000, b"x" * len(DATA), b"x" * (len(DATA) + 1)])
def test_a_spoilt_part_is_thrown_away_and_fetched_anew(
    address: str, tmp_path: Path, left: bytes
) -> None:
    (tmp_path / "a.tar.part").write_bytes(left)

    assert fetched(address, tmp_path).read_bytes() == DATA


def test_another_hash_is_refused_and_nothing_is_kept(address: str, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="another SHA-256 than the registry says"):
        fetched(address, tmp_path, sha256="0" * 64)

    assert names(tmp_path) == set()


@pytest.mark.parametrize("size", [len(DATA) - 1, len(DATA) + 1, 10 * len(DATA)])
@pytest.mark.parametrize("claims_length", [True, False])
def test_another_size_is_refused(
    shelf: Shelf, address: str, tmp_path: Path, size: int, *, claims_length: bool
) -> None:
    shelf.claims_length = claims_length

    with pytest.raises(DownloadError, match=r"the server has|broke off"):
        fetched(address, tmp_path, size=size)

    assert "a.tar" not in names(tmp_path)


def test_a_server_that_never_stops_is_stopped(shelf: Shelf, address: str, tmp_path: Path) -> None:
    shelf.files["/a.tar"], shelf.claims_length = bytes(20_000_000), False
    told: list[int] = []

    with pytest.raises(DownloadError, match="longer than that"):
        fetch_archive(
            f"{address}/a.tar",
            tmp_path,
            name="a.tar",
            sha256=SHA256,
            size_bytes=1000,
            progress=lambda here, _: told.append(here),
        )

    assert max(told) < 100_000
    assert names(tmp_path) == set()


def test_a_busy_server_is_asked_again(shelf: Shelf, address: str, tmp_path: Path) -> None:
    shelf.statuses = [503, 429]

    assert fetched(address, tmp_path).read_bytes() == DATA


def test_a_server_that_stays_busy_is_given_up(shelf: Shelf, address: str, tmp_path: Path) -> None:
    shelf.statuses = [503] * 9

    with pytest.raises(DownloadError, match="the server answers 503"):
        fetched(address, tmp_path)

    assert len(shelf.asked) == 3


def test_a_file_that_is_gone_is_not_asked_for_again(
    shelf: Shelf, address: str, tmp_path: Path
) -> None:
    del shelf.files["/a.tar"]

    with pytest.raises(DownloadError, match="the server answers 404") as caught:
        fetched(address, tmp_path)

    assert "has the archive moved" in caught.value.fix
    assert len(shelf.asked) == 1


def test_without_a_network_the_message_says_so(tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match=r"no answer from the server: .*refused") as caught:
        fetched("http://127.0.0.1:9", tmp_path)

    assert "goes on where it stopped" in caught.value.fix


def test_what_is_here_survives_a_network_that_fails(
    shelf: Shelf, address: str, tmp_path: Path
) -> None:
    shelf.cut_after = [300_000, 0, 0, 0]

    with pytest.raises(DownloadError, match=r"no answer|broke off"):
        fetched(address, tmp_path)

    assert fetched(address, tmp_path).read_bytes() == DATA
    assert shelf.asked[-1] not in {None, "bytes=0-"}


def test_progress_ends_at_the_whole(address: str, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []

    fetch_archive(
        f"{address}/a.tar",
        tmp_path,
        name="a.tar",
        sha256=SHA256,
        size_bytes=len(DATA),
        progress=lambda here, total: told.append((here, total)),
    )

    assert told[-1] == (len(DATA), len(DATA))
    assert told == sorted(told)


def test_a_registry_is_fetched_and_no_more_than_a_registry(
    shelf: Shelf, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shelf.files |= {"/r.json": b"{}", "/latin": "Brücke".encode("latin-1")}
    monkeypatch.setattr(fetch, "MAX_REGISTRY_BYTES", 100_000)

    assert fetch_text(f"{address}/r.json") == "{}"
    with pytest.raises(DownloadError, match="more than 100,000 bytes"):
        fetch_text(f"{address}/a.tar")
    with pytest.raises(DownloadError, match="is not UTF-8"):
        fetch_text(f"{address}/latin")
