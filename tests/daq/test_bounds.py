"""Quantities that nothing measurable has are refused with name, unit and reason, by the reader and by the writer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.modal.exponentials import FitFailure
from analysis.session import AnalysisError, analyse_session
from analysis.settings import AnalysisSettings
from analysis.surface.scan import ScanError, parse_scan
from calibration.settings import CalibrationSettings
from daq.bounds import BOUNDS, LOAD, RATE
from daq.errors import RecordingError
from daq.exchange import Recording
from daq.session_file import read_session, write_session
from mesotap.commands.files import modes_of
from mesotap.commands.recordings import opened
from mesotap.configuration.config import ConfigError, parse_config
from mesotap.session.entries import fault_of
from rig.settings import Masses, Springs
from tests.fuzz.sessions import small_session

Change = Callable[[h5py.File], object]


def rig(name: str, value: float) -> Change:
    return lambda file: file["rig"].attrs.__setitem__(name, value)


def tap(name: str, value: float) -> Change:
    return lambda file: file["impacts/00000"].attrs.__setitem__(name, value)


def scaled(name: str, factor: float) -> Change:
    def change(file: h5py.File) -> None:
        file[name][...] *= factor

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (rig("sample_rate_hz", 1e300), r"sample_rate_hz of /rig is 1e\+300 Hz, expected at most 1e\+11 \("),
        (rig("sample_rate_hz", 1e-300), "sample_rate_hz of /rig is 1e-300 Hz, expected at least 1e-06"),
        (rig("k1_n_per_m", 1e300), r"k1_n_per_m of /rig is 1e\+300 N/m, expected at most"),
        (rig("k2_n_per_m", 1e-300), "k2_n_per_m of /rig is 1e-300 N/m, expected at least"),
        (rig("m1_kg", 1e300), r"m1_kg of /rig is 1e\+300 kg"),
        (rig("highpass_hz", 1e300), r"highpass_hz of /rig is 1e\+300 Hz"),
        (rig("full_scale_m_s2", 1e300), r"full_scale_m_s2 of /rig is 1e\+300 m/s2"),
        (tap("voltage_before_mv", 1e300), r"voltage_before_mv of /impacts/00000 is 1e\+300 mV"),
        (tap("load_after_mn", -1e300), r"load_after_mn of /impacts/00000 is -1e\+300 mN"),
        (scaled("impacts/00000/acceleration", 1e200), r"/impacts/00000/acceleration reaches .*e\+\d+ m/s2"),
        (scaled("impacts/00000/acceleration", 1e-200), r"/impacts/00000/acceleration reaches .* at least 1e-30"),
        (scaled("calibration/pre/load_mn", 1e300), r"/calibration/pre/load_mn reaches 3e\+300 mN"),
    ],
)
def test_what_nothing_measurable_has_is_not_read(tmp_path: Path, change: Change, said: str) -> None:
    path = tmp_path / "s.h5"
    write_session(path, small_session())
    with h5py.File(path, "r+") as file:
        for impact in file["impacts"].values():
            del impact.attrs["digest"]
        del file["impacts/00001"]  # what is wrong with one record is not the others' fault
        change(file)
    with pytest.raises(RecordingError, match=said):
        read_session(path)


def test_what_would_not_be_read_is_not_written(tmp_path: Path) -> None:
    sound = small_session()
    impact = sound.impacts[0]
    points = replace(sound.pre, voltage_mv=sound.pre.voltage_mv * 1e30)  # type: ignore[union-attr, type-var]
    for wrong in (
        replace(sound, rig=replace(sound.rig, k1_n_per_m=1e300)),
        replace(sound, impacts=(replace(impact, acceleration=impact.acceleration * 1e100),)),
        replace(sound, impacts=(replace(impact, target_load_mn=1e300),)),
        replace(sound, pre=points),  # type: ignore[arg-type]
    ):
        with pytest.raises(RecordingError, match="expected at most"):
            write_session(tmp_path / "s.h5", wrong)
    assert list(tmp_path.iterdir()) == []


def test_zero_unknown_and_the_bounds_themselves_are_believed() -> None:
    for bound in BOUNDS.values():
        for value in (0.0, -0.0, float("nan"), bound.least, bound.most, -bound.most):
            assert bound.fault(value) == ""
    assert RATE.fault(float("inf"))
    assert LOAD.fault_of_all(np.array([1.0, -2e12])) == (
        "reaches 2e+12 mN, expected at most 1e+12 (the weight of a hundred thousand tonnes)"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rig: {wiring: {sample_rate_hz: 1.0e+12}}", "sample_rate_hz is 1e.12 Hz, expected 100 to 1e.08: contact"),
        ("rig: {wiring: {sample_rate_hz: 1.0e-9}}", "sample_rate_hz is 1e-09 Hz, expected 100"),
        ("rig: {masses: {uncertainty_kg: 1.0e+9}}", r"uncertainty_kg is 1e\+09 kg, as much as the masses themselves"),
        ("rig: {masses: {m1_kg: 1.0e-20, uncertainty_kg: 0}}", "m1_kg is 1e-20 kg, expected at least 1e-09"),
        (r'mesotap: {operator: "a\0b"}', "mesotap.operator: holds a zero or half a character"),
        (r'mesotap: {specimen: "\ud800"}', "mesotap.specimen: holds a zero or half a character"),
        (
            "mesotap: {title: " + 70_000 * "x" + "}",
            "title: is 70000 bytes long, a session file can keep 60000; shorten",
        ),
    ],
)
def test_a_configuration_whose_sessions_could_not_be_read_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_config(text)


def test_a_calibration_of_impossible_loads_is_no_entry() -> None:
    entry = {"event": "calibrated", "load_mn": [1e300], "voltage_mv": [1.0], "time": ""}
    assert fault_of(entry).startswith("entry 'calibrated': load_mn.0 is 1e+300: input should be less than")


def analysed(session: object) -> object:
    masses, springs = Masses(), Springs(system_resonance_hz=356.0)
    return analyse_session(session, AnalysisSettings(), CalibrationSettings(), masses, springs)  # type: ignore[arg-type]


def test_a_high_pass_that_passes_nothing_is_told() -> None:
    session = small_session()
    with pytest.raises(AnalysisError, match="the declared high-pass begins at 20000 Hz, so nothing"):
        analysed(replace(session, rig=replace(session.rig, highpass_hz=2e4)))


def test_a_record_that_ends_before_its_pulse_has_no_modes() -> None:
    session = small_session(samples=512)
    fast = replace(session.rig, sample_rate_hz=1e10)
    impacts = tuple(replace(impact, sample_rate_hz=1e10) for impact in session.impacts)
    results = analysed(replace(session, rig=fast, impacts=impacts))
    assert all(load.f2_hz is None for load in results.loads)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("rate", "scale", "said"),
    [
        (1e-300, 1.0, "its sampling rate is 1e-300 Hz, expected at least"),
        (1e308, 1.0, r"its sampling rate is 1e\+308 Hz, expected at most"),
        (1000.0, 1e160, r"channel a reaches .*e\+1\d\d of its unit"),
        (1000.0, 1e-160, "channel a reaches .*e-1.. of its unit"),
    ],
)
def test_a_recording_by_another_program_is_bounded_too(tmp_path: Path, rate: float, scale: float, said: str) -> None:
    path = tmp_path / "r.csv"
    values = scale * np.exp(-np.arange(600) / 200) * np.sin(np.arange(600))
    path.write_text("a\n" + "\n".join(repr(float(v)) for v in values) + "\n")
    with pytest.raises(RecordingError, match=said):
        opened(path, rate)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_recording_that_never_changes_is_named(value: float) -> None:
    recording = Recording(np.full((2, 1000), value), 1000.0, ("a", "b"), "", "c.csv")
    with pytest.raises(FitFailure, match=r"c\.csv: no channel ever changes its value"):
        modes_of(recording, "ml")


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_heights_that_no_surface_has_are_refused(scale: float) -> None:
    text = "# unit: um\n# spacing_um: 1\n" + "\n".join(repr(scale * (i % 7)) for i in range(64))
    with pytest.raises(ScanError, match=r"its heights differ by .* m, expected 1e-15 to 1000 m"):
        parse_scan(text, "s.csv")
