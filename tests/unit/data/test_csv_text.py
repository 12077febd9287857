from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError
from benchtool.data.column_map import parse_header_cell
from benchtool.data.csv_text import parse_csv, parse_rows
from benchtool.data.repairs.column_mapping import parse_numbers


def test_spreadsheet_file_is_mended_with_words():
    table = parse_csv("\ufeffa;b;\r\n1,5;2\r\n;3,25;\r\n".encode(), "x.csv")
    assert table.header == ("a", "b")
    assert table.rows.tolist() == [["1.5", "2"], ["", "3.25"]]
    assert list(table.repairs) == [
        "a byte order mark at the start was left out",
        "line ends CRLF or CR are read as LF",
        "cells are separated by ';', not ','",
        "2 decimal commas read as points",
    ]


def test_short_rows_are_counted_and_filled():
    table = parse_csv(b"a,b,c\n1,2,3\n4\n5,6\n", "x.csv")
    assert table.rows[1:].tolist() == [["4", "", ""], ["5", "6", ""]]
    assert table.repairs == ("2 rows shorter than the header, first in line 3",)


@pytest.mark.parametrize("own", [False, True])
def test_a_last_line_without_its_end(own):
    table = parse_csv(b"a,b\n1,2\n3,4", "x.csv", is_own=own)
    assert table.rows.tolist() == ([["1", "2"]] if own else [["1", "2"], ["3", "4"]])
    assert bool(table.repairs) is own


def test_a_cut_line_of_a_foreign_file_is_left_out():
    table = parse_csv(b"a,b\n1,2\n3", "x.csv")
    assert table.rows.tolist() == [["1", "2"]]
    assert table.repairs == ("the last line was cut short and left out",)


def test_windows_text_is_read_with_words():
    table = parse_csv("Time (s),ESC signal (µs)\n1,2\n".encode("cp1252"), "x.csv")
    assert table.header[1] == "ESC signal (µs)"
    assert table.repairs == ("the text is not UTF-8; read as Windows-1252",)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"\n\n", "the file is empty"),
        (b"PK\3\4\0\0", "not a text file"),
        (b"PAR1\0\0", "cannot be read as a Parquet table"),
        (b",,\n1,2,3\n", "names no columns"),
        (b"# ", "names no columns"),
        (b"a,b\n1,2,3\n", "line 2 has 3 cells, the header names 2 columns"),
    ],
)
def test_what_cannot_be_mended_is_refused(data, message):
    with pytest.raises(FileFormatError, match=message):
        parse_csv(data, "x.csv")


LEADS = {
    "blank lines": ("\n\n", "z (mm),F (gf)\n", "10,2.5\n20,2.25\n"),
    "comments": ("# stand 3\n% calm air\n", "z (mm),F (gf)\n", "10,2.5\n// half\n20,2.25\n"),
    "titles": (
        "Thrust test\nDate,2024-01-05\n\n",
        "z (mm),F (gf),rpm,V\n",
        "10,2.5,1,2\n20,2.25,1,2\n",
    ),
    "a line of units": ("", "z,F\nmm,gf\n", "10,2.5\n20,2.25\n"),
    "names in a comment": ("# calm air\n", "# z (mm), F (gf)\n", "10,2.5\n20,2.25\n"),
    "blanks between": ("# calm air\n", "z F\n", "  10   2.5\n  20   2.25\n"),
    "a spreadsheet": ("sep=;\r\n", "z (mm);F (gf)\r\n", "10;2,5\r\n20;2,25\r\n"),
}


@pytest.mark.parametrize("case", LEADS)
def test_what_stands_around_a_header_is_left_out(case):
    lead, header, rows = LEADS[case]
    data = f"{lead}{header}{rows}".encode()
    table, laid = parse_csv(data, "x.csv"), parse_rows(data, "x.csv")
    assert [parse_header_cell(cell).name for cell in table.header[:2]] == ["z", "F"]
    if case != "blanks between":
        assert [parse_header_cell(cell).unit for cell in table.header[:2]] == ["mm", "gf"]
    assert laid.header == table.header
    assert table.rows[:, :2].tolist() == [["10", "2.5"], ["20", "2.25"]]
    numbers = parse_numbers(laid, [0, 1])
    assert numbers.columns.tolist() == [[10.0, 20.0], [2.5, 2.25]]
    assert numbers.lines.tolist() == table.lines.tolist()
    lines = data.decode().replace("\r", "").split("\n")
    assert all(
        lines[at - 1].split()[0].startswith(n)
        for at, n in zip(table.lines, ("10", "20"), strict=True)
    )


OPEN_QUOTES = {
    "never closed": ('# stand\nz,F,rpm\n1,2,3\n4,"5,6\n7,8,9\n', 4),
    "never closed, one line": ('z,F,rpm\n1,2,"3', 2),
    "of a long file": ('z,F,rpm\n1,"2,3\n' + "4,5,6\n" * 30_000, 2),
    "closed in a later row": ('z,F,rpm\n1,2,3\n4,"5,6\n7,8,9\n1,"2,3\n4,5,6\n', 3),
}


@pytest.mark.parametrize("case", OPEN_QUOTES)
@pytest.mark.parametrize("read", [parse_csv, parse_rows])
def test_a_quote_that_contains_rows_is_refused_with_its_line(case, read):
    text, line = OPEN_QUOTES[case]
    with pytest.raises(FileFormatError) as refused:
        read(text.encode(), "x.csv")
    assert refused.value.where == f"x.csv, line {line}"


@pytest.mark.parametrize("note", ["calm\nair", "calm, dry\nair", 'the "good" cell'])
def test_text_in_quotes_is_one_cell(note):
    quoted = note.replace('"', '""')
    data = f'z,F,note\n1,2,"{quoted}"\n3,4,\n'.encode()
    table = parse_csv(data, "x.csv")
    assert table.rows.tolist() == [["1", "2", note], ["3", "4", ""]]
    assert parse_numbers(parse_rows(data, "x.csv"), [0, 1]).columns.tolist() == [
        [1.0, 3.0],
        [2.0, 4.0],
    ]


def test_impossible_numbers_of_a_foreign_file_are_blanked_and_counted():
    table = parse_rows(b"z,F\n1,2\n1e308,-9e99\n3,inf\n1e20,4\n", "x.csv")
    numbers = parse_numbers(table, [0, 1])
    assert np.isnan(numbers.columns).tolist() == [
        [False, True, False, False],
        [False, True, True, False],
    ]
    (finding,) = numbers.findings
    assert (finding.what, finding.count, finding.lines) == ("infinite numbers", 3, "3-4")
