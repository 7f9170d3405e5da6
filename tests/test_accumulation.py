"""The page on accumulation says what was measured, and what measures still runs and holds."""

from __future__ import annotations

import importlib
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from civil_rgbd.builder.recipes import load_recipe

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "accumulation.md"
FIGURES = ROOT / "docs" / "accumulation"


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> dict[str, ModuleType]:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")  # as the scripts set them when they are imported: undone here
    return {
        name: importlib.import_module(f"accumulation{name and '_'}{name}")
        for name in ("", "scenes", "table", "page", "plots")
    }


def test_the_experiment_runs_from_end_to_end_and_goes_on_where_it_was(
    tmp_path: Path, modules: dict[str, ModuleType], capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib", reason="plots ask for the extra bench")
    page = PAGE.read_text("utf-8")
    run = modules[""].main
    options = ["--quick", "--out", str(tmp_path / "out"), "--scratch", str(tmp_path / "scratch")]

    assert run(options) == 0
    printed = capsys.readouterr().out
    table = tmp_path / "out" / "conditions.csv"
    first, stored = table.read_bytes(), sorted((tmp_path / "scratch").glob("*.json"))
    times = [path.stat().st_mtime_ns for path in stored]
    stored[0].unlink()  # killed before this one
    assert run(options) == 0

    again = [path.stat().st_mtime_ns for path in stored]
    assert len(stored) == 4
    assert again[1:] == times[1:]
    assert again[0] != times[0]
    assert table.read_bytes() == first
    assert PAGE.read_text("utf-8") == page
    plots = sorted((tmp_path / "out").glob("*.png"))
    assert sorted(printed.splitlines()) == [str(plot) for plot in plots]
    assert [plot.stem for plot in plots] == sorted(plot.name for plot in modules["plots"].PLOTS)
    rows = modules["table"].read_rows(table)
    _relations_hold(modules, rows)
    before, after = (
        modules["table"].mean(modules["table"].chosen(rows, points=25_000, filtering=name), "leak")
        for name in ("off", "on")
    )
    assert after < 0.05 * before  # 25,000 points alone show no front: it takes those that may hide


def _relations_hold(modules: dict[str, ModuleType], rows: list) -> None:  # type: ignore[type-arg]  # rows of a script
    """What must be so, whatever the scene: of every bridge, window, motion, traffic and drift."""
    values = modules["table"].values
    by_points = {(row.scene, row.window, row.filter, row.points): row for row in rows}
    points = sorted({row.points for row in rows})
    for (scene, window, filtering, count), row in by_points.items():
        assert 0 < row.coverage < row.solid + 0.02
        assert sum(values([row], name)[scene.bridge] for name in ("good", "leak", "ghost")) == (
            pytest.approx(1.0, abs=1e-3)
        )
        if filtering != "off":
            before = by_points[scene, window, "off", count]
            assert row.coverage <= before.coverage
            # Pixels, not shares of what is left; five digits are stored.
            assert row.leak * row.coverage <= before.leak * before.coverage * 1.001
            assert row.lost >= before.lost == 0
            assert row.span_s == before.span_s
    for scene, count in {(key[0], key[3]) for key in by_points}:
        windows = [
            by_points[scene, window, "off", count] for window in ("past", "centred", "future")
        ]
        assert len({(row.coverage, row.median_m) for row in windows}) == 3
    for fewer, more in pairwise(points):
        for scene, window in {key[:2] for key in by_points}:
            low, high = (by_points[scene, window, "off", count] for count in (fewer, more))
            assert low.coverage < high.coverage
            assert low.span_s < high.span_s


def test_the_tables_of_the_page_are_those_of_the_figures(modules: dict[str, ModuleType]) -> None:
    text = PAGE.read_text("utf-8")
    rows = modules["table"].read_rows(FIGURES / "conditions.csv")

    assert modules["page"].renewed(text, rows) == text, "run benchmarks/accumulation.py --page-only"


def test_a_page_without_a_place_for_a_table_is_refused(modules: dict[str, ModuleType]) -> None:
    rows = modules["table"].read_rows(FIGURES / "conditions.csv")

    with pytest.raises(ValueError, match="0 places for the table 'frames'"):
        modules["page"].renewed("nothing", rows)


def test_every_condition_was_measured_on_every_bridge(modules: dict[str, ModuleType]) -> None:
    scenes = modules["scenes"]
    rows = modules["table"].read_rows(FIGURES / "conditions.csv")
    found = {(row.scene, row.window, row.points, row.filter) for row in rows}
    effort = scenes.Effort()

    assert found == {
        (scene, *condition)
        for scene in scenes.scenes(effort)
        for condition in scenes.conditions(effort)
    }
    assert len(rows) == len(found) == 5 * 2 * 4 * 3 * (7 * 2 + 2)
    assert {row.frames for row in rows if row.scene.motion == "walking"} == {effort.images}
    assert {row.frames for row in rows if row.scene.motion == "still"} == {effort.places}
    _relations_hold(modules, rows)


def test_figures_survive_the_file(modules: dict[str, ModuleType], tmp_path: Path) -> None:
    table = modules["table"]
    rows = table.read_rows(FIGURES / "conditions.csv")[::97]
    table.write_rows(tmp_path / "some.csv", rows)

    assert table.read_rows(tmp_path / "some.csv") == rows
    assert len({row.filter for row in rows}) == 3


def test_every_plot_is_small_and_on_the_page(modules: dict[str, ModuleType]) -> None:
    text = PAGE.read_text("utf-8")
    plots = {plot.name: FIGURES / f"{plot.name}.png" for plot in modules["plots"].PLOTS}

    assert {path.stem for path in FIGURES.glob("*.png")} == set(plots)
    for name, path in plots.items():
        assert path.stat().st_size < 100_000
        assert f"](accumulation/{name}.png)" in text


def test_the_recipes_of_the_page_are_those_that_ship(modules: dict[str, ModuleType]) -> None:
    for names, (points, filtering) in modules["page"].RECIPES.items():
        plain, _, setting = names.partition(" --set ")
        for name in plain.split(", "):
            recipe = load_recipe(name, [setting] if setting else [])
            assert (recipe.accumulate.points, recipe.accumulate.window) == (points, "past")
            assert (recipe.visibility is not None) == (filtering == "on")


def test_a_score_is_what_it_says(modules: dict[str, ModuleType]) -> None:
    truth_m = np.array([[10.0, 10.0, 10.0, 0.0], [20.0, 20.0, 20.0, 20.0]])
    depth_m = np.array([[11.0, 0.0, 10.0, 5.0], [0.0, 0.0, 23.0, 20.0]], dtype=np.float32)
    leak, good = (np.zeros((2, 4), dtype=np.bool_) for _ in range(2))
    leak[1, 2] = True
    good[0, 2] = good[1, 3] = good[0, 1] = True  # one of them is removed

    span, solid, coverage, *errors, valid, leaks, stays, before = modules["scenes"]._score(
        depth_m, truth_m, leak=leak, good=good, span_s=1.5
    )

    assert (span, solid, coverage) == (1.5, 7 / 8, 5 / 8)
    # Errors are 1, 0, 3 and 0 m; the sky has no depth to compare with.
    assert errors == pytest.approx([(0.1 + 0.15) / 4, np.sqrt(10 / 4), 0.5])
    assert (valid, leaks, stays, before) == (5, 1, 2, 3)


def test_a_stand_is_where_the_walk_is_looked_at(modules: dict[str, ModuleType]) -> None:
    from civil_rgbd.simulator.walk import START_NS, imu_poses

    scenes = modules["scenes"]
    effort = scenes.Effort(places=2)
    ((walk, instants_s),) = scenes.recordings(scenes.Scene("B3", "walking", "none", "none"), effort)
    stands = list(scenes.recordings(scenes.Scene("B3", "still", "none", "poor"), effort))

    walked = imu_poses(walk, START_NS + 10**9 * np.array(instants_s, dtype=np.int64))[0]
    assert len(stands) == 2
    assert len({walk.seed, *(spec.seed for spec, _ in stands)}) == 3
    for (spec, (instant_s,)), place in zip(stands, walked[:: effort.images // 2], strict=True):
        here = imu_poses(spec, np.array([START_NS + instant_s * 10**9]))[0][0]
        assert np.linalg.norm(here - place) < 0.1  # a step's bob and sway
        assert spec.drift_m_per_root_s == scenes.DRIFTS["poor"][0] > walk.drift_m_per_root_s == 0


def test_a_quick_run_never_touches_the_figures_of_the_page(
    modules: dict[str, ModuleType], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        modules[""].main(["--quick"])

    assert "--quick wants an --out of its own" in capsys.readouterr().err


def test_the_figures_in_the_sentences_are_those_of_the_rows(modules: dict[str, ModuleType]) -> None:
    chosen, mean = modules["table"].chosen, modules["table"].mean
    rows = modules["table"].read_rows(FIGURES / "conditions.csv")
    text = " ".join(PAGE.read_text("utf-8").split())

    def of(measure: str, points: int, times: float = 100, **condition: object) -> float:
        return float(times * mean(chosen(rows, points=points, **condition), measure))

    covered = [of("coverage", points) for points in (50_000, 250_000, 1_000_000, 2_000_000)]
    assert (
        "{:.0f} % of the pixels with 50,000, {:.0f} % with 250,000, {:.0f} % with 1,000,000, "
        "{:.0f} % with 2,000,000"
    ).format(*covered) in text
    medians = [
        [of("median_m", points, drift=drift, filtering="on") for drift in ("none", "usual", "poor")]
        for points in (250_000, 1_000_000)
    ]
    assert (
        "is {:.1f} cm with exact poses, {:.1f} cm with usual drift, {:.1f} cm with poor one"
    ).format(*medians[0]) in text
    assert "it is {:.1f}, {:.1f} and {:.1f} cm".format(*medians[1]) in text
    plain, clean = ({"filtering": name, "points": 250_000} for name in ("off", "on"))
    assert f"removes {100 - of('leak', **clean) / of('leak', **plain) * 100:.0f} %" in text
    assert of("abs_rel", **clean) / of("abs_rel", **plain) == pytest.approx(0.5, abs=0.02)
    lost = [of("lost", **clean, traffic=traffic) for traffic in ("none", "moving")]
    assert "takes {:.1f} % of the good pixels, or {:.1f} % where".format(*lost) in text
    later = of("leak", 250_000, window="future") / of("leak", 250_000)
    assert later == pytest.approx(4, abs=0.3)
    assert "let four times as many pixels see through" in text
    standing = [
        of(measure, points, motion="still")
        for measure in ("coverage", "median_m")
        for points in (500_000, 2_000_000)
    ]
    assert (
        "coverage rises from {:.0f} to {:.0f} %, the median error from {:.1f} to {:.1f} cm"
    ).format(*standing) in text
