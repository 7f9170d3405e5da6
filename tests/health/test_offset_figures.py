"""Figures of the clocks: no number to write down where none fits, and the larger of two."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.constancy import Change
from civil_rgbd.health.offset_figures import change_figures, largest_of_each, offset_figure
from civil_rgbd.health.turning import TimeOffset

DRIFT = Change(0.043, 0.004, certain=True, words="it changes by +43 ms from start to end")


@pytest.fixture(scope="module")
def recording(turning_walk: Path) -> Recording:
    """The walk, whose rig knows of no offset."""
    return open_recording(turning_walk)


def test_one_number_is_printed_where_one_fits(recording: Recording) -> None:
    figure = offset_figure(recording, TimeOffset(0.03, 0.001, 0.4))

    assert figure.found
    assert figure.fix == "write camera_time_offset_s = 0.0300 into the rig file (--rig)"


def test_no_number_is_printed_where_the_clock_drifts(recording: Recording) -> None:
    figure = offset_figure(recording, TimeOffset(0.03, 0.001, 0.4, change=DRIFT))

    assert "camera_time_offset_s" not in figure.fix
    assert figure.fix.startswith("no single number fits: it changes by +43 ms")


def test_a_certain_change_is_more_than_log_times_that_say_nothing() -> None:
    logged = Figure("clock-drift", 0.0)

    (kept,) = largest_of_each([logged, *change_figures(DRIFT)])

    assert kept.found
    assert kept.value == pytest.approx(43)
    assert "by how images and poses turn" in kept.detail


@pytest.mark.parametrize(
    "change", [Change(), Change(0.03, 0.01), Change(0.008, 0.001, certain=True)]
)
def test_what_is_unsure_or_small_is_no_figure(change: Change) -> None:
    assert not list(change_figures(change))


def test_a_known_figure_is_kept_before_one_that_is_not() -> None:
    unknown, known = Figure("clock-drift", None, "no log times"), Figure("clock-drift", 2.0)

    assert largest_of_each([unknown, known]) == [known]
    assert largest_of_each([known, unknown]) == [known]
