import random

import pytest

from cspr_drivers.cycle.answer_balance import AnswerBalance

PERIOD = 0.004


@pytest.fixture
def balance():
    return AnswerBalance(2, silence=0.1, period=PERIOD)


def cycle(balance, *answers):
    """Run a cycle with so many answers of each device; return who has given one too many."""
    balance.sync()
    surplus = set()
    for index, number in enumerate(answers):
        for _ in range(number):
            if balance.answered(index):
                surplus.add(index)
    return surplus


def cycles_until_found(balance):
    return next(n for n in range(1, 100) if cycle(balance, 1, 2) == {1})


def test_a_second_device_is_found_within_three_cycles(balance):
    for _ in range(100):
        assert cycle(balance, 1, 1) == set()
    assert cycles_until_found(balance) == 3
    assert cycle(balance, 1, 2) == {1}


def test_one_that_was_there_before_is_found_too(balance):
    assert cycles_until_found(balance) == 3


def test_answers_that_were_lost_long_ago_hide_nobody(balance):
    for _ in range(1000):
        cycle(balance, 1, 0)  # its supply was off
    for _ in range(25):
        cycle(balance, 1, 1)
    assert cycles_until_found(balance) == 3


def test_a_frame_that_the_bus_has_doubled_accuses_nobody(balance):
    for _ in range(10):
        assert cycle(balance, 1, 2) == set()
        for _ in range(25):
            assert cycle(balance, 1, 1) == set()


@pytest.mark.parametrize("seed", range(20))
def test_nobody_who_gives_one_answer_to_each_sync_is_accused_however_late(seed):
    drawn = random.Random(seed)
    balance = AnswerBalance(1, silence=0.1, period=PERIOD)
    pending = []  # cycles in which answers under way will come, in order
    usual = drawn.choice((0, 0, 1))  # an amplifier whose conversion takes longer than a cycle
    stall = 0
    for now in range(3000):
        balance.sync()
        if drawn.random() < 0.01:
            stall = drawn.randrange(20)  # the computer, or the device, stands still
        if drawn.random() > 0.01:  # else the answer is lost
            late = max(usual + (drawn.random() < 0.2), stall)
            pending.append(max(now + late, pending[-1] if pending else 0))
        stall = max(0, stall - 1)
        while pending and pending[0] <= now:
            pending.pop(0)
            assert not balance.answered(0), f"in cycle {now}"
