"""What a user types becomes a spec, or a clear refusal."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.errors import UsageError
from civil_rgbd.simulator.spec import (
    ScanSpec,
    spec_from_location,
    spec_from_settings,
    usual_spec,
)


def test_a_location_gives_bridge_and_settings() -> None:
    spec = spec_from_location("simulated:demo?seconds=6&seed=1&range_noise_m=0.02")

    assert spec == ScanSpec(bridge="demo", seconds=6.0, seed=1, range_noise_m=0.02)


def test_a_location_without_a_bridge_is_the_demo() -> None:
    assert spec_from_location("simulated:") == ScanSpec()


def test_equal_specs_hash_alike_and_others_do_not() -> None:
    assert ScanSpec(seed=1).sha256() == ScanSpec(seed=1).sha256()
    assert ScanSpec(seed=1).sha256() != ScanSpec(seed=2).sha256()


@pytest.mark.parametrize(
    ("location", "what", "fix"),
    [
        ("simulated:dmo", "'dmo'", "did you mean 'demo'"),
        ("simulated:demo?second=6", "'second'", "did you mean 'seconds'"),
        ("simulated:demo?seconds=six", "'six', not a number", "give a number"),
        ("simulated:demo?seed=1.5", "'1.5', not a whole number", "give a whole number"),
        ("simulated:demo?seconds=-1", "seconds is -1.0", "such a value"),
        ("simulated:demo?seconds=nan", "seconds is nan", "such a value"),
        ("simulated:demo?range_noise_m=inf", "range_noise_m is inf", "such a value"),
        ("simulated:demo?point_rate_hz=1000", "not a multiple of 60", "such a value"),
        ("simulated:demo?seconds", "'seconds' are not of the form", "seconds=6&seed=1"),
        ("simulated:demo?map_offset_m=1", "'map_offset_m'", "Known"),
    ],
)
def test_a_location_that_does_not_fit_is_refused(location: str, what: str, fix: str) -> None:
    with pytest.raises(UsageError) as caught:
        spec_from_location(location)

    assert what in caught.value.what
    assert fix in caught.value.fix
    assert caught.value.where == location


def test_settings_may_be_numbers_already() -> None:
    assert spec_from_settings({"seconds": 2, "seed": 3}, where="a test") == ScanSpec(
        seconds=2.0, seed=3
    )


def test_a_spec_refuses_an_offset_that_is_not_finite() -> None:
    with pytest.raises(ValueError, match="map_offset_m"):
        ScanSpec(map_offset_m=(0.0, float("nan"), 0.0))


def test_the_demo_is_exact_and_the_other_bridges_are_scanned_as_in_the_field() -> None:
    assert usual_spec("demo") == ScanSpec()
    for bridge in ("B1", "B2", "B3", "B4", "B5"):
        spec = usual_spec(bridge)
        assert spec.bridge == bridge
        assert (spec.pattern, spec.image_rate_hz, spec.range_noise_m) == ("avia", 30.0, 0.02)
        assert spec.stands_s > 0
        assert min(spec.imu_noise, spec.drift_m_per_root_s, spec.yaw_drift_deg_per_root_s) > 0
        assert (spec.camera_time_offset_s, spec.exposure_settles_s) == (0.0, 0.0)  # on request


def test_what_is_asked_for_wins_over_what_is_usual() -> None:
    spec = spec_from_location("simulated:B3?drift_m_per_root_s=0&seconds=4")

    assert (spec.drift_m_per_root_s, spec.seconds, spec.pattern) == (0.0, 4.0, "avia")


def test_settings_younger_than_the_demo_leave_its_text_alone() -> None:
    assert set(ScanSpec().document()) == {
        "bridge", "camera_time_offset_s", "extrinsic_error_deg", "extrinsic_error_m",
        "false_return_share", "image_rate_hz", "image_scale", "jpeg_quality", "map_offset_m",
        "max_range_m", "min_range_m", "point_rate_hz", "range_noise_m", "seconds", "seed",
        "speed_m_s",
    }  # fmt: skip
    assert ScanSpec(sway=2.0).document()["sway"] == 2.0


def test_an_unknown_pattern_is_refused() -> None:
    with pytest.raises(UsageError, match="pattern is 'mid360', not one of rosette, avia"):
        spec_from_location("simulated:demo?pattern=mid360")


def test_every_setting_stands_in_the_docs_with_what_is_usual() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulator.md").read_text(encoding="utf-8")
    demo, field = usual_spec("demo"), usual_spec("B1")
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `")]
    told = {
        name.strip(" `"): (exact.strip(" `"), usual.strip(" `"))
        for _, names, demos, fields_, *_ in rows
        for name, exact, usual in zip(
            names.split(","), _spread(demos, names), _spread(fields_, names), strict=True
        )
    }

    assert set(told) == set(ScanSpec.__slots__) - {"bridge"}
    for name, values in told.items():
        for text, value in zip(values, (getattr(demo, name), getattr(field, name)), strict=True):
            plain = value[0] if isinstance(value, tuple) else value
            assert text == (plain if isinstance(plain, str) else f"{plain:.10g}"), name


def _spread(cell: str, names: str) -> list[str]:
    values, count = cell.split(","), len(names.split(","))
    return values if len(values) == count else values * count
