"""Are the images well exposed and sharp? Some of them are looked at, small; the first ones all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recording import Recording
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.views import Viewer, small_grey

_LOOKED_AT: Final = 60
_START_S: Final = 4.0
_START_STEP_NS: Final = 130_000_000
_SETTLED_S: Final = (2.5, 5.0)
_WHITE: Final = 250
_MOST_WHITE: Final = 0.35  # skies of a bridge site are white, and a third of the image at most
_BRIGHTER: Final = 1.25
_AVERAGE_PX: Final = 9
_STRONGEST: Final = 0.05
_FLAT: Final = 6.0  # grey levels: an image without any stronger edge shows nothing to judge
_SMEARED: Final = 0.4
"""Of sharp images 0.1 to 0.25; 0.4 is a Gaussian blur of 2 pixels in 1280, or motion over 18."""


@dataclass(frozen=True, slots=True, eq=False)
class PictureSamples:
    """What was seen of some images, in order of their stamps.

    Attributes:
        seconds: (L,) since the first image.
        white: (L,) share of pixels without any drawing left.
        brightness: (L,) mean grey level.
        smear: (L,) how much of the strongest edges an average over 9 pixels leaves; NaN without.
        broken: how many could not be decoded.
    """

    seconds: NDArray[np.float64]
    white: NDArray[np.float64]
    brightness: NDArray[np.float64]
    smear: NDArray[np.float64]
    broken: int


def look_at_pictures(recording: Recording, viewer: Viewer) -> PictureSamples:
    """Look at the images of the first seconds, and at some of the rest."""
    stamps_ns = recording.image_stamps_ns
    order = np.argsort(stamps_ns, kind="stable")
    seconds = (stamps_ns[order] - stamps_ns[order[0]]) / NS_PER_S
    rows, broken = [], 0
    for place in _chosen(seconds):
        small = small_grey(recording, int(order[place]), viewer.reduction)
        if small is None:
            broken += 1
            continue
        white = float((small >= _WHITE).mean())
        rows.append((seconds[place], white, float(small.mean()), smear_of(small)))
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return PictureSamples(table[:, 0], table[:, 1], table[:, 2], table[:, 3], broken)


def _chosen(seconds: NDArray[np.float64]) -> list[int]:
    early: list[int] = []
    next_s = 0.0
    for place in range(int(np.searchsorted(seconds, _START_S))):
        if seconds[place] >= next_s:
            early.append(place)
            next_s = seconds[place] + _START_STEP_NS / NS_PER_S
    rest = np.linspace(0, len(seconds) - 1, min(_LOOKED_AT, len(seconds))).round().astype(int)
    return sorted({*early, *rest.tolist()})


def smear_of(grey: NDArray[np.uint8]) -> float:
    """Say how smeared the strongest edges are: 0 = one pixel wide, 1 = wider than can be told.

    An average over a few pixels takes most of a sharp edge's slope, and hardly any of a blurred
    one's (Crete 2007). Motion blurs along one axis: the more smeared one counts.

    Args:
        grey: (H, W) uint8.

    Returns:
        NaN where there is no edge to speak of.
    """
    if int(grey.max()) - int(grey.min()) < _FLAT:
        return float("nan")
    worst = np.nan
    for across in (grey, cv2.transpose(grey)):
        # Slopes along every third row: the strongest of so many are the strongest of all.
        values = np.ascontiguousarray(across[1::3], dtype=np.float32)
        slopes = cv2.absdiff(values[:, 1:], values[:, :-1])
        average = cv2.blur(values, (_AVERAGE_PX, 1))
        after = cv2.absdiff(average[:, 1:], average[:, :-1])
        least = float(np.quantile(slopes[:, ::3], 1 - _STRONGEST))
        strong = slopes >= max(least, 1.0)
        if strong.any():
            worst = np.fmax(worst, float(after[strong].sum() / slopes[strong].sum()))
    return float(worst)


def picture_figures(samples: PictureSamples) -> Iterator[Figure]:
    """Judge exposure and sharpness.

    Args:
        samples: from :func:`look_at_pictures`.
    """
    if not len(samples.seconds):
        for code in ("overexposed-start", "overexposed", "blurred"):
            yield Figure(code, None, f"none of {samples.broken} images could be decoded")
        return
    cut = _settled_at(samples)
    cut_s = float(samples.seconds[cut]) if cut < len(samples.seconds) else 0.0
    yield Figure(
        "overexposed-start",
        cut_s,
        f"until {cut_s:.2f} s after the first image" if cut_s else "",
        fix=f"leave the first {cut_s:.1f} s out: start the poses there, or cut the recording; next "
        "time let the camera run for two seconds before recording",
    )
    rest = samples.white[cut:] if cut < len(samples.white) else samples.white
    over = rest > _MOST_WHITE
    share = f"{int(over.sum())} of {len(rest)} looked at"
    yield Figure("overexposed", 100 * float(over.mean()), share)
    judged = samples.smear[cut if cut < len(samples.smear) else 0 :]
    judged = judged[np.isfinite(judged)]
    if not len(judged):
        yield Figure("blurred", None, "no image has an edge to judge by")
        return
    smeared = judged > _SMEARED
    said = f"{int(smeared.sum())} of {len(judged)} looked at; median smear {np.median(judged):.2f}"
    yield Figure("blurred", 100 * float(smeared.mean()), said)


def _settled_at(samples: PictureSamples) -> int:
    """Return the first image of the start that is exposed as those some seconds later are."""
    seconds = samples.seconds
    settled = (seconds >= _SETTLED_S[0]) & (seconds <= _SETTLED_S[1])
    usual = float(np.median(samples.brightness[settled])) if settled.any() else np.inf
    for place in np.flatnonzero(seconds < _START_S).tolist():
        white = samples.white[place]
        brighter = samples.brightness[place] > _BRIGHTER * usual and white > 2 * _usual_white(
            samples, settled
        )
        if not brighter and white <= _MOST_WHITE:
            return int(place)
    return 0 if not settled.any() else len(seconds)


def _usual_white(samples: PictureSamples, settled: NDArray[np.bool_]) -> float:
    return float(np.median(samples.white[settled])) + 0.01 if settled.any() else 1.0
