"""From a server to a dataset: whole, as the registry says, or not at all."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from civil_rgbd.contribution import fetch
from civil_rgbd.contribution.archive import write_archive
from civil_rgbd.contribution.download import download_bridge
from civil_rgbd.contribution.registry import RegistryEntry, registry_to_document
from civil_rgbd.errors import DownloadError, FormatError, OutputError, UsageError
from civil_rgbd.format.atomic import folder_lock
from civil_rgbd.format.datasets import read_dataset
from civil_rgbd.validation import validate

from .server import Shelf, serving
from .test_scaffold import contents


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch, "_PAUSE_S", 0.0)


@dataclasses.dataclass
class Shop:
    """A registry, and the server that it points to."""

    shelf: Shelf
    address: str
    registry: Path

    def offer(self, data: bytes, **changes: object) -> None:
        entry = RegistryEntry(
            id="B1",
            version="1.0",
            where=f"{self.address}/B1.tar",
            sha256=hashlib.sha256(data).hexdigest(),
            size_bytes=len(data),
            licence="CC-BY-4.0",
        )
        entry = dataclasses.replace(entry, **changes)  # type: ignore[arg-type]
        self.shelf.files["/B1.tar"] = data
        self.registry.write_text(json.dumps(registry_to_document((entry,))))
        self.shelf.files["/bridges.json"] = self.registry.read_bytes()


@pytest.fixture
def packed(bridge: Path, tmp_path: Path) -> bytes:
    write_archive(bridge, "B1", tmp_path / "packed.tar")
    return (tmp_path / "packed.tar").read_bytes()


@pytest.fixture
def shop(packed: bytes, tmp_path: Path) -> Iterator[Shop]:
    shelf = Shelf()
    with serving(shelf) as address:
        shop = Shop(shelf, address, tmp_path / "bridges.json")
        shop.offer(packed)
        yield shop


def assert_nothing_is_there(dataset: Path) -> None:
    assert not list(dataset.rglob("manifest.json"))
    assert not (dataset / "dataset.json").exists()
    assert not list(dataset.rglob("*.tar"))
    assert not list(dataset.rglob("*.unpacked"))


def test_a_bridge_arrives_as_it_was_packed(shop: Shop, bridge: Path, tmp_path: Path) -> None:
    done = download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert done.folder == tmp_path / "data/bridges/B1"
    assert contents(done.folder) == contents(bridge)
    assert read_dataset(tmp_path / "data/dataset.json").bridges == ("B1",)
    assert {path.name for path in (tmp_path / "data").iterdir()} == {"bridges", "dataset.json"}
    assert validate(tmp_path / "data").findings == ()


def test_the_registry_may_lie_on_a_server(shop: Shop, tmp_path: Path) -> None:
    done = download_bridge("B1", tmp_path / "data", registry=f"{shop.address}/bridges.json")

    assert done.report.frames == 3


def test_a_download_that_was_stopped_is_gone_on_with(
    shop: Shop, packed: bytes, tmp_path: Path
) -> None:
    half = len(packed) // 2
    shop.shelf.cut_after = [half, 0, 0, 0]
    with pytest.raises(DownloadError, match=r"no answer|broke off"):
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))
    (part,) = (tmp_path / "data/.partial").glob("*.part")
    kept = part.stat().st_size

    download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert 0 < kept <= half
    assert shop.shelf.asked[-1] == f"bytes={kept}-"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sha256": "0" * 64}, "another SHA-256"),
        ({"size_bytes": 512}, "the registry says 512 bytes"),
        ({"version": "2.0"}, "the manifest says"),
        ({"licence": "MIT"}, "the manifest says"),
        ({"id": "B2"}, "no file of the bridge 'B2'"),
    ],
)
def test_what_is_not_what_the_registry_says_does_not_get_in(
    shop: Shop, packed: bytes, tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    shop.offer(packed, **changes)
    wanted = str(changes.get("id", "B1"))

    with pytest.raises((DownloadError, FormatError), match=words):
        download_bridge(wanted, tmp_path / "data", registry=str(shop.registry))

    assert_nothing_is_there(tmp_path / "data")


def test_a_truncated_archive_does_not_get_in(shop: Shop, packed: bytes, tmp_path: Path) -> None:
    shop.offer(packed[: len(packed) // 2])

    with pytest.raises(FormatError, match="no whole tar file") as caught:
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert caught.value.where == f"{shop.address}/B1.tar"
    assert_nothing_is_there(tmp_path / "data")


def test_what_an_archive_should_not_hold_is_said_of_where_it_came_from(
    shop: Shop, bridge: Path, tmp_path: Path
) -> None:
    write_archive(bridge, "B2", tmp_path / "other.tar")
    shop.offer((tmp_path / "other.tar").read_bytes())

    with pytest.raises(FormatError, match="which is no") as caught:
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert caught.value.where == f"{shop.address}/B1.tar"  # our own copy is gone


def test_a_bridge_that_does_not_validate_does_not_get_in(
    shop: Shop, bridge: Path, tmp_path: Path
) -> None:
    path = bridge / "poses.json"
    path.write_text(path.read_text().replace("331.125", "331.25", 1))
    write_archive(bridge, "B1", tmp_path / "bad.tar")
    shop.offer((tmp_path / "bad.tar").read_bytes())

    with pytest.raises(DownloadError, match="the bridge in it has 1 fault: pose"):
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert_nothing_is_there(tmp_path / "data")


def test_a_bridge_that_is_there_is_not_replaced_unasked(shop: Shop, tmp_path: Path) -> None:
    data = tmp_path / "data"
    download_bridge("B1", data, registry=str(shop.registry))
    asked = len(shop.shelf.asked)

    with pytest.raises(OutputError, match="is here already"):
        download_bridge("B1", data, registry=str(shop.registry))

    assert len(shop.shelf.asked) == asked
    download_bridge("B1", data, registry=str(shop.registry), overwrite=True)
    (data / "bridges/B1/defects.json").write_text("{}")
    with pytest.raises(OutputError, match="measured defects"):
        download_bridge("B1", data, registry=str(shop.registry), overwrite=True)


def test_a_build_of_the_same_bridge_keeps_it_out(shop: Shop, tmp_path: Path) -> None:
    with (
        folder_lock(tmp_path / "data/.partial/B1"),
        pytest.raises(OutputError, match="is writing here"),
    ):
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))


def test_an_unfinished_build_is_left_alone(shop: Shop, tmp_path: Path) -> None:
    unfinished = tmp_path / "data/.partial/B1/bridge/rgb"
    unfinished.mkdir(parents=True)

    download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert unfinished.is_dir()


def test_what_a_killed_download_left_is_cleared(shop: Shop, tmp_path: Path) -> None:
    left = tmp_path / "data/.partial/B1.unpacked/B1/rgb"
    left.mkdir(parents=True)
    (left / "000099.jpg").touch()

    done = download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert not (done.folder / "rgb/000099.jpg").exists()
    assert not (tmp_path / "data/.partial").exists()


def test_an_id_that_differs_in_case_only_is_refused(shop: Shop, tmp_path: Path) -> None:
    (tmp_path / "data/bridges/b1").mkdir(parents=True)

    with pytest.raises(UsageError, match="differs only in case"):
        download_bridge("B1", tmp_path / "data", registry=str(shop.registry))


def test_an_unknown_id_is_refused_before_anything_is_made(shop: Shop, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="lists no bridge 'B7'"):
        download_bridge("B7", tmp_path / "data", registry=str(shop.registry))

    assert not (tmp_path / "data").exists()


def test_the_archive_that_a_maintainer_repacked_comes_in_too(
    shop: Shop, bridge: Path, tmp_path: Path
) -> None:
    import tarfile

    shutil.copytree(bridge, tmp_path / "x/B1")
    write_archive(bridge, "B1", tmp_path / "a.tar")
    with tarfile.open(tmp_path / "a.tar", "r:") as tar:
        tar.extract("SHA256SUMS", tmp_path / "x", filter="data")
    with tarfile.open(tmp_path / "b.tar", "w", format=tarfile.GNU_FORMAT) as tar:
        tar.add(tmp_path / "x/SHA256SUMS", "SHA256SUMS")
        tar.add(tmp_path / "x/B1", "B1")
    shop.offer((tmp_path / "b.tar").read_bytes())

    done = download_bridge("B1", tmp_path / "data", registry=str(shop.registry))

    assert contents(done.folder) == contents(bridge)
