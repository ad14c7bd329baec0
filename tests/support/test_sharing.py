"""Locks of one process, and objects that threads borrow."""

import copy
import os
import threading
import time

import pytest

from ocp_envs.support.sharing import Loans, ProcessLock
from tests.threads import in_threads


def test_a_lock_is_for_one_thread_at_a_time_which_may_take_it_again():
    lock, inside, most = ProcessLock(), [], []

    def enter(number):
        with lock, lock:
            inside.append(number)
            most.append(len(inside))
            time.sleep(0.002)
            inside.remove(number)

    in_threads(enter)
    assert most == [1, 1, 1, 1]


def test_a_lock_that_another_thread_holds_is_refused_or_free_in_a_copy():
    lock = ProcessLock()
    lock.acquire()
    others = in_threads(lambda number: (lock.acquire(blocking=False), copy.deepcopy(lock).acquire(blocking=False)), 1)
    assert others == [(False, True)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_lock_is_free_in_a_forked_process_though_another_thread_held_it():
    lock, held, forked = ProcessLock(), threading.Event(), threading.Event()

    def hold():
        with lock:
            held.set()
            forked.wait()

    holder = threading.Thread(target=hold)
    holder.start()
    held.wait()
    if (child := os.fork()) == 0:
        os._exit(0 if lock.acquire(blocking=False) else 1)
    assert os.waitpid(child, 0)[1] == 0
    forked.set()
    holder.join()


def test_an_object_is_lent_to_one_thread_at_a_time_and_few_are_made():
    made, lent, twice = [], set(), []

    def make():
        made.append(object())
        return made[-1]

    loans = Loans(make, 2)

    def borrow(number):
        for _ in range(20):
            with loans.one() as each:
                twice.append(each in lent)
                lent.add(each)
                time.sleep(0.0005)
                lent.remove(each)

    in_threads(borrow)
    assert 1 <= len(made) <= 2
    assert not any(twice)


def test_one_thread_borrows_the_same_object_again_also_after_an_error():
    loans = Loans(object, 2)
    with pytest.raises(KeyError), loans.one() as first:
        raise KeyError
    with loans.one() as second:
        assert second is first
