"""Hollows are cut out of a panel without a gap, exactly as planned."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.scene import SKY, RayCaster, Scene
from civil_rgbd.simulator.spall import Panel, SpallPlan, spalled

WALL = Panel(
    "abutment",
    "wall",
    np.array([2.0, -3.0, 0.5]),
    np.array([-1.0, 0.0, 0.0]),
    np.array([0.0, 0.0, 1.0]),
    (4.0, 3.0),
)
PLANS = (
    SpallPlan("a", (1.0, 1.2), 0.9, 0.4, 0.06, 1),
    SpallPlan("b", (2.7, 0.8), 0.2, 0.5, 0.03, 2),
    SpallPlan("c", (2.9, 2.2), 0.5, 0.5, 0.10, 3),
)


def test_a_panel_without_plans_is_one_face() -> None:
    faces, spalls = spalled(WALL, ())

    assert len(faces) == 1
    assert faces[0].normal.tolist() == [0.0, 1.0, 0.0]
    assert spalls == []


def test_a_spalled_panel_has_no_gap_and_covers_its_rectangle_once() -> None:
    faces, _ = spalled(WALL, PLANS)
    caster = RayCaster(Scene("t", tuple(faces)))
    rng = np.random.default_rng(4)
    n = 20_000
    starts = np.stack(
        [rng.uniform(-1.999, 1.999, n), np.zeros(n), rng.uniform(0.501, 3.499, n)], axis=1
    )
    distances, triangles = caster.distances(starts, np.tile([0.0, -1.0, 0.0], (n, 1)))
    areas = sum(
        float(np.abs(np.cross(c[k] - c[0], c[k + 1] - c[0])[1])) / 2
        for c in (face.corners_m for face in faces)
        for k in range(1, len(c) - 1)
    )

    assert (triangles != SKY).all()
    assert distances.min() == pytest.approx(3.0, abs=1e-12)
    assert distances.max() <= 3.10 + 1e-12
    assert areas == pytest.approx(4.0 * 3.0, rel=1e-9)  # seen from the front, nothing overlaps
    assert all(face.normal[1] > 0 for face in faces)  # every face looks out of the wall


def test_the_share_that_lies_deeper_is_the_area_that_the_truth_states() -> None:
    faces, spalls = spalled(WALL, PLANS)
    caster = RayCaster(Scene("t", tuple(faces)))
    a, b = np.meshgrid(np.arange(0.005, 4, 0.01), np.arange(0.005, 3, 0.01))
    starts = WALL.point(a.ravel(), b.ravel()) + np.array([0.0, 1.0, 0.0])
    distances, _ = caster.distances(starts, np.tile([0.0, -1.0, 0.0], (len(starts), 1)))
    deeper = float((distances > 1 + 1e-9).mean()) * 12.0

    assert deeper == pytest.approx(sum(spall.area_m2 for spall in spalls), rel=0.01)


def test_equal_plans_give_equal_spalls_and_another_seed_another_outline() -> None:
    first, again = (spalled(WALL, PLANS)[1] for _ in range(2))
    other = spalled(WALL, (SpallPlan("a", (1.0, 1.2), 0.9, 0.4, 0.06, 7),))[1]
    by_name = {spall.name: spall for spall in first}

    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.outline_m, two.outline_m)
    assert not np.array_equal(by_name["a"].outline_m, other[0].outline_m)
    assert other[0].length_m == by_name["a"].length_m


@pytest.mark.parametrize(
    ("plans", "what"),
    [
        ((SpallPlan("a", (0.2, 1.0), 0.5, 0.2, 0.05, 1),), "does not fit"),
        ((PLANS[0], SpallPlan("d", (1.3, 1.3), 0.4, 0.4, 0.05, 1)), "in another one's way"),
    ],
)
def test_a_spall_that_does_not_fit_is_refused(plans: tuple[SpallPlan, ...], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        spalled(WALL, plans)


@pytest.mark.parametrize(
    ("size_m", "severity"),
    [(0.149, "light"), (0.15, "medium"), (0.30, "severe"), (0.60, "very severe")],
)
def test_severity_goes_by_the_largest_dimension(size_m: float, severity: str) -> None:
    plan = SpallPlan("a", (2.0, 1.5), 0.1, size_m, 0.05, 1)

    assert spalled(WALL, (plan,))[1][0].severity == severity
