"""Lines of GRBL 1.1 as values, each as the firmware wrote it."""

import pytest

from benchtool.bench.stage.grbl_lines import (
    Alarm,
    Banner,
    Error,
    GrblDecoder,
    GrblSetting,
    Note,
    Ok,
    Other,
    StatusReport,
    move_line,
    parse_line,
)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("ok", Ok()),
        ("error:22", Error(22)),
        ("ALARM:2", Alarm(2)),
        ("Grbl 1.1h ['$' for help]", Banner("1.1h")),
        ("GrblHAL 1.1f ['$' or '$HELP' for help]", Banner("1.1f")),
        ("[MSG:Caution: Unlocked]", Note("MSG:Caution: Unlocked")),
        ("$110=500.000", GrblSetting(110, 500.0)),
        (
            "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>",
            StatusReport("Idle", None, (0.0, 0.0, 0.0), None, (0.0, 0.0, 0.0)),
        ),
        ("<Hold:1|MPos:1.5,-2,3|FS:0,0>", StatusReport("Hold", 1, (1.5, -2.0, 3.0), None, None)),
        ("<Run|WPos:1.0,2.0|Bf:15,128>", StatusReport("Run", None, None, (1.0, 2.0), None)),
        ("<Idle|MPos:1.0,x|FS:0,0>", Other("<Idle|MPos:1.0,x|FS:0,0>")),
        ("<Idle|MPos:1.0", Other("<Idle|MPos:1.0")),
    ],
)
def test_a_line_is_what_it_says(line, word):
    assert parse_line(line + "\r") == word


def test_only_the_unlock_message_says_locked():
    assert parse_line("[MSG:'$H'|'$X' to unlock]") == Note("MSG:'$H'|'$X' to unlock")
    assert Note("MSG:'$H'|'$X' to unlock").locked
    assert not Note("MSG:Caution: Unlocked").locked


def test_every_alarm_and_error_has_words_and_a_number():
    for number in range(1, 10):
        assert str(Alarm(number)).startswith(f"ALARM:{number}, ")
    assert "homing is switched off" in str(Error(5))
    assert str(Error(53)) == "error:53, which its manual explains"
    assert [number for number in range(1, 10) if Alarm(number).loses_position] == [1, 3, 6, 7, 8, 9]


def test_half_a_line_waits_for_the_rest():
    ear = GrblDecoder()
    assert ear.feed(b"\r\nGrbl 1.1h ['$' f") == []
    assert ear.feed(b"or help]\r\no") == [Banner("1.1h")]
    assert ear.feed(b"k\r\n") == [Ok()]


def test_the_work_offset_is_remembered_until_a_restart():
    ear = GrblDecoder()
    (report,) = ear.feed(b"<Idle|WPos:1.0,2.0,3.0|WCO:10.0,0.0,-5.0>\n")
    assert ear.machine_mm(report) == (11.0, 2.0, -2.0)
    (report,) = ear.feed(b"<Idle|WPos:2.0,2.0,3.0>\n")
    assert ear.machine_mm(report) == (12.0, 2.0, -2.0)
    ear.feed(b"Grbl 1.1h ['$' for help]\n")
    assert ear.machine_mm(report) is None
    (report,) = ear.feed(b"<Idle|MPos:7.0,8.0,9.0>\n")
    assert ear.machine_mm(report) == (7.0, 8.0, 9.0)


def test_a_move_is_absolute_in_millimetres_and_machine_coordinates():
    assert move_line({"Z": -12.3456}, 600.0) == b"G21 G90 G53 G1 Z-12.346 F600.0\n"


@pytest.mark.parametrize(
    "line",
    [
        "error:" + 4400 * "9",
        "$110=" + 4400 * "9",
        "<Idle:" + 4400 * "9" + "|MPos:0.000,0.000,0.000>",
        "<Idle|MPos:nan,0.000,0.000>",
        "<Idle|MPos:1e999,0.000,0.000>",
    ],
)
def test_a_number_that_none_can_be_is_no_word_of_a_stage(line):
    assert parse_line(line) == Other(line)


def test_an_offset_of_another_number_of_axes_gives_no_position():
    ear = GrblDecoder()
    ear.feed(b"<Idle|WPos:1.000,2.000,3.000|WCO:0.000,0.000>\n")
    (report,) = ear.feed(b"<Idle|WPos:1.000,2.000,3.000>\n")
    assert ear.machine_mm(report) is None
