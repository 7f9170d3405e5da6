"""A submission: archive, sums and the page, the same for the same folder."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from civil_rgbd.contribution.pack import bridge_to_pack, default_archive, pack_bridge
from civil_rgbd.contribution.registry import registry_from_document, registry_to_document
from civil_rgbd.contribution.scaffold import known_answers, open_submission, write_submission
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.validation import validate

VOID = {"meta", "img", "br", "path", "circle", "rect", "polyline"}


class Page(HTMLParser):
    """What is in a page: tags that balance, their attributes, the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def packed(folder: Path, out: Path) -> Path:
    pack_bridge(folder, out, validate(folder, profile="contribution"))
    return out


def test_the_same_folder_gives_the_same_files(bridge: Path, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere" / "B1"
    shutil.copytree(bridge, copy)

    one = packed(bridge, tmp_path / "one" / "B1-1.0.tar")
    two = packed(copy, tmp_path / "two" / "B1-1.0.tar")

    names = {path.name for path in one.parent.iterdir()}
    assert names == {"B1-1.0.tar", "B1-1.0.tar.sha256", "B1-1.0.html"}
    for name in names:
        assert (one.parent / name).read_bytes() == (two.parent / name).read_bytes(), name


def test_packing_again_changes_nothing(bridge: Path, tmp_path: Path) -> None:
    first = packed(bridge, tmp_path / "B1-1.0.tar").read_bytes()

    assert packed(bridge, tmp_path / "B1-1.0.tar").read_bytes() == first


def test_the_page_asks_for_nothing_and_runs_nothing(bridge: Path, tmp_path: Path) -> None:
    text = packed(bridge, tmp_path / "a.tar").with_suffix(".html").read_text("utf-8")
    page = Page(text)

    assert page.open == []
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "link", "iframe", "object", "a"})
    for _, attributes in page.tags:
        assert not [name for name in attributes if name.startswith("on")]
        assert not (attributes.get("src") or "data:").partition("data:")[0]
    assert not re.findall(r"url\(|@import|srcset", text)
    assert "default-src 'none'" in text


def test_the_page_has_what_a_maintainer_looks_for(bridge: Path, tmp_path: Path) -> None:
    archive = packed(bridge, tmp_path / "a.tar")
    page = Page(archive.with_suffix(".html").read_text("utf-8"))

    pictures = [attributes["alt"] for tag, attributes in page.tags if tag == "img"]
    drawings = [attributes["aria-label"] for tag, attributes in page.tags if tag == "svg"]
    assert {f"depth of frame {name}" for name in ("000000", "000007", "000012")} <= {*pictures}
    assert "coverage by place in the image" in pictures
    assert any("track" in (label or "") for label in drawings)
    assert len(drawings) == 7
    for words in (
        *("Town of Nowhere", "CC-BY-4.0", "letter of its engineer", "none visible"),
        *("spacing of frames", "image-too-near-previous", "golden.mcap", "Livox Avia"),
        *(
            "the camera sits at x ",
            "of the LiDAR, looks along its ",
            "its right is ",
            "its down is ",
        ),
        *("the LiDAR sits at x ", "1 of 3 frames have no point within 0.25 s"),
    ):
        assert words in page.words
    sums = (tmp_path / "a.tar.sha256").read_text().split()
    assert sums[0] in page.words
    assert sums[1::2] == ["a.tar", "a.html"]


def test_what_a_contributor_writes_stays_words(submission: Path, tmp_path: Path) -> None:
    place = open_submission(submission, "B1")
    evil = '<script>alert(1)</script><img src="https://example.org/x">'
    write_submission(place, known_answers(place) | {"owner": evil, "name": evil, "note": evil})

    page = Page(packed(place.folder, tmp_path / "a.tar").with_suffix(".html").read_text("utf-8"))

    assert page.words.count(evil) == 3
    assert "script" not in {tag for tag, _ in page.tags}


def test_the_entry_fits_the_registry(bridge: Path, tmp_path: Path) -> None:
    done = pack_bridge(bridge, tmp_path / "a.tar", validate(bridge, profile="contribution"))

    document = registry_to_document((done.entry,))
    assert registry_from_document(json.loads(json.dumps(document)), where="x") == (done.entry,)
    assert done.entry.sha256 == done.archive.sha256
    assert done.entry.size_bytes == (tmp_path / "a.tar").stat().st_size


def test_a_bridge_with_gaps_is_not_packed(bare: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="it is not packed"):
        packed(bare / "bridges/B1", tmp_path / "out" / "a.tar")

    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("place", ["bridges/B1/a.tar", "bridges/B1/rgb/a.tar", "bridges/a.tar"])
def test_no_archive_goes_among_the_bridges(submission: Path, place: str) -> None:
    with pytest.raises(UsageError, match="nothing else may lie"):
        packed(submission / "bridges/B1", submission / place)

    assert validate(submission).findings == ()


def test_the_suffix_tells_the_truth(bridge: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="plain tar file") as caught:
        packed(bridge, tmp_path / "a.tar.zst")

    assert caught.value.fix == "name it a.tar.tar"


def test_a_folder_of_another_name_is_not_packed(bridge: Path, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="the folder is called 'B7'"):
        packed(bridge.rename(bridge.with_name("B7")), tmp_path / "a.tar")


def test_one_bridge_of_several_is_named(submission: Path) -> None:
    shutil.copytree(submission / "bridges/B1", submission / "bridges/B2")

    with pytest.raises(UsageError, match="there are 2 bridges here") as caught:
        bridge_to_pack(submission, None)
    assert "--bridge B1 (there are B1, B2)" in caught.value.fix
    with pytest.raises(UsageError, match="no whole bridge 'B3'"):
        bridge_to_pack(submission, "B3")
    assert bridge_to_pack(submission, "B2") == submission / "bridges/B2"


def test_an_empty_dataset_has_nothing_to_pack(tmp_path: Path) -> None:
    (tmp_path / "bridges").mkdir()

    with pytest.raises(FormatError, match="no whole bridge here"):
        bridge_to_pack(tmp_path, None)


def test_the_archive_is_called_after_bridge_and_version(bridge: Path) -> None:
    assert default_archive(bridge) == Path("B1-1.0.tar")
