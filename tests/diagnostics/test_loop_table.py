"""Tables as programs write them: delimiters, decimal commas, dates, units, gaps and text; and the messages."""

from __future__ import annotations

import numpy as np
import pytest

from positioner.diagnostics.loop_table import OPTIONS, LoopTable, loop_of
from positioner.errors import RecordError, UsageError
from positioner.inputs.csv_table import number_in, read_table, text_of

NOTHING: dict[str, str | None] = dict.fromkeys(OPTIONS)


def loop(text: str, wanted: dict[str, str] | None = None, period_s: float | None = None) -> LoopTable:
    return loop_of(read_table("loop.csv", text), {**NOTHING, **(wanted or {})}, period_s)


@pytest.mark.parametrize(
    "text",
    [
        "time,OP,PV,SP\n0,50.5,20,21\n2,51.5,20.5,21\n4,52.5,20,21\n",
        "time;OP;PV;SP\n0;50,5;20;21\n2;51,5;20,5;21\n4;52,5;20;21\n",
        "time\tOP\tPV\tSP\n0\t50.5\t20\t21\n2\t51.5\t20.5\t21\n4\t52.5\t20\t21\n",
        "# a comment\nTime   OP   PV   SP\n0 50.5 20 21\n2 51.5 20.5 21\n4 52.5 20 21\n",
        '"Time [s]","FC101.OP [%]","FC101.PV [m3/h]","FC101.SP"\n0,50.5,"20",21\n2,51.5,20.5,21\n4,52.5,20,21\n',
        (
            "Date;FC101_OUT;FC101_PV;FC101_SP\nh:m;%;m3/h;m3/h\n01.02.2024 10:00:00;50,5;20;21\n"
            "01.02.2024 10:00:02;51,5;20,5;21\n01.02.2024 10:00:04;52,5;20;21\n"
        ),
        (
            "timestamp,co,pv,setpoint\n2024-02-01T10:00:00Z,50.5,20,21\n2024-02-01T10:00:02Z,51.5,20.5,21\n"
            "2024-02-01T10:00:04Z,52.5,20,21\n"
        ),
        "t,MV,PV,SP\n0,50.5,20,21\n2,51.5,20.5,21\n4,52.5,20,21\n",
        "Zeit;Stellgröße;Istwert;Sollwert\n0;50,5;20;21\n2;51,5;20,5;21\n4;52,5;20;21\n",
    ],
)
def test_the_same_loop_in_nine_ways(text: str) -> None:
    found = loop(text)
    assert found.pv is not None
    assert found.sp is not None
    signals = [found.op.tolist(), found.pv.tolist(), found.sp.tolist()]
    assert signals == [[50.5, 51.5, 52.5], [20.0, 20.5, 20.0], [21.0] * 3]
    assert (found.period_s, found.is_timed, found.stem, found.notes) == (2.0, True, None, ())


def test_where_op_has_a_name_of_its_own_mv_is_the_stem() -> None:
    found = loop("OP,MV,PV\n1,2,3\n4,5,6\n")
    assert found.names == {"op": "OP", "pv": "PV", "stem": "MV"}


def test_a_table_without_a_header_is_read_by_numbers() -> None:
    found = loop("50 20\n51 21\n52 22\n", {"op": "2", "pv": "1"}, 5.0)
    assert (found.op.tolist(), found.period_s, found.is_timed) == ([20.0, 21.0, 22.0], 5.0, True)


def test_a_short_gap_is_filled_and_text_is_told_with_its_line() -> None:
    rows = [f"{k},{k},{2 * k}" for k in range(40)]
    rows[10] = "10,Bad,20"
    found = loop("time,OP,PV\n" + "\n".join(rows))
    assert found.op.tolist() == pytest.approx(list(range(40)))
    assert found.notes == ("column 'OP': 1 of 40 cells hold no number, first in line 12 (Bad)",)


def test_a_line_with_another_number_of_cells_is_left_out_and_told() -> None:
    found = loop("OP,PV\n1,2\n2\n3,4,5\n4,5\n")
    assert found.op.tolist() == [1.0, 4.0]
    assert found.notes == ("2 lines with another number of cells are left out, first line 3",)


def test_commas_that_are_decimal_and_between_the_cells_are_refused() -> None:
    with pytest.raises(RecordError, match=r"line 2 has 2 cells, and the rows have 4: are the commas decimal ones, too"):
        loop("Trend of FIC101\nOP,PV\n50,5,20,1\n51,5,20,5\n52,5,20,1\n")


def test_the_longest_stretch_without_a_long_gap_is_used() -> None:
    rows = [f"{k},{k},{2 * k}" for k in range(100) if not 30 <= k < 50]
    found = loop("time,OP,PV\n" + "\n".join(rows))
    assert found.op.tolist() == pytest.approx(list(range(50, 100)))
    assert found.notes[-1].endswith("the longest stretch without one is used, 50")


def test_times_at_unequal_distances_are_put_on_a_period() -> None:
    draw = np.random.default_rng(1)
    time = np.arange(200) + draw.uniform(-0.3, 0.3, 200)
    found = loop("time,OP,PV\n" + "\n".join(f"{t:.4f},{5.0 * t:.4f},{t:.4f}" for t in time))
    assert found.period_s == pytest.approx(1.0, abs=0.1)
    assert np.diff(found.op) == pytest.approx(5.0 * found.period_s, abs=1e-3)


@pytest.mark.parametrize(
    ("cell", "value"), [("1.5", 1.5), ("1,5", 1.5), (" -3e2 ", -300.0), ("42 %", 42.0), ('"7"', 7.0), ("+,5", 0.5)]
)
def test_numbers(cell: str, value: float) -> None:
    assert number_in(cell) == value


@pytest.mark.parametrize("cell", ["", "Bad", "NaN", "inf", "1_000", "1.2.3", "1,2,3"])
def test_no_numbers(cell: str) -> None:
    assert np.isnan(number_in(cell))


@pytest.mark.parametrize(
    ("text", "wanted", "message"),
    [
        ("A,B\n1,2\n3,4\n", {}, "which column is OP? Say it with --op; columns: A, B"),
        ("OP,B\n1,2\n3,4\n", {}, "which column is PV? Say it with --pv; columns: OP, B"),
        ("A.OP,B.OP,PV\n1,2,3\n3,4,5\n", {}, "'A.OP', 'B.OP' may all be OP: say which one with --op"),
        ("OP,PV\n1,2\n3,4\n", {"pv": "PVX"}, "has no column 'PVX' (--pv); did you mean 'PV'?"),
    ],
)
def test_a_column_that_is_not_clear_is_asked_for(text: str, wanted: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=r"^loop\.csv: ") as caught:
        loop(text, wanted)
    assert message in str(caught.value)


def test_too_many_cells_without_a_number_are_refused() -> None:
    with pytest.raises(RecordError, match=r"9 of 19 cells hold no number, first in line 4 \(empty\): too many"):
        loop("OP,PV\n" + "\n".join(f"{k if k % 2 else ''},{k}" for k in range(20)))


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n"])
def test_an_empty_file_is_refused(text: str) -> None:
    with pytest.raises(RecordError, match="holds no line of a table"):
        read_table("loop.csv", text)


def test_a_text_without_numbers_is_refused() -> None:
    with pytest.raises(RecordError, match="no row of at least two numbers"):
        read_table("loop.csv", "this is a letter\nand no table\n")


def test_bytes_become_text_in_every_usual_encoding() -> None:
    text = "Zeit;OP;Füllstand.PV\n"
    for data in (text.encode(), text.encode("utf-8-sig"), text.encode("utf-16"), text.encode("latin-1")):
        assert text_of("loop.csv", data) == text
    with pytest.raises(RecordError, match=r"is no text: a CSV file is needed$"):
        text_of("loop.csv", b"\0\1\2\3")
    with pytest.raises(RecordError, match=r"is no text: a CSV file is needed, or a log$"):
        text_of("loop.csv", b"\0\1\2\3", ", or a log")
