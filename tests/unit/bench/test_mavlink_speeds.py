from __future__ import annotations

from benchtool.bench.mavlink.rows import SpeedSources

STEP_US = 50_000


def run(sources: SpeedSources, source: str, rpm: float, begin: int, driven: bool = True) -> list:
    """Tell 40 readings, two seconds long; return which were taken."""
    return [sources.take(source, 0, rpm, driven, begin + STEP_US * step) for step in range(40)]


def test_a_speed_that_changes_is_taken() -> None:
    sources = SpeedSources(1)
    assert all(run(sources, "ESC_TELEMETRY", 0.0, 0, driven=False))
    assert all(run(sources, "ESC_TELEMETRY", 3000.0, 2_000_000))
    assert sources.take_messages() == []


def test_a_constant_zero_while_driven_is_a_dead_channel() -> None:
    sources = SpeedSources(1)
    taken = run(sources, "ESC_TELEMETRY", 0.0, 0)
    assert taken == [True] * 20 + [False] * 20
    (told,) = sources.take_messages()
    assert told.startswith(
        "rpm1 of ESC_TELEMETRY reads 0 while its motor is driven: a dead channel"
    )


def test_another_message_that_lives_takes_its_place() -> None:
    sources = SpeedSources(1)
    taken = []
    for step in range(40):
        sources.take("ESC_TELEMETRY", 0, 0.0, True, STEP_US * step)
        taken.append(sources.take("RPM", 0, 3000.0 + step, True, STEP_US * step))
    assert taken == [False] * 20 + [True] * 20
    assert sources.take_messages()[-1] == "rpm1 is taken from RPM now"


def test_the_more_trusted_message_is_chosen_while_nothing_turns() -> None:
    sources = SpeedSources(1)
    assert sources.take("RPM", 0, 0.0, False, 0)
    assert sources.take("ESC_STATUS", 0, 0.0, False, 0)
    assert not sources.take("RPM", 0, 0.0, False, 0)


def test_a_dead_channel_that_wakes_up_is_taken_again() -> None:
    sources = SpeedSources(1)
    run(sources, "ESC_TELEMETRY", 0.0, 0)
    assert sources.take("ESC_TELEMETRY", 0, 2000.0, True, 3_000_000)
