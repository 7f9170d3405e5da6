"""The golden dataset is clean; each single damage gives its own finding."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import FormatError
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.hashes import bytes_sha256, document_sha256, file_sha256, pixel_sha256
from civil_rgbd.format.images import encode_image, read_image
from civil_rgbd.format.index import read_index, write_index
from civil_rgbd.format.quality_exr import quality_sha256, write_quality
from civil_rgbd.format.writer import depth_statistics
from civil_rgbd.validation import Finding, Report, validate
from civil_rgbd.validation.report import CODES

Damage = Callable[[Path], object]


def bridge_of(dataset: Path) -> Path:
    return dataset / "bridges" / "B1"


def edit(path: Path, change: Callable[[Any], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def in_manifest(change: Callable[[Any], object]) -> Damage:
    return lambda dataset: edit(bridge_of(dataset) / "manifest.json", change)


def in_intrinsics(change: Callable[[Any], object]) -> Damage:
    return lambda dataset: edit(bridge_of(dataset) / "intrinsics.json", change)


def in_dataset(change: Callable[[Any], object]) -> Damage:
    return lambda dataset: edit(dataset / "dataset.json", change)


def in_defects(change: Callable[[Any], object]) -> Damage:
    return lambda dataset: edit(bridge_of(dataset) / "defects.json", change)


def in_poses(change: Callable[[Any], object]) -> Damage:
    """Change the poses, and let the index repeat them."""

    def damage(dataset: Path) -> None:
        edit(bridge_of(dataset) / "poses.json", lambda document: change(document["frames"][1]))
        pose = json.loads((bridge_of(dataset) / "poses.json").read_text())["frames"][1]
        values = pose["T_map_camera"]["translation_m"] + pose["T_map_camera"]["quaternion_xyzw"]
        names = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
        in_row(**dict(zip(names, values, strict=True)))(dataset)

    return damage


def in_row(**changes: Any) -> Damage:
    """Change the second row of the index."""

    def damage(dataset: Path) -> None:
        path = bridge_of(dataset) / "frames.parquet"
        rows = list(read_index(path))
        rows[1] = dataclasses.replace(rows[1], **changes)
        write_index(path, rows)

    return damage


def reorder(change: Callable[[list[FrameRow]], list[FrameRow]]) -> Damage:
    """Change the rows; the poses follow."""

    def damage(dataset: Path) -> None:
        path = bridge_of(dataset) / "frames.parquet"
        rows = change(list(read_index(path)))
        write_index(path, rows)
        edit(
            path.with_name("poses.json"),
            lambda document: document.update(
                frames=[
                    {
                        "frame_id": row.frame_id,
                        "stamp_ns": row.stamp_ns,
                        "T_map_camera": {
                            "translation_m": [row.tx, row.ty, row.tz],
                            "quaternion_xyzw": [row.qx, row.qy, row.qz, row.qw],
                        },
                    }
                    for row in rows
                ]
            ),
        )

    return damage


def swap_stamps(rows: list[FrameRow]) -> list[FrameRow]:
    one, two = rows[1], rows[2]
    return [
        rows[0],
        dataclasses.replace(one, stamp_ns=two.stamp_ns, source_stamp_ns=two.source_stamp_ns),
        dataclasses.replace(two, stamp_ns=one.stamp_ns, source_stamp_ns=one.source_stamp_ns),
    ]


def swap_frames(rows: list[FrameRow]) -> list[FrameRow]:
    one, two = rows[1], rows[2]
    return [
        rows[0],
        dataclasses.replace(two, stamp_ns=one.stamp_ns, source_stamp_ns=one.source_stamp_ns),
        dataclasses.replace(one, stamp_ns=two.stamp_ns, source_stamp_ns=two.source_stamp_ns),
    ]


def quality(
    change: Callable[[dict[str, Any]], object] = dict, *, hide: bool = True, then: Damage = repr
) -> Damage:
    """Give all frames quality planes, change those of the second, and do further damage.

    Args:
        change: of the second frame's planes.
        hide: mend the hash of the pixels in the index.
        then: what happens at last.
    """

    def damage(dataset: Path) -> None:
        folder, rows = bridge_of(dataset), []
        (folder / "quality").mkdir()
        for number, row in enumerate(read_index(folder / "frames.parquet")):
            measured = read_depth(folder / row.depth_path) > 0
            planes = {
                "empty": (~measured).astype(np.float16),
                "returns": measured.astype(np.float16),
                "sigma_m": (measured * 0.25).astype(np.float16),
            }
            digest, path = quality_sha256(planes), f"quality/{row.frame_id}.exr"
            if number == 1:
                change(planes)
                digest = quality_sha256(planes) if hide else digest
            written = write_quality(folder / path, planes)
            rows.append(
                dataclasses.replace(
                    row,
                    quality_path=path,
                    quality_file_sha256=bytes_sha256(written),
                    quality_pixel_sha256=digest,
                )
            )
        write_index(folder / "frames.parquet", rows)
        entry = {"unit": "1", "description": "of a test"}
        planes_said = [{"channel": name, **entry} for name in ("empty", "returns", "sigma_m")]
        in_manifest(lambda d: d.update(quality={"planes": planes_said}))(dataset)
        then(dataset)

    return damage


def plane(name: str, value: float) -> Callable[[dict[str, Any]], object]:
    """Put one value into the first pixel of a plane."""

    def change(planes: dict[str, Any]) -> None:
        planes[name][0, 0] = value

    return change


def smaller(planes: dict[str, Any]) -> None:
    planes.update({name: values[:-1].copy() for name, values in planes.items()})


def depth(change: Callable[[NDArray[np.float32]], object], *, hide: bool = True) -> Damage:
    """Change the second frame's depth; with ``hide`` the index is mended as far as it can be."""

    def damage(dataset: Path) -> None:
        path = bridge_of(dataset) / "depth" / "000007.exr"
        depth_m = read_depth(path).copy()
        returned = change(depth_m)
        depth_m = returned if isinstance(returned, np.ndarray) else depth_m
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Z": depth_m}).write(str(path))
        in_row(depth_file_sha256=file_sha256(path))(dataset)
        if hide and np.isfinite(depth_m).all() and not np.signbit(depth_m).any():
            share, least_m, most_m = depth_statistics(depth_m)
            in_row(
                depth_pixel_sha256=pixel_sha256(depth_m),
                valid_share=share,
                depth_min_m=least_m,
                depth_max_m=most_m,
            )(dataset)

    return damage


def put(value: float, *, at: int = 5) -> Callable[[NDArray[np.float32]], object]:
    def change(depth_m: NDArray[np.float32]) -> None:
        rows, columns = np.nonzero(depth_m)
        depth_m[rows[at], columns[at]] = value

    return change


def picture(data: bytes, *, file_hash: bool, pixel_hash: bool) -> Damage:
    """Replace the second frame's image; mend its hashes where asked."""

    def damage(dataset: Path) -> None:
        path = bridge_of(dataset) / "rgb" / "000007.jpg"
        path.write_bytes(data)
        if file_hash:
            in_row(rgb_file_sha256=file_sha256(path))(dataset)
        if pixel_hash:
            in_row(rgb_pixel_sha256=pixel_sha256(read_image(path)))(dataset)

    return damage


def other_rgb(height: int = 24, width: int = 32) -> bytes:
    rgb = np.full((height, width, 3), 90, dtype=np.uint8)
    return encode_image(rgb, codec="jpeg")


def rename_bridge(dataset: Path) -> None:
    bridge_of(dataset).rename(dataset / "bridges" / "B2")
    edit(dataset / "dataset.json", lambda d: d.update(bridges=["B2"], splits={}))


def add_twin(dataset: Path) -> None:
    shutil.copytree(bridge_of(dataset), dataset / "bridges" / "b1")
    if len(list((dataset / "bridges").iterdir())) == 1:
        pytest.skip("this file system takes B1 and b1 for one folder")
    edit(dataset / "bridges" / "b1" / "manifest.json", lambda d: d["bridge"].update(bridge_id="b1"))
    edit(dataset / "dataset.json", lambda d: d["bridges"].append("b1"))


def cut(name: str) -> Damage:
    def damage(dataset: Path) -> None:
        path = bridge_of(dataset) / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return damage


def remove(name: str) -> Damage:
    return lambda dataset: (bridge_of(dataset) / name).unlink()


def add(name: str) -> Damage:
    return lambda dataset: (bridge_of(dataset) / name).write_text("x")


def newer_index(dataset: Path) -> None:
    path = bridge_of(dataset) / "frames.parquet"
    table = pq.ParquetFile(path).read()
    table = table.append_column("speed", pa.array([1.0] * 3))
    pq.write_table(table.replace_schema_metadata({"format_version": "1.9"}), path)


DAMAGES: list[tuple[set[str], Damage]] = [
    ({"bridge-id-mismatch"}, rename_bridge),
    ({"bridge-ids-alike"}, add_twin),
    ({"counts-mismatch"}, in_manifest(lambda d: d["counts"].update(images_seen=15))),
    ({"counts-mismatch"}, in_manifest(lambda d: d["counts"].update(mean_valid_share=0.5))),
    (
        {"counts-mismatch"},
        in_manifest(lambda d: d["counts"].update(images_seen=13, frames_kept=2)),
    ),
    ({"dataset-bridge-missing"}, in_dataset(lambda d: d["bridges"].append("B9"))),
    ({"dataset-bridge-unlisted"}, in_dataset(lambda d: d.update(bridges=[]))),
    ({"defect-duplicate"}, in_defects(lambda d: d["defects"].append(d["defects"][0]))),
    ({"defect-frame-unknown"}, in_defects(lambda d: d["defects"][0].update(frame_id="000001"))),
    ({"depth-negative"}, depth(put(-1.0))),
    ({"depth-negative"}, depth(put(-0.0))),
    ({"depth-not-finite"}, depth(put(np.nan))),
    ({"depth-not-finite"}, depth(put(np.inf))),
    ({"depth-off-step"}, depth(put(5.0001))),
    ({"depth-out-of-range"}, depth(put(200.5))),
    ({"depth-out-of-range"}, depth(put(0.25))),
    ({"depth-pixel-hash", "depth-statistics"}, depth(put(150.0), hide=False)),
    ({"depth-size", "counts-mismatch"}, depth(lambda depth_m: depth_m[:-1].copy())),
    ({"depth-statistics", "counts-mismatch"}, in_row(valid_share=0.5)),
    ({"depth-statistics"}, in_row(depth_min_m=0.0)),
    ({"depth-pixel-hash"}, in_row(depth_pixel_sha256="0" * 64)),
    ({"depth-unreadable", "file-hash"}, cut("depth/000007.exr")),
    ({"document-missing"}, remove("intrinsics.json")),
    ({"document-missing"}, remove("poses.json")),
    ({"document-missing"}, remove("frames.parquet")),
    ({"document-missing"}, lambda dataset: (dataset / "dataset.json").unlink()),
    ({"document-schema"}, in_manifest(lambda d: d.update(weather="fine"))),
    ({"document-schema"}, in_intrinsics(lambda d: d.pop("fx_px"))),
    ({"document-schema"}, in_dataset(lambda d: d.update(name=""))),
    ({"document-unreadable"}, cut("poses.json")),
    ({"document-unreadable"}, cut("manifest.json")),
    ({"document-value"}, in_manifest(lambda d: d.update(map_up=[0.0, 0.0, 0.9]))),
    ({"file-hash"}, in_row(rgb_file_sha256="0" * 64)),
    ({"file-hash"}, in_row(depth_file_sha256="0" * 64)),
    ({"file-litter"}, add("rgb/.DS_Store")),
    ({"file-missing"}, remove("rgb/000007.jpg")),
    ({"file-missing"}, remove("depth/000012.exr")),
    ({"file-unknown"}, add("rgb/000001.jpg")),
    ({"file-unknown"}, add("notes.txt")),
    ({"file-unknown"}, add("depth/.000007.exr.12.partial")),
    ({"file-unknown"}, lambda dataset: (dataset / "bridges" / "notes.txt").touch()),
    (
        {"frame-id-duplicate", "stamp-order", "counts-mismatch"},
        reorder(lambda rows: [rows[0], rows[1], rows[1], rows[2]]),
    ),
    ({"frame-id-mismatch"}, in_row(source_index=8)),
    ({"frame-id-order"}, reorder(swap_frames)),
    (
        {"index-path", "file-unknown", "file-missing"},
        in_row(depth_path="../B1/depth/000007.exr"),
    ),
    ({"index-unreadable"}, cut("frames.parquet")),
    (
        {"intrinsics-principal-point", "intrinsics-recipe"},
        in_intrinsics(lambda d: d.update(cx_px=40.0)),
    ),
    ({"intrinsics-recipe"}, in_intrinsics(lambda d: d.update(cx_px=15.625))),
    (
        {"licence-unstated"},
        in_manifest(lambda d: d["bridge"].update(licence="LicenseRef-Unstated")),
    ),
    ({"machine-path"}, in_manifest(lambda d: d["warnings"].append("read /home/ann/raw.mcap"))),
    ({"machine-path"}, in_manifest(lambda d: d["bridge"].update(note=r"see C:\scans\raw"))),
    (
        {"manifest-missing", "dataset-bridge-missing", "split-bridge-unknown"},
        remove("manifest.json"),
    ),
    ({"pose-mismatch"}, in_row(tx=540007.6)),
    ({"pose-mismatch"}, in_row(qw=float("nan"))),
    ({"poses-frames"}, lambda d: edit(bridge_of(d) / "poses.json", lambda p: p["frames"].pop())),
    (
        {"poses-frames"},
        lambda d: edit(bridge_of(d) / "poses.json", lambda p: p["frames"][1].update(stamp_ns=1)),
    ),
    (
        {"quaternion-norm"},
        in_poses(lambda f: f["T_map_camera"].update(quaternion_xyzw=[0, 0, 0, 1 - 1e-8])),
    ),
    (
        {"quaternion-sign"},
        in_poses(lambda f: f["T_map_camera"].update(quaternion_xyzw=[0.6, 0, 0, -0.8])),
    ),
    ({"recipe-hash"}, in_manifest(lambda d: d["recipe"].update(sha256="0" * 64))),
    ({"quality-pixel-hash"}, quality(plane("returns", 5.0), hide=False)),
    ({"quality-planes"}, quality(lambda planes: planes.pop("returns"))),
    ({"quality-planes"}, quality(then=in_manifest(lambda d: d.update(quality=None)))),
    (
        {"quality-planes", "file-unknown"},
        quality(
            then=in_row(quality_path=None, quality_file_sha256=None, quality_pixel_sha256=None)
        ),
    ),
    ({"quality-size"}, quality(smaller)),
    ({"quality-unreadable", "file-hash"}, quality(then=cut("quality/000007.exr"))),
    ({"file-missing"}, quality(then=remove("quality/000012.exr"))),
    ({"file-hash"}, quality(then=in_row(quality_file_sha256="0" * 64))),
    ({"quality-values"}, quality(lambda planes: planes["empty"].fill(2.0))),
    ({"quality-values"}, quality(lambda planes: planes["returns"].fill(0.0))),
    ({"quality-values"}, quality(lambda planes: planes["sigma_m"].fill(0.0))),
    ({"rgb-decoder"}, in_row(rgb_pixel_sha256="0" * 64)),
    (
        {"rgb-pixel-hash", "file-hash"},
        picture(other_rgb(), file_hash=False, pixel_hash=False),
    ),
    ({"rgb-size"}, picture(other_rgb(23, 32), file_hash=True, pixel_hash=True)),
    ({"rgb-unreadable"}, picture(other_rgb()[:-9], file_hash=True, pixel_hash=False)),
    ({"split-bridge-unknown"}, in_dataset(lambda d: d["splits"]["train"].update(B9="all"))),
    ({"split-frame-unknown"}, in_dataset(lambda d: d["splits"]["train"]["B1"].append("000001"))),
    ({"stamp-offset"}, in_row(source_stamp_ns=1_700_000_000_700_000_001)),
    ({"stamp-order"}, reorder(swap_stamps)),
    ({"version-newer"}, in_intrinsics(lambda d: d.update(format_version="1.9", skew_px=0.0))),
    ({"version-newer"}, newer_index),
    ({"version-unsupported"}, in_intrinsics(lambda d: d.update(format_version="2.0"))),
    ({"version-unsupported"}, in_intrinsics(lambda d: d.pop("format_version"))),
]


def codes(report: Report) -> set[str]:
    return {finding.code for finding in report.findings}


def test_the_golden_dataset_is_clean(golden: Path) -> None:
    report = validate(golden)

    assert report.findings == ()
    assert (report.bridges, report.frames) == (("B1",), 3)
    assert report.to_text().endswith("nothing to complain of")


def test_the_golden_bridge_is_clean_by_itself(golden: Path) -> None:
    report = validate(bridge_of(golden))

    assert report.findings == ()
    assert (report.bridges, report.frames) == (("B1",), 3)


@pytest.mark.parametrize(
    ("expected", "damage"), DAMAGES, ids=[f"{'+'.join(sorted(e))}" for e, _ in DAMAGES]
)
def test_each_damage_gives_its_own_finding(
    golden_copy: Path, expected: set[str], damage: Damage
) -> None:
    damage(golden_copy)

    report = validate(golden_copy)

    assert codes(report) == expected
    assert (report.errors > 0) == any(CODES[code][0] == "error" for code in expected)
    for finding in report.findings:
        assert finding.fix
        assert finding.message


def test_quality_planes_that_fit_their_depth_are_valid(golden_copy: Path) -> None:
    quality()(golden_copy)

    assert validate(golden_copy).findings == ()


def test_every_code_has_a_damage_that_gives_it() -> None:
    of_the_format = {code for code in CODES if not code.startswith("contribution-")}

    assert set().union(*(expected for expected, _ in DAMAGES)) == of_the_format


def test_findings_say_where(golden_copy: Path) -> None:
    depth(put(200.5))(golden_copy)

    (finding,) = validate(golden_copy).findings

    assert (finding.bridge, finding.file) == ("B1", "depth/000007.exr")
    assert finding.place == "B1/depth/000007.exr"
    assert finding.message == (
        "1 pixels lie outside 0.5 to 200.0 m; the depths are 10.125 to 200.5 m"
    )


def test_depth_at_the_very_limit_is_in_range(golden_copy: Path) -> None:
    depth(put(200.0))(golden_copy)
    depth(put(0.5, at=9))(golden_copy)

    assert validate(golden_copy).findings == ()


def test_a_finer_step_of_the_recipe_is_respected(golden_copy: Path) -> None:
    def change(document: Any) -> None:
        document["recipe"]["parameters"]["depth"]["step_m"] = 0.25
        document["recipe"]["sha256"] = document_sha256(document["recipe"]["parameters"])

    edit(bridge_of(golden_copy) / "manifest.json", change)

    report = validate(golden_copy)
    assert codes(report) == {"depth-off-step"}
    assert len(report.findings) == 3


def test_an_imported_bridge_has_no_recipe_to_keep(golden_copy: Path) -> None:
    in_manifest(lambda d: d.update(origin="imported", recipe=None, rig=None))(golden_copy)
    depth(put(5000.0001))(golden_copy)

    assert validate(golden_copy).findings == ()


def test_a_png_with_other_pixels_is_no_matter_of_decoders(golden_copy: Path) -> None:
    bridge = bridge_of(golden_copy)
    rgb = read_image(bridge / "rgb" / "000007.jpg")
    (bridge / "rgb" / "000007.jpg").unlink()
    (bridge / "rgb" / "000007.png").write_bytes(encode_image(rgb, codec="png"))
    in_row(
        rgb_path="rgb/000007.png",
        rgb_file_sha256=file_sha256(bridge / "rgb" / "000007.png"),
        rgb_pixel_sha256="0" * 64,
    )(golden_copy)

    assert codes(validate(golden_copy)) == {"rgb-pixel-hash"}


def test_depth_of_another_writer_keeps_its_pixel_hash(golden_copy: Path) -> None:
    path = bridge_of(golden_copy) / "depth" / "000007.exr"
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": read_depth(path)}).write(str(path))

    assert codes(validate(golden_copy)) == {"file-hash"}


def test_a_bridge_of_rubble_is_findings_not_a_traceback(golden_copy: Path) -> None:
    rng = np.random.default_rng(0)
    for path in bridge_of(golden_copy).rglob("*"):
        if path.is_file():
            path.write_bytes(rng.bytes(500))

    report = validate(golden_copy)

    assert codes(report) == {"document-unreadable", "index-unreadable"}


def test_an_unfinished_bridge_by_itself_is_a_finding(golden_copy: Path) -> None:
    remove("manifest.json")(golden_copy)

    report = validate(bridge_of(golden_copy))

    assert [(f.code, f.bridge) for f in report.findings] == [("manifest-missing", "B1")]


def test_a_builds_own_folders_are_passed_over(golden_copy: Path) -> None:
    (golden_copy / ".partial" / "B2" / "rgb").mkdir(parents=True)
    (golden_copy / ".partial.lock").touch()
    shutil.copytree(bridge_of(golden_copy), golden_copy / "bridges" / ".B1.replaced")

    assert validate(golden_copy).findings == ()


def test_an_index_cannot_make_us_read_other_files(golden_copy: Path) -> None:
    (golden_copy / "secret").write_text("secret")
    in_row(rgb_path="../../secret")(golden_copy)

    report = validate(golden_copy)

    assert "rgb-unreadable" not in codes(report)
    assert {"index-path", "file-missing"} <= codes(report)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("topic /livox/lidar has gaps", False),
        ("/camera_left/image_rect/compressed", False),
        ("see https://example.org/data/a.json", False),
        ("ask ann@example.org", False),
        ("and/or, 1/1024 m, N/A", False),
        ("read from /media/ssd/scan", True),
        ("('/data/raw/park.mcap')", True),
        ("file:///tmp/x", True),
        ("~/scans/raw", True),
        (r"\\server\share\raw", True),
        ("D:/scans/raw", True),
        ("ann@ws-7:/scans", True),
        ("http://localhost:8080/x", True),
    ],
)
def test_paths_and_hosts_are_told_from_topics(golden_copy: Path, text: str, *, found: bool) -> None:
    in_manifest(lambda d: d["warnings"].append(text))(golden_copy)

    assert codes(validate(golden_copy)) == ({"machine-path"} if found else set())


def test_ten_thousand_findings_are_counted_and_a_few_are_shown() -> None:
    findings = tuple(
        Finding("depth-out-of-range", f"number {n}", f"depth/{n:06d}.exr", f"B{n % 2}")
        for n in range(10_000)
    )
    report = Report(
        "data", ("B0", "B1"), 10_000, (*findings, Finding("licence-unstated", "m", "f"))
    )

    text = report.to_text()

    assert "error: depth-out-of-range, 10000 times in 2 bridges" in text
    assert "... and 9997 more (--json gives them all)" in text
    assert text.endswith("10000 errors, 1 warning")
    assert len(text.splitlines()) == 11
    assert len(report.to_document()["findings"]) == 10_001  # type: ignore[arg-type]  # a list


def test_progress_is_told_frame_by_frame(golden: Path) -> None:
    calls: list[tuple[int, int]] = []

    validate(golden, progress=lambda done, total: calls.append((done, total)))

    assert calls == [(1, 3)] * 3


def test_no_such_place_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="there is no such folder"):
        validate(tmp_path / "nothing")
    with pytest.raises(FormatError, match="neither a dataset"):
        validate(tmp_path)


def test_the_decoder_is_not_trusted_with_sizes(golden_copy: Path) -> None:
    huge = cv2.imencode(".png", np.zeros((2, 2, 3), np.uint8))[1].tobytes()
    huge = huge[:16] + (100_000_000).to_bytes(4, "big") * 2 + huge[24:]
    picture(huge, file_hash=True, pixel_hash=False)(golden_copy)

    assert codes(validate(golden_copy)) == {"rgb-unreadable"}
