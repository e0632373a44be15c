"""Recordings whose numbers can be read and yet are told with what is usual and what else they may be."""

from __future__ import annotations

import doctest
import json
import re
import wave
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat
from typer.testing import CliRunner

from daq.bounds import ACCELERATION, FORCE
from daq.exchange import Recording
from daq.session_file import write_session
from mesotap import simulate
from mesotap.answers.analysing import analysed_as_configured
from mesotap.answers.recording_modes import modes_of
from mesotap.cli import app
from mesotap.configuration import usual_recordings
from mesotap.configuration.config import Config, parse_config
from mesotap.configuration.rig_files import parse_rig
from mesotap.configuration.usual_recordings import (
    channel_remarks,
    recording_remarks,
    rig_remarks,
    session_remarks,
    size_remark,
)
from tests.fuzz.sessions import small_session

RATE, SAMPLES = 10_000.0, 3000
T = np.arange(SAMPLES) / RATE
DECAY = np.exp(-60 * T) * np.sin(2 * np.pi * 700 * T) + 1e-4 * np.random.default_rng(4).normal(size=SAMPLES)
Writer = Callable[[Path, np.ndarray], Path]


def as_csv(folder: Path, data: np.ndarray) -> Path:
    head = "time [s],a [m/s2],b [m/s2]"
    np.savetxt(folder / "r.csv", np.array([T, *data]).T, delimiter=",", header=head, comments="")
    return folder / "r.csv"


def as_mat(folder: Path, data: np.ndarray) -> Path:
    savemat(folder / "r.mat", {"time": T, "a": data[0], "b": data[1]})
    return folder / "r.mat"


def as_uff(folder: Path, data: np.ndarray) -> Path:
    assert run("export", as_mat(folder, data), folder / "r.uff").exit_code == 0
    return folder / "r.uff"


def as_tdms(folder: Path, data: np.ndarray) -> Path:
    channels = [ChannelObject("g", n, y, {"wf_increment": 1 / RATE}) for n, y in zip("ab", data, strict=True)]
    with TdmsWriter(folder / "r.tdms") as file:
        file.write_segment(channels)
    return folder / "r.tdms"


def as_hdf5(folder: Path, data: np.ndarray) -> Path:
    with h5py.File(folder / "r.hdf5", "w") as file:
        for name, y in (("time", T), ("a", data[0]), ("b", data[1])):
            file[name] = y
    return folder / "r.hdf5"


def run(*arguments: object):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.parametrize("write", [as_csv, as_mat, as_uff, as_tdms, as_hdf5])
def test_data_times_1e30_is_told_by_import_with_what_is_usual(tmp_path: Path, write: Writer) -> None:
    file = write(tmp_path, np.array([DECAY, 0.9 * DECAY]) * 1e29)
    done = run("import", file, tmp_path / "s.h5")
    said = " ".join(done.output.split())
    assert re.search(r"channel \S*a reaches 9\.\d+e\+28 (m/s2|of its unit); usual is", said)
    assert "raw counts, scaled twice, or numbers read with the wrong type or byte order" in said
    assert not (tmp_path / "s.h5").exists()  # an acceleration that a session cannot hold is refused besides
    assert "expected at most 1e+15" in str(done.exception)


@pytest.mark.parametrize("write", [as_csv, as_mat, as_tdms, as_hdf5])
@pytest.mark.parametrize(
    ("wrong", "said"), [(np.nan, "holds a NaN at sample 50"), (np.inf, "an infinite value at sample 50")]
)
def test_what_is_no_number_is_refused_with_its_place(tmp_path: Path, write: Writer, wrong: float, said: str) -> None:
    data = np.array([DECAY, 0.9 * DECAY])
    data[0, 50] = wrong
    done = run("import", write(tmp_path, data), tmp_path / "s.h5")
    assert done.exit_code != 0
    assert re.search(rf"channel \S*a holds {said.removeprefix('holds ')}", str(done.exception))
    assert not (tmp_path / "s.h5").exists()


@pytest.mark.parametrize("write", [as_tdms, as_hdf5])
def test_zeros_are_told_by_import_whatever_the_format(tmp_path: Path, write: Writer) -> None:
    said = " ".join(run("import", write(tmp_path, np.zeros((2, SAMPLES))), tmp_path / "s.h5").output.split())
    assert "channels a, b are zero throughout: not connected, muted, or not recorded at all" in said


@pytest.mark.parametrize("scale", [1e30, 1e-30])
def test_numbers_out_of_this_world_have_the_modes_of_others(tmp_path: Path, scale: float) -> None:
    (plain, far) = (
        modes_of(Recording(s * np.array([DECAY, DECAY]), RATE, ("a", "b"), "", "r"), "ml") for s in (1.0, scale)
    )
    assert far.modes[0].frequency_hz.value == pytest.approx(plain.modes[0].frequency_hz.value)
    assert far.modes[0].frequency_hz.half_width == pytest.approx(plain.modes[0].frequency_hz.half_width, rel=1e-3)
    assert far.modes[0].amplitude == pytest.approx(tuple(scale * a for a in plain.modes[0].amplitude), rel=1e-6)
    assert far.modes[0].along_decay[0].amplitude == pytest.approx(
        scale * plain.modes[0].along_decay[0].amplitude, rel=1e-6
    )


def test_hdf5_that_is_no_session_is_told_what_reads_it(tmp_path: Path) -> None:
    file = as_hdf5(tmp_path, np.array([DECAY, DECAY]))
    assert "'mesotap import' makes one" in str(run("analyze", file).exception)


def test_a_described_rig_s_recording_is_told_of_too(tmp_path: Path) -> None:
    file = as_csv(tmp_path, np.array([DECAY, np.zeros(SAMPLES)]) * 1e20)
    rig = tmp_path / "rig.yaml"
    rig.write_text(
        "bodies: {m: 1}\nsprings: [{between: [m, ground], stiffness: 1.0e+9}]\n"
        "sensors: [{channel: a, of: m, shows: acceleration, unit: m/s2}]\n"
    )
    answer = tmp_path / "check.json"
    said = " ".join(run("rig", "check", rig, file, "--json", answer).output.split())
    assert all(one in said for one in json.loads(answer.read_text())["remarks"])
    assert "channel a reaches 9" in said
    assert "usual is 0.0001 to 1e+06 m/s2: they may be raw counts, scaled twice, or numbers read with the wrong" in said
    assert "channel b is zero throughout" in said
    assert "has modes at 5033 Hz" in said  # above half of 10 kHz
    assert "rate_hz: 1e+07" in said


def test_nothing_is_unusual_about_what_is_usual() -> None:
    fine = Recording(np.array([DECAY, DECAY]), RATE, ("a", "b"), "m/s2", "r.csv", ("m/s2", "m/s2"))
    assert recording_remarks(fine) == []
    for unit, largest in (("V", 5.0), ("mV", 100.0), ("g", 50.0), ("um", 3.0), ("N", 200.0), ("", 32767.0)):
        assert size_remark("a", unit, largest) == ""


@pytest.mark.parametrize(
    ("unit", "largest", "meant"),
    [
        ("m/s2", 5e7, "they may be mm/s2 (50000 m/s2)"),
        ("V", 2.0e4, "they may be mV (20 V)"),
        ("m", 300.0, "they may be mm (0.3 m)"),
        ("", 1e30, "raw counts, scaled twice"),
        ("N", 1e-30, "noise of a channel that is not connected"),
    ],
)
def test_what_else_it_could_be(unit: str, largest: float, meant: str) -> None:
    assert meant in size_remark("x", unit, largest)


@pytest.mark.parametrize("unit", ["m/s2", "N"])
def test_what_is_too_large_to_be_read_is_told_with_what_is_usual(unit: str) -> None:
    bound, usual = {"m/s2": ACCELERATION, "N": FORCE}[unit], usual_recordings.OF_UNIT[unit]
    said = bound.fault(1e30)
    assert f"usual is {usual.least:g} to {usual.most:g} {unit}: they may be raw counts" in said
    assert "thermal noise" not in said
    assert "thermal noise" in bound.fault(1e-31)


def test_a_slow_rate_is_told_where_no_rig_says_how_fast_it_is() -> None:
    slow = Recording(np.array([DECAY, DECAY]), 100.0, ("a", "b"), "m/s2", "r.csv")
    (said,) = recording_remarks(slow)
    assert said.startswith("r.csv: is sampled at 100 Hz and shows nothing above 50 Hz")
    assert "if 100 kHz is meant, give 100000 Hz; it may also be another quantity, such as the step in us" in said
    assert "its low-pass of 10000 Hz needs at least 20000 Hz" in usual_recordings.slow(100.0, 1e4)
    assert recording_remarks(slow, rate=False) == []
    held = "bodies: {m: 0.1}\nsprings: [{between: [m, ground]}]\n"
    rig = parse_rig(held + "sensors: [{channel: 0, of: m, shows: velocity}]")
    assert rig_remarks(rig, slow) == []  # nobody knows how stiff it is


def test_what_never_changes_is_told_by_name() -> None:
    data = [np.array([DECAY, np.zeros(SAMPLES), np.full(SAMPLES, 3.0)])]
    still, constant = channel_remarks(("a", "b", "c"), ("",) * 3, data)
    assert still.startswith("channel b is zero throughout")
    assert constant.startswith("channel c is constant")
    (many,) = channel_remarks([f"c{i}" for i in range(8)], ("",) * 8, [np.zeros((8, 20))])
    assert many.startswith("channels c0, c1, c2, c3, c4 and 3 more are zero throughout")


def test_a_session_of_zeros_is_told_to_be_one(tmp_path: Path) -> None:
    sound = small_session()
    impacts = tuple(replace(i, acceleration=np.zeros_like(i.acceleration)) for i in sound.impacts)
    write_session(tmp_path / "s.h5", replace(sound, impacts=impacts))
    done = run("info", tmp_path / "s.h5", "--json", tmp_path / "info.json")
    assert done.exit_code == 0
    (said,) = json.loads((tmp_path / "info.json").read_text())["remarks"]
    assert "channels A and B are zero throughout" in said.replace("A, B", "A and B")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"m1_kg": 107.0}, "m1_kg of /rig is 107 kg; usual is 0.005 to 20 kg: if 107 g is meant, write 0.107"),
        ({"k2_n_per_m": 537.0}, "k2_n_per_m of /rig is 537 N/m; usual is 1000 to 1e+09 N/m: if 537 N/mm is meant"),
        ({}, "the largest target_load_mn is 0.3 mN; usual is 5 to 20000 mN: if 0.3 N is meant, write 300"),
    ],
)
def test_a_session_of_grams_or_newtons_is_told_what_they_may_be(change: dict[str, float], said: str) -> None:
    sound = small_session()
    assert session_remarks(sound) == []
    impacts = sound.impacts if change else tuple(replace(i, target_load_mn=0.3) for i in sound.impacts)
    (told,) = session_remarks(replace(sound, rig=replace(sound.rig, **change), impacts=impacts))
    assert said in told


def test_accelerations_far_beyond_the_full_scale_are_told_and_a_clipped_tap_is_not() -> None:
    sound = simulate(load_mn=300.0)

    def told(factor: float) -> list[str]:
        tap = sound.impacts[0]
        return session_remarks(replace(sound, impacts=(replace(tap, acceleration=factor * tap.acceleration),)))

    full_scale, largest = sound.rig.full_scale_m_s2, float(np.abs(sound.impacts[0].acceleration).max())
    assert told(1.0) == told(full_scale / largest) == told(2 * full_scale / largest) == []
    (said,) = told(1000.0)
    assert "times the full scale of 49.0332 m/s2 that /rig declares: they may be mm/s2" in said
    assert told(1e7) != []
    unknown = replace(sound, rig=replace(sound.rig, full_scale_m_s2=float("nan")))
    assert session_remarks(unknown) == []


def test_what_is_unusual_about_a_session_and_its_configuration_is_among_its_results() -> None:
    sound = simulate(load_mn=300.0)
    assert analysed_as_configured(sound, Config()).remarks == ()
    newtons = replace(sound, impacts=tuple(replace(i, target_load_mn=0.3) for i in sound.impacts))
    changes = ["mesotap.load_plan_mn=[0.3]", "rig.filter.lowpass_hz=10.0", "rig.filter.highpass_hz=1.0"]
    remarks = analysed_as_configured(newtons, parse_config("", "test", changes)).remarks
    assert [one.split(" is ")[0] for one in remarks] == ["the largest target_load_mn", "rig.filter.lowpass_hz"]


def test_what_is_unusual_is_in_the_json_of_analyze_and_report_and_on_the_page(tmp_path: Path) -> None:
    sound = simulate(load_mn=300.0)
    impacts = tuple(replace(i, target_load_mn=0.3) for i in sound.impacts)
    write_session(tmp_path / "s.h5", replace(sound, impacts=impacts))
    done = run("analyze", tmp_path / "s.h5", "--json", tmp_path / "a.json", "--report", tmp_path / "page")
    assert done.output.count("the largest target_load_mn") == 1
    for answer in (tmp_path / "a.json", tmp_path / "page" / "results.json"):
        assert any("if 0.3 N is meant, write 300" in note for note in json.loads(answer.read_text())["notes"])
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert '<li class="doubt"><b><a href="#notes">Values and units</a>: in doubt</b>, 1 to be looked at</li>' in page
    assert "<li><b>Values and units: in doubt.</b> The largest target_load" in page
    assert '<ul class="notes" id="notes"><li>the largest target_load' in page


def test_an_analysis_of_a_wav_tells_a_silent_channel(tmp_path: Path) -> None:
    with wave.open(str(tmp_path / "r.wav"), "wb") as file:
        file.setparams((2, 2, int(RATE), SAMPLES, "NONE", "none"))
        file.writeframes(np.array([30000 * DECAY, 0 * DECAY]).T.astype("<i2").tobytes())
    done = run("analyze", tmp_path / "r.wav", "--json", tmp_path / "r.json")
    assert done.exit_code == 0
    assert any("zero throughout" in note for note in json.loads((tmp_path / "r.json").read_text())["notes"])


def test_the_examples() -> None:
    assert doctest.testmod(usual_recordings).failed == 0
