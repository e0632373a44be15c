"""Text tables that are read rightly or refused: quotes, decimal commas, titles, lines without numbers, units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import RecordingError
from daq.exchange import as_session, import_recording
from daq.exchange.importing import columns_in

N = 400
T = np.arange(N) / 1000
A = np.round(np.exp(-5 * T) * np.sin(2 * np.pi * 60 * T), 4)
B = np.round(np.exp(-5 * T) * np.cos(2 * np.pi * 60 * T), 4)


def german(value: float) -> str:
    return f"{value:.4f}".replace(".", ",")


def rows(form: str, **columns: np.ndarray) -> str:
    return "".join(
        form.format(**dict(zip(columns, map(float, row), strict=True))) + "\n"
        for row in zip(*columns.values(), strict=True)
    )


def plain(header: str, time: np.ndarray = T) -> str:
    return header + "\n" + rows("{t:.7g},{a:.4f},{b:.4f}", t=time, a=A, b=B)


def written(folder: Path, text: str) -> Path:
    path = folder / "x.csv"
    path.write_text(text, encoding="utf-8")
    return path


def refused(folder: Path, text: str, **options: float) -> str:
    path = written(folder, text)
    with pytest.raises(RecordingError) as caught:
        import_recording(path, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{path}: ")


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_quoted_decimal_commas_are_decimal(tmp_path: Path, delimiter: str) -> None:
    lines = ['"t"', '"a"', '"b"'], *([f'"{german(v)}"' for v in row] for row in zip(T, A, B, strict=True))
    recording = import_recording(written(tmp_path, "\n".join(map(delimiter.join, lines)) + "\n"))
    np.testing.assert_array_equal(recording.data, [A, B])
    assert (recording.names, recording.rate_hz) == (("a", "b"), 1000.0)


@pytest.mark.slow
def test_many_quoted_lines_are_read_as_few_are(tmp_path: Path) -> None:
    lines = [f'"{german(a)}","{german(b)}"' for a, b in zip(A, B, strict=True)] * 1000
    columns = columns_in(written(tmp_path, "\n".join(lines)))
    np.testing.assert_array_equal(columns.data, np.tile([A, B], 1000))


@pytest.mark.parametrize("cell", ["5,123.4", "5,123,456"])
def test_commas_between_thousands_are_refused(tmp_path: Path, cell: str) -> None:
    text = "t,a,b\n" + "".join(f'{i},"{cell}",1.5\n' for i in range(40))
    assert refused(tmp_path, text).startswith(
        f"line 2, column 2: '{cell}' is not a number: write numbers without commas"
    )


def test_a_quoted_comma_that_may_be_either_is_refused(tmp_path: Path) -> None:
    text = "t,a\n" + "".join(f'{i},"5,{100 + i}"\n' for i in range(40))
    assert refused(tmp_path, text).startswith("line 2 has a comma in a number that may part thousands")


def test_points_and_decimal_commas_do_not_mix(tmp_path: Path) -> None:
    text = "t;a\n" + rows("{t:.4f};{a:.4f}", t=T, a=A).replace(".", ",") + "0,4000;1.234\n"
    assert refused(tmp_path, text).startswith("line 402, column 2: some numbers have a decimal comma, others a point")


def test_unquoted_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    body = "".join(f"{i},{german(abs(a))},{german(abs(b))}\n" for i, (a, b) in enumerate(zip(A, B, strict=True)))
    assert refused(tmp_path, "t,a,b\n" + body).startswith("line 1 names 3 columns, the lines of numbers have 5 fields")
    assert "as the digits after a decimal comma do" in refused(tmp_path, body)


def test_titles_may_hold_commas_and_line_ends(tmp_path: Path) -> None:
    recording = import_recording(written(tmp_path, plain('"time, ms","acc A\n[g]","acc B\n[g]"', 1000 * T)))
    assert (recording.names, recording.rate_hz, recording.unit) == (("acc A", "acc B"), 1000.0, "m/s2")
    np.testing.assert_allclose(recording.data, 9.80665 * np.array([A, B]))


def test_a_quote_that_is_not_closed_is_told(tmp_path: Path) -> None:
    assert refused(tmp_path, plain('t,"a,b')).startswith("line 1 opens a quote that is not closed")
    assert "opens a quote" in refused(tmp_path, plain("t,a,b") + '0.4,"1.0,2.0\n')


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        *(("msec", 1e-3), ("milliseconds", 1e-3), ("mS", 1e-3), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0)),
        *(("µsec", 1e-6), ("μs", 1e-6), ("Sec", 1.0), ("s", 1.0)),
    ],
)
def test_units_of_time_are_converted(tmp_path: Path, unit: str, seconds: float) -> None:
    for header in (f"Time ({unit}),a,b", f'"Time, {unit}",a,b', f"t,a,b\n{unit},g,g"):
        recording = import_recording(written(tmp_path, plain(header, 1000 * T)))
        assert recording.rate_hz == pytest.approx(1 / seconds, rel=1e-9), header


@pytest.mark.parametrize("unit", ["xyz", "ticks", "m", "samples"])
def test_unknown_units_of_time_are_refused(tmp_path: Path, unit: str) -> None:
    said = refused(tmp_path, plain(f"Time ({unit}),a,b"))
    assert said.startswith(f"the unit '{unit}' of the times in Time is not known")


def test_a_time_may_be_told_by_its_unit_or_the_end_of_its_name(tmp_path: Path) -> None:
    for header in ("time_msec,a,b", "X [ms],a [g],b [g]"):
        assert import_recording(written(tmp_path, plain(header, 1000 * T))).rate_hz == 1000.0


def test_a_column_that_numbers_the_lines_is_neither_a_time_nor_a_channel(tmp_path: Path) -> None:
    path = written(tmp_path, plain(",a,b", np.arange(N)))
    with pytest.raises(RecordingError, match="give the rate in Hz"):
        import_recording(path)
    recording = import_recording(path, rate_hz=1000.0)
    assert (recording.names, recording.rate_hz) == (("a", "b"), 1000.0)


def test_two_columns_of_times_have_to_be_alike(tmp_path: Path) -> None:
    text = "t,a,t,b\n" + rows("{t:.4f},{a:.4f},{u:.4f},{b:.4f}", t=T, a=A, u=2 * T, b=B)
    assert refused(tmp_path, text).startswith("columns 1 (t) and 3 (t) are both of times, and they differ")
    text = "t,a,t,b\n" + rows("{t:.4f},{a:.4f},{u:.4f},{b:.4f}", t=T, a=A, u=T, b=B)
    np.testing.assert_array_equal(import_recording(written(tmp_path, text)).data, [A, B])


def test_a_time_that_runs_backwards_is_called_so(tmp_path: Path) -> None:
    said = refused(tmp_path, plain("t,a,b", T[::-1]))
    assert said == "column t runs backwards: at sample 1 it steps by -0.001 s"


def with_lines(line: str, at: int, count: int = 1, header: str = "a,b\n") -> str:
    body = rows("{a:.4f},{b:.4f}", a=A, b=B).splitlines()
    return header + "\n".join([*body[:at], *[line] * count, *body[at:]]) + "\n"


@pytest.mark.parametrize(
    ("line", "at", "message"),
    [
        ("#N/A,0.5", 100, "line 102, column 1: '#N/A' is not a number"),
        ("#DIV/0!,0.5", 0, "line 2, column 1: '#DIV/0!' is not a number"),
        ("#N/A,0.5", N, "line 402, column 1: '#N/A' is not a number"),
        (",", 100, "line 102 is empty, with numbers above and below (line 112)"),
        ("OVER,0.7312", 0, "line 2, column 1: 'OVER' is not a number"),
        ("", 100, "line 102 holds no numbers but stands among numbers"),
        ("# paused", 100, "line 102 holds no numbers but stands among numbers"),
    ],
)
def test_no_line_is_dropped_from_among_the_numbers(tmp_path: Path, line: str, at: int, message: str) -> None:
    assert refused(tmp_path, with_lines(line, at, 10), rate_hz=1000.0).startswith(message)


def test_decimal_commas_between_blanks_are_no_numbers(tmp_path: Path) -> None:
    text = "1,5 0.5\n" + rows("{a:.4f} {b:.4f}", a=A, b=B)
    assert refused(tmp_path, text, rate_hz=1.0).startswith("line 1, column 1: '1,5' is not a number")


def test_lines_without_numbers_at_the_end_or_beside_times_are_no_gap(tmp_path: Path) -> None:
    text = with_lines(",", N, 3) + "# the end\n"
    np.testing.assert_array_equal(import_recording(written(tmp_path, text), rate_hz=1.0).data, [A, B])
    lines = plain("t,a,b").splitlines()
    text = "\n".join([*lines[:50], "", "# half", *lines[50:]])
    np.testing.assert_array_equal(import_recording(written(tmp_path, text)).data, [A, B])


def test_a_blank_line_after_each_line_is_no_gap(tmp_path: Path) -> None:
    text = with_lines(",", N).replace("\n", "\n\n")
    np.testing.assert_array_equal(import_recording(written(tmp_path, text), rate_hz=1.0).data, [A, B])


def test_entries_above_the_titles_may_hold_numbers(tmp_path: Path) -> None:
    text = with_lines(",", N, header="Range,10.0\nChannels,2\nleft,right\n")
    assert import_recording(written(tmp_path, text), rate_hz=1.0).names == ("left", "right")


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *(("mg", 9.80665e-3), ("G", 9.80665), ("mm/s2", 1e-3), ("mm/s²", 1e-3), ("cm/s^2", 1e-2)),
        *(("m s⁻²", 1.0), ("in/s2", 0.0254), ("um/sec^2", 1e-6)),
    ],
)
def test_units_of_acceleration_are_converted(tmp_path: Path, unit: str, factor: float) -> None:
    recording = import_recording(written(tmp_path, plain(f"t [s],a [{unit}],b [{unit}]")))
    assert recording.unit == "m/s2"
    np.testing.assert_allclose(recording.data, factor * np.array([A, B]))


@pytest.mark.parametrize("unit", ["V", "mV", "N", "m/s", "mm", "um"])
def test_what_is_no_acceleration_is_not_a_or_b_of_a_session(tmp_path: Path, unit: str) -> None:
    recording = import_recording(written(tmp_path, plain(f"t [s],a [g],b [{unit}]")))
    assert recording.units == ("m/s2", unit)
    with pytest.raises(RecordingError, match=rf"x\.csv: channel b is in {unit}, and a session's A and B are"):
        as_session(recording)


@pytest.mark.long
def test_what_is_within_the_limit_that_is_told_is_read(tmp_path: Path) -> None:
    block = rows("{a:.4f},{b:.4f}", a=A, b=B)
    for unit in (block, "1,2,3\n4,5,7\n", "1\n2\n"):
        path = written(tmp_path, unit * (99_000_000 // len(unit)))
        said = refused(tmp_path, path.read_text())
        assert said.startswith("says neither times nor a sampling rate"), unit[:20]
