"""The order of frames: a function of seed and step."""

from __future__ import annotations

from itertools import chain

from civil_rgbd.training.order import TrainingOrder, seed_of


def test_an_epoch_has_every_frame_once() -> None:
    order = TrainingOrder(frames=10, batch=4, seed=3)
    row = list(chain.from_iterable(order.batch_at(step) for step in range(5)))

    assert sorted(row[:10]) == [(0, place) for place in range(10)]
    assert sorted(row[10:]) == [(1, place) for place in range(10)]
    assert [place for _, place in row[:10]] != [place for _, place in row[10:]]


def test_processes_share_each_batch_of_one_process() -> None:
    order = TrainingOrder(frames=10, batch=4, seed=3)
    alone = list(order.batches(2, 6))
    shares = [list(order.batches(2, 6, rank=rank, processes=2)) for rank in range(2)]

    for whole, *parts in zip(alone, *shares, strict=True):
        assert [len(part) for part in parts] == [2, 2]
        assert sorted(chain.from_iterable(parts)) == sorted(whole)


def test_a_batch_larger_than_the_set_goes_on_with_the_next_epoch() -> None:
    places = TrainingOrder(frames=3, batch=8, seed=0).batch_at(0)

    assert [epoch for epoch, _ in places] == [0, 0, 0, 1, 1, 1, 2, 2]


def test_seeds_differ_by_run_epoch_and_frame() -> None:
    seeds = {seed_of(*one) for one in ((0, (0, 0)), (1, (0, 0)), (0, (1, 0)), (0, (0, 1)))}

    assert len(seeds) == 4
    assert seed_of(5, (2, 3)) == seed_of(5, (2, 3))


def test_steps_of_epochs_are_rounded_up() -> None:
    assert TrainingOrder(frames=10, batch=4, seed=0).steps_of(3) == 8
