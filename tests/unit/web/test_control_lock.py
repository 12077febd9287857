from __future__ import annotations

from benchtool.web.context import GRACE_S, ControlLock


def test_the_first_page_is_at_the_controls_and_others_watch() -> None:
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    assert lock.held_by("a")
    assert not lock.held_by("b")
    assert not lock.is_free(1e9)
    assert not lock.take("b", 1e9)
    assert lock.held_by("a")


def test_a_page_that_is_loaded_again_keeps_the_controls() -> None:
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    lock.leave("a", 10.0)
    assert not lock.take("b", 10.0 + 0.5 * GRACE_S)
    lock.arrive("a")
    assert lock.held_by("a")
    assert not lock.take("b", 100.0)


def test_the_new_socket_of_a_page_may_come_before_the_old_one_goes() -> None:
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("a")
    lock.leave("a", 10.0)
    assert not lock.is_free(100.0)


def test_controls_of_a_page_that_is_gone_are_taken_by_hand_and_only_by_a_page() -> None:
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    lock.leave("a", 10.0)
    assert lock.held_by("a")
    assert not lock.take("c", 20.0)
    assert lock.take("b", 20.0)
    assert lock.held_by("b")
    lock.arrive("a")
    assert not lock.held_by("a")


def test_no_name_has_no_controls() -> None:
    assert not ControlLock().held_by("")
