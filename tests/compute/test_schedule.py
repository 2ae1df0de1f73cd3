"""Results come in order, little is in hand at once, and an early end starts nothing more."""

import threading
import time

import pytest

from stereo_seecolor.compute.threads import Clock, Threads


def test_results_in_order_whatever_the_speed() -> None:
    def slow_when_even(i: int) -> int:
        time.sleep(0.002 * (i % 2 == 0))
        return i * i

    assert list(Threads(4).each(slow_when_even, range(40))) == [i * i for i in range(40)]


def test_few_are_in_hand_at_once() -> None:
    taken: list[int] = []

    def items():  # type: ignore[no-untyped-def]
        for i in range(100):
            taken.append(i)
            yield i

    results = Threads(2).each(lambda i: i, items())
    next(results)
    assert len(taken) <= 5
    results.close()  # type: ignore[attr-defined]


def test_failure_ends_it_and_starts_nothing_more() -> None:
    started: list[int] = []
    lock = threading.Lock()

    def fails_at_three(i: int) -> int:
        with lock:
            started.append(i)
        if i == 3:
            raise ValueError("three")
        return i

    with pytest.raises(ValueError, match="three"):
        list(Threads(2).each(fails_at_three, range(100)))
    assert len(started) < 12


def test_tiles_are_made_one_at_a_time() -> None:
    under_way: list[int] = []

    def tile(i: int) -> int:
        under_way.append(i)
        assert len(under_way) == 1
        time.sleep(0.002)
        return under_way.pop()

    assert list(Threads(4).tiles(tile, range(6))) == list(range(6))


def test_clock_adds_up() -> None:
    clock = Clock()
    for _ in range(2):
        with clock("match"):
            time.sleep(0.001)
    assert clock.seconds["match"] >= 0.002
