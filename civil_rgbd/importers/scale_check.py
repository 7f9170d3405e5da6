"""Which depth scale do the poses prove? A wrong one moves points as the camera moves.

The depth of one frame is carried by the poses into another one. With the right scale both depths
agree; with a wrong one they differ, the more the further the camera moved. Depths that look
plausible prove nothing: 256 and 1000 units a metre differ by less than bridges do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.geometry.transforms import compose, inverse, transform_points
from civil_rgbd.importers.frame_reader import FrameReader
from civil_rgbd.importers.rendered_set import RenderedSet, SetFrame

SCALES: Final = (256.0, 1000.0, 5000.0)
"""KITTI's, millimetres, TUM's: the scales that 16-bit depth is stored with."""

_ANCHORS: Final = 8
_STEPS: Final = (1, 3, 10, 30)
_POINTS: Final = 4000
_FEWEST_POINTS: Final = 50
_AGREES: Final = 0.03
_CLEARLY_WORSE: Final = 2.5
_LEAST_DIFFERENCE: Final = 0.004
_WORSE: Final = 1.5  # to ask costs an answer, to take a wrong scale costs the set
_DOUBTFUL: Final = 0.02
_ROUGHLY: Final = 0.1
_NO_OVERLAP: Final = 1.0


@dataclass(frozen=True, slots=True)
class ScaleEvidence:
    """What the poses say about the depth.

    Attributes:
        differences: by scale: the median difference of two frames' depths as a share of depth, over
            all pairs of frames; 1 where they do not overlap at all.
        pairs: pairs of frames that were compared.
        proven: the scale that the poses prove; None where they do not tell.
        inverse_difference: at the best scale, with every pose the other way round.
    """

    differences: dict[float, float]
    pairs: int
    proven: float | None
    inverse_difference: float

    @property
    def best(self) -> float | None:
        """The scale that fits best; None where nothing was compared."""
        return min(self.differences, key=self.differences.__getitem__) if self.pairs else None

    def contradicts(self, scale: float) -> bool:
        """Whether the poses speak against a scale, even where they prove no other.

        A camera or a lens that is not the set's spoils every scale, and a wrong scale still most.
        """
        if self.best is None:
            return False
        found, best = self.differences[scale], self.differences[self.best]
        return found > _WORSE * best and found - best > _DOUBTFUL

    @property
    def poses_are_inverted(self) -> bool:
        """Whether poses the other way round explain the depth, and those given do not."""
        if self.best is None:
            return False
        given = self.differences[self.best]
        return self.inverse_difference < _AGREES and given > _CLEARLY_WORSE * max(
            self.inverse_difference, _LEAST_DIFFERENCE
        )

    def words(self) -> str:
        """Say it in one sentence."""
        if not self.pairs:
            return "no two frames overlap: the poses cannot tell the depth scale"
        found = ", ".join(f"x {scale:g}: {share:.2%}" for scale, share in self.differences.items())
        verdict = f"they prove x {self.proven:g}" if self.proven else "they do not tell"
        return f"depths of {self.pairs} pairs of frames differ by ({found}); {verdict}"


def weigh_scales(
    opened: RenderedSet, reader: FrameReader, scales: Sequence[float]
) -> ScaleEvidence:
    """Compare overlapping frames under each scale.

    Args:
        opened: the set.
        reader: decodes its depth.
        scales: stored units a metre.

    Returns:
        the evidence; without pairs where no two frames can be compared.
    """
    wanted = tuple(dict.fromkeys(scales))
    depths: dict[int, NDArray[np.uint16] | None] = {}
    rows, turned = [], []
    for i, j in _pairs(len(opened.frames)):
        a, b = (_depth(opened.frames[k], k, reader, depths) for k in (i, j))
        if a is None or b is None:
            continue
        T_map_a, T_map_b = opened.frames[i].T_map_camera, opened.frames[j].T_map_camera
        T_b_a, T_b_a_turned = compose(inverse(T_map_b), T_map_a), compose(T_map_b, inverse(T_map_a))
        rows.append([_difference(reader, a, b, T_b_a, scale) for scale in wanted])
        turned.append([_difference(reader, a, b, T_b_a_turned, scale) for scale in wanted])
    given, pairs = _pooled(rows)
    other, _ = _pooled(turned)
    if not pairs:
        return ScaleEvidence(dict.fromkeys(wanted, _NO_OVERLAP), 0, None, _NO_OVERLAP)
    differences = dict(zip(wanted, given, strict=True))
    return ScaleEvidence(differences, pairs, _proven(differences), min(other, default=_NO_OVERLAP))


def _proven(differences: dict[float, float]) -> float | None:
    order = sorted(differences, key=differences.__getitem__)
    best = differences[order[0]]
    if best > _AGREES or len(order) < 2:
        return None
    second = differences[order[1]]
    clear = second > _CLEARLY_WORSE * best and second - best > _LEAST_DIFFERENCE
    return order[0] if clear else None


def _pairs(count: int) -> list[tuple[int, int]]:
    """Frames to compare: some all along the set, each with near and far neighbours."""
    anchors = np.unique(np.linspace(0, max(count - 1, 0), _ANCHORS).astype(int)).tolist()
    found = {
        (min(i, j), max(i, j))
        for i in anchors
        for step in _STEPS
        for j in (i + step, i - step)
        if 0 <= j < count and i != j
    }
    return sorted(found)


def _depth(
    frame: SetFrame, place: int, reader: FrameReader, read: dict[int, NDArray[np.uint16] | None]
) -> NDArray[np.uint16] | None:
    if place not in read:
        try:
            read[place] = reader.raw_depth(frame)
        except RecordingError:
            read[place] = None  # counted when its turn to be converted comes
    return read[place]


def _difference(
    reader: FrameReader,
    a: NDArray[np.uint16],
    b: NDArray[np.uint16],
    T_b_a: NDArray[np.float64],
    scale: float,
) -> float:
    """Median of |depth carried over - depth there| / depth; NaN where too few points meet one."""
    camera = reader.camera
    v, u = np.nonzero(a)
    step = max(1, len(v) // _POINTS)
    v, u = v[::step], u[::step]
    z = reader.depth_m(a, scale=scale)[v, u]
    points_b = transform_points(T_b_a, _lift(camera, u, v, z))
    in_front = points_b[:, 2] > 0
    x, y, z = points_b[in_front].T
    columns = np.floor(x / z * camera.fx_px + camera.cx_px + 0.5)
    rows = np.floor(y / z * camera.fy_px + camera.cy_px + 0.5)
    inside = (columns >= 0) & (columns < camera.width_px) & (rows >= 0) & (rows < camera.height_px)
    columns, rows = columns[inside].astype(np.intp), rows[inside].astype(np.intp)
    there = reader.depth_m(b, scale=scale)[rows, columns]
    known = there > 0
    if int(known.sum()) < _FEWEST_POINTS:
        return float("nan")
    return float(np.median(np.abs(there[known] / z[inside][known] - 1.0)))


def _lift(
    camera: PinholeCamera, u: NDArray[np.intp], v: NDArray[np.intp], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    x = (u - camera.cx_px) / camera.fx_px * z
    y = (v - camera.cy_px) / camera.fy_px * z
    return np.stack([x, y, z], axis=1)


def _pooled(rows: Sequence[Sequence[float]]) -> tuple[list[float], int]:
    """One number a scale over all pairs of frames.

    A pair tells something where at least one scale makes its frames roughly agree; scales under
    which they do not even meet are as wrong as can be. Of these pairs the half that tells the
    scales apart best is kept: frames from one place agree under any scale.
    """
    if not rows:
        return [], 0
    table = np.array(rows, dtype=np.float64)
    filled = np.where(np.isfinite(table), table, _NO_OVERLAP)
    agreeing = filled[filled.min(axis=1) < _ROUGHLY]
    met = int((filled.min(axis=1) < _NO_OVERLAP).sum())
    filled = agreeing if len(agreeing) else filled
    spread = filled.max(axis=1) - filled.min(axis=1)
    telling = filled[np.argsort(-spread, kind="stable")[: max(1, (len(filled) + 1) // 2)]]
    return [float(value) for value in np.median(telling, axis=0)], met
