"""What ``250k-clean`` removes of a real drive under a bridge, in numbers and pictures.

``python benchmarks/real_drive.py DRIVE.mcap [--pictures FOLDER]``

The drive is built with ``250k`` and with ``250k-clean``. No frame has points of its own instant: a
frame takes those before its image, of two scans. So the scan of that very instant can judge them. A
pixel is *behind* when it is deeper than every point of that scan within 3 x 3 pixels, by more than
0.1 m + 2 %: it shows what the camera cannot see, or what a car that came has hidden since. It is
*in front* when it is nearer than all of them by as much: a car was there and has left. Else it
*agrees*. Pixels without such a point near them are not judged.

The pictures show the image, the depth of both recipes, and the image with what was removed: red
behind, blue in front, yellow agreeing, white not judged. KITTI's licence (CC BY-NC-SA 3.0) holds
for them.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.cli import main as civil_rgbd
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording
from civil_rgbd.format.depth_exr import read_depth
from civil_rgbd.format.images import read_image
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.geometry.transforms import inverse, transform_points

RECIPES: Final = ("250k", "250k-clean")
KINDS: Final = ("agree", "behind", "in front", "not judged")
RIGHT_SHARE: Final = 0.4  # of the image's width: where the tanker and its cab are
COLOURS_BGR: Final = ((0, 220, 255), (0, 0, 255), (255, 80, 0), (255, 255, 255))

Depth = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Judged:
    """One frame of the drive by both recipes.

    Attributes:
        name: of the frame.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) by ``250k``.
        clean_m: (H, W) by ``250k-clean``.
        kind: (H, W) int8, which of :data:`KINDS` a pixel of ``depth_m`` is; -1 without depth.
    """

    name: str
    rgb: NDArray[np.uint8]
    depth_m: Depth
    clean_m: Depth
    kind: NDArray[np.int8]

    @property
    def removed(self) -> NDArray[np.bool_]:
        """(H, W) bool."""
        return (self.depth_m > 0) & (self.clean_m == 0)


def judged_frames(drive: Path) -> list[Judged]:
    """Build the drive twice, and judge every frame."""
    recording = open_recording(drive)
    with tempfile.TemporaryDirectory() as scratch:
        folders = []
        for recipe in RECIPES:
            arguments = ["--recipe", recipe, "--bridge", "drive", "--out", f"{scratch}/{recipe}"]
            if civil_rgbd(["build", str(drive), *arguments]):
                message = f"{recipe} was not built"
                raise SystemExit(message)
            folders.append(Path(scratch) / recipe / "bridges" / "drive")
        every = []
        rows = (read_bridge(folder).rows for folder in folders)
        for plain, clean in zip(*rows, strict=True):
            depth_m = read_depth(folders[0] / plain.depth_path)
            kind = _kinds(depth_m, _now(recording, plain.source_index, depth_m.shape))
            rgb = read_image(folders[0] / plain.rgb_path)
            clean_m = read_depth(folders[1] / clean.depth_path)
            every.append(Judged(plain.frame_id, rgb, depth_m, clean_m, kind))
    return every


def _now(recording: Recording, image: int, shape: tuple[int, ...]) -> tuple[Depth, Depth]:
    """Return the least and the largest depth within 3 x 3 pixels by the scan of an image's instant.

    Both (H, W), infinite and 0 where there is none.
    """
    stamp_ns = recording.image_stamps_ns[image]
    scan = recording.read_scan(int(np.abs(recording.scan_stamps_ns - stamp_ns).argmin()))
    points = transform_points(inverse(recording.rig.T_lidar_camera), scan.points)
    points = points[points[:, 2] > 0.5]
    pinhole = recording.rig.camera.pinhole
    camera = pinhole.scaled(shape[1] / pinhole.width_px)
    u = np.floor(camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px + 0.5).astype(int)
    v = np.floor(camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px + 0.5).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
    at, z = (v[inside], u[inside]), points[inside, 2].astype(np.float32)
    least, most = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
    np.minimum.at(least, at, z)
    np.maximum.at(most, at, z)
    square = np.ones((3, 3), np.uint8)
    return cv2.erode(least, square), cv2.dilate(most, square)


def _kinds(depth_m: Depth, now: tuple[Depth, Depth]) -> NDArray[np.int8]:
    least, most = now
    kind = np.zeros(depth_m.shape, np.int8)
    kind[depth_m > 1.02 * most + 0.1] = KINDS.index("behind")
    kind[depth_m < 0.98 * least - 0.1] = KINDS.index("in front")
    kind[most == 0] = KINDS.index("not judged")
    kind[depth_m == 0] = -1
    return kind


def table(frames: list[Judged]) -> list[str]:
    """Say what becomes of each kind of pixel, over all frames."""
    lines = ["| pixels of a frame | 250k | removed | |", "|---|---|---|---|"]
    for number, name in enumerate(KINDS):
        before = np.mean([(frame.kind == number).sum() for frame in frames])
        gone = np.mean([((frame.kind == number) & frame.removed).sum() for frame in frames])
        lines.append(f"| {name} | {before:,.0f} | {gone:,.0f} | {100 * gone / before:.1f} % |")
    before = np.mean([(frame.depth_m > 0).sum() for frame in frames])
    gone = np.mean([frame.removed.sum() for frame in frames])
    lines.append(f"| all | {before:,.0f} | {gone:,.0f} | {100 * gone / before:.1f} % |")
    return [*lines, "", *(f"* {said}" for said in _shares(frames))]


def _shares(frames: list[Judged]) -> list[str]:
    said = []
    for name, kept in (("before", lambda frame: frame.depth_m), ("after", lambda f: f.clean_m)):
        kinds = np.concatenate([frame.kind[kept(frame) > 0] for frame in frames])
        judged = kinds[kinds != KINDS.index("not judged")]
        shares = [100 * float((judged == number).mean()) for number in range(3)]
        said.append(
            f"{name}: of the judged pixels {shares[0]:.1f} % agree, {shares[1]:.2f} % lie behind, "
            f"{shares[2]:.2f} % in front"
        )
    depths = np.concatenate([frame.depth_m[frame.removed] for frame in frames])
    if len(depths):
        across = np.concatenate([_across(frame.removed) for frame in frames])
        share = float((across >= 1 - RIGHT_SHARE).mean())
        said.append(
            f"{100 * share:.1f} % of the removed pixels lie in the right "
            f"{100 * RIGHT_SHARE:.0f} % of the image"
        )
        low, middle, high = np.percentile(depths, [10, 50, 90])
        said.append(
            f"removed pixels are {middle:.0f} m away (median; a tenth nearer than {low:.0f} m, a "
            f"tenth beyond {high:.0f} m); all pixels "
            f"{np.median(np.concatenate([f.depth_m[f.depth_m > 0] for f in frames])):.0f} m"
        )
    return said


def _across(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far from left (0) to right (1) each set pixel's centre lies."""
    across: NDArray[np.float64] = (np.nonzero(mask)[1] + 0.5) / mask.shape[1]
    return across


def draw(frame: Judged, folder: Path) -> Path:
    """Draw the image, both depths, and what was removed."""
    bgr = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    over = (bgr * 0.6).astype(np.uint8)
    for number, colour in enumerate(COLOURS_BGR):
        over[(frame.kind == number) & frame.removed] = colour
    pictures = [bgr, _coloured(frame.depth_m), _coloured(frame.clean_m), over]
    path = folder / f"{frame.name}.png"
    cv2.imwrite(str(path), np.vstack(pictures))
    return path


def _coloured(depth_m: Depth) -> NDArray[np.uint8]:
    share = 1 - np.log(np.clip(depth_m, 3, 80) / 3) / np.log(80 / 3)
    colours = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_TURBO)
    colours[depth_m == 0] = 0
    return cv2.dilate(colours, np.ones((2, 2), np.uint8))


def main() -> None:
    """Print the table, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("drive", type=Path)
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    frames = judged_frames(asked.drive)
    print("\n".join(table(frames)))
    if asked.pictures:
        asked.pictures.mkdir(parents=True, exist_ok=True)
        for frame in frames:
            print(draw(frame, asked.pictures))


if __name__ == "__main__":
    main()
