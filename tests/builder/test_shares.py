"""Shares cover every frame once, however many bridges and parts there are."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.builder.shares import Share, share_from
from civil_rgbd.errors import UsageError


@given(st.lists(st.integers(0, 50), min_size=1, max_size=6), st.integers(1, 40))
def test_the_parts_of_every_bridge_follow_each_other_without_gap(
    bridges: list[int], parts: int
) -> None:
    for place, frames in enumerate(bridges):
        at = 0
        for number in range(1, parts + 1):
            share = Share(number, parts)
            first, stop = share.frames_of(frames, bridge=place, bridges=len(bridges))
            assert first <= stop
            if share.touches(bridge=place, bridges=len(bridges)):
                assert first == at
                at = stop
            else:
                assert first == stop
        assert at == frames


@given(st.integers(1, 6), st.integers(1, 40))
def test_a_part_opens_few_recordings(bridges: int, parts: int) -> None:
    for number in range(1, parts + 1):
        touched = [Share(number, parts).touches(bridge=b, bridges=bridges) for b in range(bridges)]
        assert 1 <= sum(touched) <= bridges // parts + 2


@pytest.mark.parametrize("text", ["0/4", "5/4", "1/0"])
def test_parts_count_from_one(text: str) -> None:
    with pytest.raises(UsageError, match="parts count from 1") as caught:
        share_from(text)

    assert "--array=1-" in caught.value.fix


@pytest.mark.parametrize("text", ["", "3", "3/", "a/b", "-1/4", "1.5/4", "1/4/2"])
def test_what_is_no_part_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="no part of a build") as caught:
        share_from(text)

    assert "--chunk 3/8" in caught.value.fix
