"""What is exported is read by our reader, by pyuff and scipy, and by a reader made from the format's description."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import pyuff
from scipy.io import loadmat

from daq.errors import RecordingError
from daq.exchange import import_recording
from daq.exchange.exporting import as_ascii, export_recording, rewritten
from daq.exchange.recording import Recording

RNG = np.random.default_rng(55)
RECORDING = Recording(RNG.standard_normal((3, 200)), 25000.0, ("A", "B, quoted", "tip µ"), "m/s2", "made.h5")
POLE = complex(-12.5, 2200.0)
SHAPE = np.array([1.0, -0.5 + 0.25j, 0.125j])


def by_description(content: bytes) -> tuple[list[np.ndarray], list[tuple[complex, list[complex]]]]:
    """Read data sets 58 (text or little-endian binary, evenly spaced, real) and 55 (complex) field by field."""
    responses, modes = [], []
    blocks, at = [], 0
    while (begin := content.find(b"    -1\n", at)) >= 0:
        head_end = content.index(b"\n", begin + 7)
        head = content[begin + 7 : head_end].decode()
        if head[:6].strip() == "58" and head[6:7] == "b":
            body = head_end + 1
            for _ in range(11):
                body = content.index(b"\n", body) + 1
            size = int(head[31:43])
            assert head[7:13].strip() == "1", "little-endian"
            responses.append(np.array(struct.unpack(f"<{size // 8}d", content[body : body + size])))
            at = content.index(b"    -1", body + size) + 7
            continue
        end = content.index(b"    -1\n", head_end)
        blocks.append((int(head[:6]), content[head_end + 1 : end].decode().splitlines()))
        at = end + 7
    for kind, lines in blocks:
        if kind == 58:
            fields = lines[6]
            assert (fields[:10].strip(), fields[20:30].strip()) == ("4", "1"), "double, evenly spaced"
            values = [float(line[i : i + 20]) for line in lines[11:] for i in range(0, len(line.rstrip()), 20)]
            assert len(values) == int(fields[10:20])
            responses.append(np.array(values))
        elif kind == 55:
            pole = complex(float(lines[7][:13]), float(lines[7][13:26]))
            nodes = [complex(float(line[:13]), float(line[13:26])) for line in lines[9::2]]
            modes.append((pole, nodes))
    return responses, modes


@pytest.mark.parametrize("binary", [True, False])
def test_a_universal_file_is_read_by_three_readers(tmp_path, binary):
    file = tmp_path / "out.uff"
    export_recording(file, RECORDING, binary=binary, modes=[(POLE, SHAPE), (2 * POLE, SHAPE.conj())])
    digits = 0 if binary else 1e-9
    ours = import_recording(file)
    assert ours.data == pytest.approx(RECORDING.data, rel=digits, abs=digits)
    assert ours.rate_hz == pytest.approx(25000.0, rel=1e-9)
    assert (ours.names, ours.unit) == (("A", "B, quoted", "tip u"), "m/s2")
    sets = pyuff.UFF(str(file)).read_sets()
    assert [s["type"] for s in sets] == [164, 58, 58, 58, 55, 55]
    for found, samples in zip(sets[1:4], RECORDING.data, strict=True):
        assert found["data"] == pytest.approx(samples, rel=digits, abs=digits)
        assert (found["func_type"], found["ordinate_spec_data_type"], found["binary"]) == (1, 12, int(binary))
    assert sets[4]["eig"] == pytest.approx(POLE, rel=1e-5)
    assert sets[4]["r1"] == pytest.approx(SHAPE, rel=1e-5)
    assert list(sets[4]["node_nums"]) == [1, 2, 3]
    responses, modes = by_description(file.read_bytes())
    assert np.array(responses) == pytest.approx(RECORDING.data, rel=digits, abs=digits)
    assert modes[0][0] == pytest.approx(POLE, rel=1e-5)
    assert np.array(modes[1][1]) == pytest.approx(SHAPE.conj(), rel=1e-5)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("rate_hz", [44100.0, 25000.0 / 3.0, 1e5 / 7.0])
def test_a_rate_whose_step_has_more_digits_comes_back_as_it_was(tmp_path, rate_hz, binary):
    recording = Recording(RECORDING.data, rate_hz, RECORDING.names, "m/s2", "made.h5")
    export_recording(tmp_path / "out.uff", recording, binary=binary)
    assert import_recording(tmp_path / "out.uff").rate_hz == rate_hz
    others = 1.0 / np.diff(pyuff.UFF(str(tmp_path / "out.uff")).read_sets(1)["x"]).mean()
    assert others == pytest.approx(rate_hz, rel=1e-5)


def test_a_rate_in_words_that_is_not_that_of_the_samples_counts_for_nothing(tmp_path):
    export_recording(tmp_path / "out.uff", RECORDING, binary=False)
    text = (tmp_path / "out.uff").read_text()
    (tmp_path / "other.uff").write_text(text.replace("rate: 25000.0 Hz", "rate: 24000.0 Hz"))
    assert import_recording(tmp_path / "other.uff").rate_hz == pytest.approx(25000.0, rel=1e-9)


def test_poles_have_all_their_digits_in_words_beside_the_six_of_the_format(tmp_path):
    pole = complex(-12.345678901234567, 2200.123456789012)
    export_recording(tmp_path / "out.uff", RECORDING, modes=[(pole, SHAPE)])
    mode = pyuff.UFF(str(tmp_path / "out.uff")).read_sets(4)
    assert mode["eig"] == pytest.approx(pole, rel=5e-6)
    assert complex(mode["id2"].split(" ", 1)[1].removesuffix(" 1/s").replace(" ", "")) == pole
    frequency, ratio = mode["id3"].split(" Hz, damping ratio ")
    assert float(frequency) == pytest.approx(abs(pole) / (2 * np.pi), rel=1e-14)
    assert float(ratio) == pytest.approx(-pole.real / abs(pole), rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "kind", "si", "factor"),
    [
        ("mm/s", 11, "m/s", 1e-3),
        ("m/s", 11, "m/s", 1.0),
        ("um", 8, "m", 1e-6),
        ("µm", 8, "m", 1e-6),
        ("mm", 8, "m", 1e-3),
        ("kN", 13, "N", 1e3),
        ("mN", 13, "N", 1e-3),
        ("mV", 0, "mV", 1.0),
        ("", 0, "", 1.0),
    ],
)
def test_data_types_come_with_si_units(tmp_path, unit, kind, si, factor):
    recording = Recording(RECORDING.data[:1], 25000.0, ("v",), unit, "made.h5")
    export_recording(tmp_path / "out.uff", recording)
    block = pyuff.UFF(str(tmp_path / "out.uff")).read_sets(1)
    assert (block["ordinate_spec_data_type"], block["ordinate_axis_units_lab"].strip()) == (kind, si or "NONE")
    assert block["data"] == pytest.approx(factor * RECORDING.data[0], rel=1e-15)
    ours = import_recording(tmp_path / "out.uff")
    assert (ours.unit, ours.data[0]) == (si, pytest.approx(factor * RECORDING.data[0], rel=1e-15))
    assert len(rewritten(recording)) == int(si != unit)


def test_a_shape_is_in_the_units_of_the_samples_beside_it(tmp_path):
    data = np.random.default_rng(3).normal(size=(3, 50))
    recording = Recording(data, 25000.0, ("a", "laser", "v"), "", "made.h5", ("m/s2", "um/s", "V"))
    export_recording(tmp_path / "out.uff", recording, modes=[(POLE, SHAPE)])
    sets = pyuff.UFF(str(tmp_path / "out.uff")).read_sets()
    written = [s["data"][7] / samples[7] for s, samples in zip(sets[1:4], data, strict=True)]
    assert written == pytest.approx([1.0, 1e-6, 1.0])
    assert sets[4]["r1"] / SHAPE == pytest.approx(np.array(written), rel=1e-5)
    alike = Recording(data, 25000.0, ("a", "b", "c"), "um/s", "made.h5")
    export_recording(tmp_path / "alike.uff", alike, modes=[(POLE, SHAPE)])
    assert pyuff.UFF(str(tmp_path / "alike.uff")).read_sets(4)["r1"] == pytest.approx(SHAPE, rel=1e-5)


def test_letters_that_ascii_has_not_are_spelled_and_told():
    names = ("Gehäuse außen", "Ölpumpe", "dessus près", "5 µm", "φ", "plain")
    recording = Recording(np.zeros((6, 20)), 1000.0, names, "m/s2", "made.h5")
    assert [as_ascii(name) for name in names] == ["Gehaeuse aussen", "Oelpumpe", "dessus pres", "5 um", "?", "plain"]
    assert as_ascii("Gehäuse") == "Gehaeuse"  # a letter and its dots apart, as macOS writes file names
    said = rewritten(recording)
    assert [line.split(" is called ")[0] for line in said] == [f"channel {name}" for name in names[:5]]


def test_csv_keeps_every_digit(tmp_path):
    file = tmp_path / "out.csv"
    export_recording(file, RECORDING)
    table = np.genfromtxt(file, delimiter=",", skip_header=2 - 1, encoding="utf-8")
    assert np.array_equal(table[:, 1:].T, RECORDING.data)
    ours = import_recording(file)
    assert np.array_equal(ours.data, RECORDING.data)
    assert (ours.unit, ours.names) == ("m/s2", RECORDING.names)


def test_mat_is_read_by_scipy_and_by_us(tmp_path):
    file = tmp_path / "out.mat"
    export_recording(file, RECORDING)
    found = loadmat(file)
    assert np.array_equal(found["data"].T, RECORDING.data)
    assert found["rate_hz"].item() == 25000.0
    assert [name.item() for name in found["names"].ravel()] == list(RECORDING.names)
    assert np.array_equal(import_recording(file).data, RECORDING.data)


@pytest.mark.parametrize(
    ("name", "modes", "says"),
    [("out.xyz", [], "unknown format; known are .uff"), ("out.csv", [(POLE, SHAPE)], "a .csv file holds no modes")],
)
def test_what_cannot_be_written_is_one_sentence(tmp_path: Path, name, modes, says):
    with pytest.raises(RecordingError, match=says):
        export_recording(tmp_path / name, RECORDING, modes=modes)
    assert list(tmp_path.iterdir()) == []
