"""Archives from strangers: what is not a bridge and nothing else does not get out of them."""

from __future__ import annotations

import gzip
import hashlib
import io
import struct
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.contribution import unpack
from civil_rgbd.contribution.archive import write_archive
from civil_rgbd.contribution.tar_members import members
from civil_rgbd.contribution.unpack import unpack_bridge
from civil_rgbd.errors import FormatError

from .test_scaffold import contents


def tar_of(
    path: Path, entries: list[tuple[tarfile.TarInfo, bytes]], format_: int = tarfile.USTAR_FORMAT
) -> Path:
    with tarfile.open(path, "w", format=format_) as tar:
        for member, data in entries:
            tar.addfile(member, io.BytesIO(data))
    return path


def file(name: str, data: bytes = b"x") -> tuple[tarfile.TarInfo, bytes]:
    member = tarfile.TarInfo(name)
    member.size = len(data)
    return member, data


def link(name: str, kind: bytes, target: str = "/etc/passwd") -> tuple[tarfile.TarInfo, bytes]:
    member = tarfile.TarInfo(name)
    member.type, member.linkname = kind, target
    return member, b""


def sums_of(*entries: tuple[tarfile.TarInfo, bytes]) -> tuple[tarfile.TarInfo, bytes]:
    lines = [f"{hashlib.sha256(data).hexdigest()}  {m.name}\n" for m, data in entries]
    return file("SHA256SUMS", "".join(lines).encode())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../evil.json", "leads out of its folder"),
        ("B1/../../evil", "leads out of its folder"),
        ("B1/rgb/../../../evil", "leads out of its folder"),
        ("/tmp/evil", "leads out of its folder"),  # noqa: S108 - a name in an archive
        ("C:/evil", "leads out of its folder"),
        ("B1\\..\\evil", "leads out of its folder"),
        ("\\\\host\\evil", "leads out of its folder"),
        ("evil", "no file of the bridge 'B1'"),
        ("B2/manifest.json", "no file of the bridge 'B1'"),
        ("b1/manifest.json", "no file of the bridge 'B1'"),
        ("B1/evil.sh", "no file of the bridge 'B1'"),
        ("B1/rgb/evil.jpg", "no file of the bridge 'B1'"),
        ("B1/rgb/000000.jpg\n", "no file of the bridge 'B1'"),
        ("B1/depth/000000.jpg", "no file of the bridge 'B1'"),
        ("B1/manifest.json/x", "no file of the bridge 'B1'"),
        ("B1/rgb/" + "0" * 40 + ".jpg", "no file of the bridge 'B1'"),
    ],
)
def test_a_name_that_no_bridge_has_is_refused(tmp_path: Path, name: str, words: str) -> None:
    archive = tar_of(tmp_path / "a.tar", [file(name), sums_of(file(name))])

    with pytest.raises(FormatError, match=words):
        unpack_bridge(archive, "B1", tmp_path / "inside" / "B1")

    assert {path.name for path in tmp_path.rglob("*")} <= {"a.tar", "inside", "B1"}


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (tarfile.SYMTYPE, "a symbolic link"),
        (tarfile.LNKTYPE, "a hard link"),
        (tarfile.CHRTYPE, "a device"),
        (tarfile.BLKTYPE, "a device"),
        (tarfile.FIFOTYPE, "a pipe"),
        (tarfile.GNUTYPE_SPARSE, "a sparse file"),
        (tarfile.CONTTYPE, "an entry of kind"),
    ],
)
def test_links_devices_and_holes_are_refused(tmp_path: Path, kind: bytes, words: str) -> None:
    archive = tar_of(tmp_path / "a.tar", [link("B1/manifest.json", kind)])

    with pytest.raises(FormatError, match=words):
        unpack_bridge(archive, "B1", tmp_path / "B1")


@pytest.mark.parametrize("name", ["..", "/", "B1/secret", "B2", "B1/rgb/inner"])
def test_a_folder_that_no_bridge_has_is_refused(tmp_path: Path, name: str) -> None:
    archive = tar_of(tmp_path / "a.tar", [link(name, tarfile.DIRTYPE, "")])

    with pytest.raises(FormatError, match=r"no bridge has|no SHA256SUMS"):
        unpack_bridge(archive, "B1", tmp_path / "B1")


def test_a_long_name_in_an_extension_is_refused(tmp_path: Path) -> None:
    for format_, words in (
        (tarfile.GNU_FORMAT, "a name that is too long"),
        (tarfile.PAX_FORMAT, "extended header for 'path'"),
    ):
        archive = tar_of(tmp_path / "a.tar", [file("B1/" + "../" * 60 + "evil")], format_)

        with pytest.raises(FormatError, match=words):
            unpack_bridge(archive, "B1", tmp_path / f"B1{format_}")


def test_an_archive_that_somebody_packed_by_hand_comes_out_too(
    bridge: Path, tmp_path: Path
) -> None:
    """Python's own default: extended headers with times; and folders, and ./ in front."""
    sums = [(path, f"B1/{path.relative_to(bridge).as_posix()}") for path in bridge.rglob("*.*")]
    (bridge.parent / "SHA256SUMS").write_text(
        "".join(f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {name}\n" for p, name in sums)
    )
    with tarfile.open(tmp_path / "a.tar", "w") as tar:
        tar.add(bridge.parent, ".")

    unpack_bridge(tmp_path / "a.tar", "B1", tmp_path / "out")

    assert contents(tmp_path / "out") == contents(bridge)


@pytest.mark.parametrize(
    ("pack", "words"),
    [
        (gzip.compress, "compressed by gzip"),
        (lambda data: b"PK\x03\x04" + data, "compressed by zip"),
        (lambda data: b"\x28\xb5\x2f\xfd" + data, "compressed by zstd"),
        (lambda data: data[1:], "does not begin as a tar file"),
        (lambda data: b"<html>" + data, "does not begin as a tar file"),
        (lambda _: b"", "cut off"),
        (lambda data: data[:700], "claims|cut off"),
        (lambda data: data[:10_000], "claims|cut off"),
    ],
)
def test_what_is_no_plain_tar_is_refused(
    bridge: Path, tmp_path: Path, pack: Callable[[bytes], bytes], words: str
) -> None:
    """A bomb is a small file that says it becomes a large one: nothing compressed is unpacked."""
    write_archive(bridge, "B1", tmp_path / "a.tar")
    (tmp_path / "b.tar").write_bytes(pack((tmp_path / "a.tar").read_bytes()))

    with pytest.raises(FormatError, match=words):
        unpack_bridge(tmp_path / "b.tar", "B1", tmp_path / "out")


def header(size: bytes) -> bytes:
    block = bytearray(tarfile.TarInfo("B1/manifest.json").tobuf(tarfile.USTAR_FORMAT))
    block[124:136] = size.ljust(12, b"\0")
    block[148:156] = b" " * 8
    block[148:156] = b"%06o\0 " % sum(block)
    return bytes(block)


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (b"77777777777", "claims 8,589,934,591 bytes"),
        (b"\x80" + struct.pack(">Q", 1 << 60).rjust(11, b"\0"), "is no octal number"),
        (b"\xff" * 12, "is no octal number"),
        (b"-1", "is no octal number"),
        (b"", "is no octal number"),
        (b"1_0", "is no octal number"),
    ],
)
def test_a_size_that_lies_is_refused(tmp_path: Path, size: bytes, words: str) -> None:
    (tmp_path / "a.tar").write_bytes(header(size) + bytes(2048))

    with pytest.raises(FormatError, match=words):
        unpack_bridge(tmp_path / "a.tar", "B1", tmp_path / "B1")


def test_too_many_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpack, "MAX_FILES", 10)
    entries = [file(f"B1/rgb/{n:06d}.jpg", b"") for n in range(11)]
    archive = tar_of(tmp_path / "a.tar", entries)

    with pytest.raises(FormatError, match="over 10 files"):
        unpack_bridge(archive, "B1", tmp_path / "B1")


def test_a_file_that_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpack, "MAX_FILE_BYTES", 10)
    archive = tar_of(tmp_path / "a.tar", [file("B1/poses.json", bytes(11))])

    with pytest.raises(FormatError, match="more than 10"):
        unpack_bridge(archive, "B1", tmp_path / "B1")


def test_a_file_that_comes_twice_is_refused(tmp_path: Path) -> None:
    archive = tar_of(tmp_path / "a.tar", [file("B1/poses.json"), file("B1/poses.json", b"y")])

    with pytest.raises(FormatError, match=r"'poses\.json' twice"):
        unpack_bridge(archive, "B1", tmp_path / "B1")


@pytest.mark.parametrize(
    ("sums", "words"),
    [
        ([], "holds no SHA256SUMS"),
        ([sums_of(file("B1/poses.json", b"y"))], "and SHA256SUMS do not agree"),
        ([sums_of()], "and SHA256SUMS do not agree"),
        ([sums_of(file("B1/poses.json"), file("B1/frames.parquet"))], r"'B1/frames\.parquet'"),
    ],
)
def test_files_and_checksums_must_agree(
    tmp_path: Path, sums: list[tuple[tarfile.TarInfo, bytes]], words: str
) -> None:
    archive = tar_of(tmp_path / "a.tar", [file("B1/poses.json"), *sums])

    with pytest.raises(FormatError, match=words):
        unpack_bridge(archive, "B1", tmp_path / "B1")


def test_a_flipped_byte_anywhere_is_noticed(bridge: Path, tmp_path: Path) -> None:
    write_archive(bridge, "B1", tmp_path / "a.tar")
    data = (tmp_path / "a.tar").read_bytes()
    with (tmp_path / "a.tar").open("rb") as stream:
        used = max(stream.tell() + m.size_bytes for m in members(stream, where="a.tar"))
    for number, place in enumerate(range(0, used, used // 60)):
        if not data[place]:
            continue  # padding between files is nobody's
        (tmp_path / "b.tar").write_bytes(
            data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        )

        with pytest.raises(FormatError):
            unpack_bridge(tmp_path / "b.tar", "B1", tmp_path / f"out{number}")


@given(st.binary(max_size=2000), st.integers(0, 3))
def test_noise_is_refused_and_never_crashes(noise: bytes, blocks: int) -> None:
    head = header(b"00000001000") + bytes(512)
    try:
        found = list(members(io.BytesIO(head[: 512 * blocks] + noise), where="noise"))
    except FormatError:
        return
    assert all(member.size_bytes <= 2000 + 1536 for member in found)


@given(st.binary(max_size=600))
def test_extended_headers_of_noise_never_crash(noise: bytes) -> None:
    member = tarfile.TarInfo("pax")
    member.type, member.size = b"x", len(noise)
    block = member.tobuf(tarfile.USTAR_FORMAT)
    padded = noise + bytes(-len(noise) % 512)
    try:
        assert list(members(io.BytesIO(block + padded + bytes(1024)), where="noise")) == []
    except FormatError as error:
        assert error.fix  # noqa: PT017 - either outcome is right, a crash is not
