"""Rates, lost messages, silences and clocks, from stamps alone."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.domain.inspection import RecordingSummary, TopicSummary, lateness_drift, timing_of
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.rates import drift_figure, rate_figures, timing_figures

TENTH_NS = 100_000_000


def _figures(role: str, stamps_ns: np.ndarray) -> dict[str, Figure]:
    return {figure.code: figure for figure in rate_figures(role, stamps_ns)}


def test_a_steady_sensor_has_its_rate_and_loses_nothing() -> None:
    found = _figures("lidar", np.arange(100) * TENTH_NS)

    assert found["lidar-rate"].value == pytest.approx(10.0)
    assert found["scans-dropped"].value == 0.0
    assert not any(figure.found for figure in found.values())


def test_lost_scans_are_counted_by_the_room_they_leave() -> None:
    stamps = np.delete(np.arange(100) * TENTH_NS, [10, 30, 31, 50])

    found = _figures("lidar", stamps)

    assert found["scans-dropped"].value == pytest.approx(4.0)
    assert found["scans-dropped"].found
    assert found["lidar-gap"].value == pytest.approx(0.3)
    assert not found["lidar-gap"].found


def test_the_longest_silence_is_found_and_placed() -> None:
    stamps = np.arange(100) * TENTH_NS
    stamps[60:] += 5 * TENTH_NS

    figure = _figures("lidar", stamps)["lidar-gap"]

    assert figure.value == pytest.approx(0.6)
    assert figure.found
    assert figure.detail == "5.9 s after the first"


def test_jitter_and_disorder_of_stamps_lose_nothing() -> None:
    rng = np.random.default_rng(1)
    stamps = np.arange(300) * TENTH_NS // 3 + rng.integers(-9_000_000, 9_000_000, 300)

    found = _figures("image", rng.permutation(stamps))

    assert found["images-dropped"].value == 0.0


def test_a_slow_camera_is_found() -> None:
    assert _figures("image", np.arange(20) * 7 * TENTH_NS)["image-rate"].found


def test_two_messages_show_no_rate() -> None:
    figure = _figures("imu", np.arange(2))["imu-rate"]

    assert figure.value is None
    assert figure.detail == "only 2 messages"
    assert figure.state == "not observable"


def test_a_clock_that_lags_is_seen_through_messages_that_wait() -> None:
    rng = np.random.default_rng(2)
    stamps = np.arange(600) * TENTH_NS
    logged = stamps + rng.exponential(5e6, 600).astype(np.int64) + stamps // 2000  # 0.5 ms/s

    drift = lateness_drift(logged, stamps)

    assert drift is not None
    assert drift[0] == pytest.approx(30e6, abs=1.5e6)
    assert drift[1] < 1.5e6


def test_few_messages_tell_nothing_of_a_clock() -> None:
    assert lateness_drift(np.arange(40), np.arange(40)) is None


def test_a_summary_of_stamps_tells_as_much_as_the_stamps() -> None:
    stamps = np.delete(np.arange(1000) * 5_000_000, np.arange(300, 360))
    timing = timing_of(stamps)
    assert timing is not None

    by_summary = {f.code: f for f in timing_figures("imu", len(stamps), timing)}

    for code, figure in _figures("imu", stamps).items():
        assert by_summary[code].value == pytest.approx(figure.value)
        assert by_summary[code].detail == figure.detail
    assert by_summary["imu-gap"].found
    assert by_summary["imu-dropped"].found


def _topics(lidar: int, image: int, doubt: int = 0) -> dict[str, TopicSummary]:
    return {
        role: TopicSummary(role, "", role, messages=9, lateness_drift_ns=(drift, doubt))
        for role, drift in (("lidar", lidar), ("image", image))
    }


SUMMARY = RecordingSummary("a", "mcap", 0, 0, None, ())


def test_clocks_are_compared_with_each_other_not_with_the_recorders() -> None:
    alike = drift_figure(SUMMARY, _topics(40_000_000, 41_000_000))
    apart = drift_figure(SUMMARY, _topics(40_000_000, 15_000_000))

    assert alike.value == pytest.approx(1.0)
    assert not alike.found
    assert apart.value == pytest.approx(25.0)
    assert apart.found
    assert "the camera's clock runs ahead" in apart.detail


def test_uneven_logging_hides_a_drift_and_says_so() -> None:
    figure = drift_figure(SUMMARY, _topics(0, 30_000_000, doubt=5_000_000))

    assert figure.value is None
    assert "+- 7 ms" in figure.detail


def test_without_log_times_nothing_is_said_of_clocks() -> None:
    assert drift_figure(None, {}).value is None


def _silence(role: str, first_s: float, last_s: float) -> Figure:
    """Ten messages a second, while others record from 0 to 20 s."""
    stamps = np.arange(round(first_s * 10), round(last_s * 10) + 1) * TENTH_NS
    figures = rate_figures(role, stamps, (0, 200 * TENTH_NS))
    return next(figure for figure in figures if figure.code.endswith("-gap"))


@pytest.mark.parametrize("role", ["lidar", "image", "imu"])
def test_a_sensor_silent_at_an_end_is_found(role: str) -> None:
    late, early = _silence(role, 2.0, 20.0), _silence(role, 0.0, 15.0)

    assert late.found
    assert late.value == pytest.approx(2.0)
    assert late.detail == "silent for 2.0 s at the start, while others record"
    assert early.found
    assert early.detail == "silent for 5.0 s at the end, while others record"


def test_silences_at_both_ends_are_both_told() -> None:
    figure = _silence("lidar", 3.0, 18.0)

    assert figure.value == pytest.approx(3.0)
    assert (
        figure.detail == "silent for 3.0 s at the start and 2.0 s at the end, while others record"
    )


def test_drivers_that_start_within_a_second_and_odometry_within_two_are_fit() -> None:
    assert _silence("image", 1.0, 19.0).value == pytest.approx(0.1)
    assert _silence("pose", 2.0, 18.0).value == pytest.approx(0.1)
    assert _silence("pose", 4.0, 20.0).found


def test_silence_at_an_end_is_told_from_a_summary_as_well() -> None:
    stamps = np.arange(2000) * 5_000_000
    timing = timing_of(stamps)
    assert timing is not None

    figures = {f.code: f for f in timing_figures("imu", 2000, timing, (0, 200 * TENTH_NS))}

    assert figures["imu-gap"].value == pytest.approx(10.0, abs=0.01)
    assert figures["imu-gap"].found


def test_sensors_of_different_clocks_are_not_said_to_be_silent() -> None:
    figures = rate_figures("imu", np.arange(300) * TENTH_NS // 10, (10**18, 10**18 + 10**10))

    assert not any(figure.code == "imu-gap" and figure.found for figure in figures)


def _converted(late_ns: int, drift_ns: int) -> TopicSummary:
    late = (late_ns, late_ns, late_ns + abs(drift_ns))
    return TopicSummary(
        "a", "", messages=9, lateness_drift_ns=(drift_ns, 0), log_minus_stamp_ns=late
    )


def test_log_times_made_from_the_stamps_tell_nothing_of_clocks() -> None:
    figure = drift_figure(SUMMARY, {"lidar": _converted(0, 0), "image": _converted(7, 0)})

    assert figure.value is None
    assert "they were made from them" in figure.detail


def test_a_drift_against_even_log_times_is_still_found() -> None:
    topics = {"lidar": _converted(0, 0), "image": _converted(0, 30_000_000)}

    assert drift_figure(SUMMARY, topics).found


def test_clocks_without_drift_neither_lag_nor_lead() -> None:
    assert "keeps up with" in drift_figure(SUMMARY, _topics(0, 0)).detail
