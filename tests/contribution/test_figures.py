"""Numbers of a report that can be reckoned by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from civil_rgbd.contribution.charts import Axis, axis_over, histogram, line_chart, tick_words
from civil_rgbd.contribution.figures import depth_figures, spread, track_of
from civil_rgbd.contribution.pictures import scale_colours
from civil_rgbd.format.reader import read_bridge

from ..data.format_v1 import make

BRIDGE = read_bridge(make.HERE / "bridges" / make.BRIDGE_ID)


def test_the_track_is_that_of_the_poses() -> None:
    track = track_of(BRIDGE.rows, (0.0, 0.0, 1.0))

    assert track.plan_m.tolist() == [[0, 0], [7, 0], [12, 0]]
    assert track.spacing_m.tolist() == [7, 5]
    assert track.along_m.tolist() == [0, 7, 12]
    assert track.height_m.tolist() == [0, 0, 0]
    assert track.gap_s == pytest.approx([0.7, 0.5])


def test_up_decides_what_is_seen_from_above() -> None:
    track = track_of(BRIDGE.rows, (-1.0, 0.0, 0.0))

    assert track.height_m.tolist() == [0, -7, -12]
    assert track.plan_m.tolist() == [[0, 0]] * 3


def test_rays_are_the_optical_axis_seen_from_above() -> None:
    forward = make.frame(0).T_map_camera[:3, 2]

    assert track_of(BRIDGE.rows, None).looking[0] == pytest.approx(forward[:2])


def test_depth_is_counted_as_it_is_stored() -> None:
    figures = depth_figures(BRIDGE)
    depths = np.stack([BRIDGE.read_depth(row) for row in BRIDGE.rows])

    assert figures.frames == 3
    assert figures.range_shares.sum() == pytest.approx(1)
    assert figures.density_shares.sum() == pytest.approx(1)
    assert figures.empty_blocks == 0
    assert figures.coverage == pytest.approx((depths > 0).mean(axis=0))
    low, high = np.quantile(depths[depths > 0], [0.02, 0.98])
    assert figures.near_far_m == pytest.approx((low, high), abs=0.1)
    near = depths[depths > 0] <= figures.range_edges_m[10]
    assert figures.range_shares[:10].sum() == pytest.approx(near.mean(), abs=0.02)


def test_a_bridge_without_any_depth_has_figures_too() -> None:
    class Blind:
        rows, camera = BRIDGE.rows, BRIDGE.camera

        @staticmethod
        def read_depth(_: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
            return np.zeros((BRIDGE.camera.height_px, BRIDGE.camera.width_px), np.float32)

    figures = depth_figures(Blind())  # type: ignore[arg-type]  # a bridge of which nothing was measured

    assert figures.empty_blocks == 1
    assert figures.range_shares.sum() == 0


def test_frames_are_spread_from_the_first_to_the_last() -> None:
    rows = [dataclasses.replace(BRIDGE.rows[0], source_index=index) for index in range(10)]

    assert [row.source_index for row in spread(rows, 4)] == [0, 3, 6, 9]
    assert spread(rows, 99) == rows
    assert spread(rows[:1], 6) == rows[:1]


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0, 10, ["0", "2", "4", "6", "8", "10"]),
        (-0.034, 0.004, ["-0.03", "-0.02", "-0.01", "0"]),
        (0, 12_000, ["0", "2,000", "4,000", "6,000", "8,000", "10,000", "12,000"]),
        (1e-7, 2e-7, ["0.0000001", "0.00000012", "0.00000014", "0.00000016", "0.00000018"]),
    ],
)
def test_ticks_are_round(low: float, high: float, words: list[str]) -> None:
    found = tick_words(Axis("", low, high).ticks)

    assert found[: len(words)] == words
    assert 3 <= len(found) <= 8


@pytest.mark.parametrize("values", [[0.0], [5.0, 5.0], [-1e9, 1e9], [1e-12, 2e-12], [1e15, 1e15]])
def test_any_values_can_be_drawn(values: list[float]) -> None:
    y = np.array(values)
    x = np.arange(len(y), dtype=np.float64)
    drawn = line_chart(x, y, axis_over(x, "x"), axis_over(y, "y")) + histogram(
        np.linspace(0, 1, 3), np.array([0.0, 0.0]), "nothing"
    )

    assert "nan" not in drawn
    assert "inf" not in drawn


def test_a_peak_survives_thinning() -> None:
    y = np.zeros(100_000)
    y[54_321] = 7.0
    x = np.arange(len(y), dtype=np.float64)

    drawn = line_chart(x, y, axis_over(x, "x"), Axis("y", 0, 7))

    assert len(drawn) < 100_000
    assert ",12.0" in drawn  # the upper edge


def test_colours_ascend_in_lightness() -> None:
    """So that they can be told apart in grey print, and by eyes that see few colours."""
    lightness = [
        0.2126 * int(colour[1:3], 16) + 0.7152 * int(colour[3:5], 16) + 0.0722 * int(colour[5:], 16)
        for colour in scale_colours(20)
    ]

    assert lightness == sorted(lightness)
    assert lightness[-1] - lightness[0] > 100
