from __future__ import annotations

from benchtool.web.seat import GRACE_S, Seat


def test_the_first_page_is_at_the_controls_and_others_watch() -> None:
    seat = Seat()
    seat.arrive("a")
    seat.arrive("b")
    assert seat.controls("a")
    assert not seat.controls("b")
    assert not seat.is_free(1e9)
    assert not seat.take("b", 1e9)
    assert seat.controls("a")


def test_a_page_that_is_loaded_again_keeps_the_controls() -> None:
    seat = Seat()
    seat.arrive("a")
    seat.arrive("b")
    seat.leave("a", 10.0)
    assert not seat.take("b", 10.0 + 0.5 * GRACE_S)
    seat.arrive("a")
    assert seat.controls("a")
    assert not seat.take("b", 100.0)


def test_the_new_socket_of_a_page_may_come_before_the_old_one_goes() -> None:
    seat = Seat()
    seat.arrive("a")
    seat.arrive("a")
    seat.leave("a", 10.0)
    assert not seat.is_free(100.0)


def test_controls_of_a_page_that_is_gone_are_taken_by_hand_and_only_by_a_page() -> None:
    seat = Seat()
    seat.arrive("a")
    seat.arrive("b")
    seat.leave("a", 10.0)
    assert seat.controls("a")
    assert not seat.take("c", 20.0)
    assert seat.take("b", 20.0)
    assert seat.controls("b")
    seat.arrive("a")
    assert not seat.controls("a")


def test_no_name_has_no_controls() -> None:
    assert not Seat().controls("")
