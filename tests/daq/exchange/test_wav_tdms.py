"""WAV and TDMS files, written by other libraries and read back; and universal files without time responses."""

from __future__ import annotations

import sys
import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import wavfile

from daq.errors import RecordingError
from daq.exchange import import_recording
from daq.exchange.importing import columns_of
from daq.exchange.tdms import read_tdms
from daq.exchange.units import to_si

RATE = 8000
T = np.arange(800) / RATE
DECAYS = np.stack([np.exp(-20 * T) * np.sin(2 * np.pi * f * T) for f in (356.0, 1904.0)])
FULL = {np.uint8: 2.0**7, np.int16: 2.0**15, np.int32: 2.0**31}


def wav(path: Path, samples: np.ndarray) -> Path:
    wavfile.write(path, RATE, samples.T)
    return path


@pytest.mark.parametrize("dtype", FULL, ids=lambda d: d.__name__)
def test_whole_numbers_are_shares_of_full_scale(tmp_path: Path, dtype: type) -> None:
    full = FULL[dtype]
    codes = np.round(0.9 * DECAYS * (full - 1))
    read = import_recording(wav(tmp_path / "x.wav", (codes + (full if dtype is np.uint8 else 0)).astype(dtype)))
    assert (read.rate_hz, read.names, read.unit) == (RATE, ("channel1", "channel2"), "")
    assert np.allclose(read.data, codes / full, rtol=0, atol=1e-12)


def test_24_bits_of_one_channel(tmp_path: Path) -> None:
    codes = np.round(DECAYS[0] * (2**23 - 1)).astype(np.int32)
    with wave.open(str(tmp_path / "x.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(3)
        file.setframerate(RATE)
        file.writeframes(codes.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3].tobytes())
    assert np.allclose(import_recording(tmp_path / "x.wav").data, codes / 2.0**23, rtol=0, atol=1e-12)


def test_floating_point_is_taken_as_it_is(tmp_path: Path) -> None:
    assert np.array_equal(import_recording(wav(tmp_path / "x.wav", 7.5 * DECAYS)).data, 7.5 * DECAYS)


def test_the_ending_does_not_matter(tmp_path: Path) -> None:
    assert import_recording(wav(tmp_path / "recording.dat", DECAYS)).rate_hz == RATE


def tdms(path: Path, changes: dict[str, object] | None = None, **more: object) -> Path:
    """Write two channels in g as NI-DAQmx does, and others beside them."""
    properties = {"wf_increment": 1 / RATE, "unit_string": "g", "wf_start_time": np.datetime64("2026-11-24T10:00")}
    channels = [ChannelObject("log", f"acc {i}", row, properties) for i, row in enumerate(DECAYS)]
    for name, values in more.items():
        channels.append(ChannelObject("log", name, values, {**properties, **(changes or {})}))
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
    return path


def test_a_tdms_file_is_read_with_its_units(tmp_path: Path) -> None:
    read = import_recording(tdms(tmp_path / "x.tdms"))
    assert (read.rate_hz, read.names, read.unit, read.left_out) == (RATE, ("acc 0", "acc 1"), "m/s2", ())
    assert np.allclose(read.data, DECAYS * to_si("g")[1])


@pytest.mark.parametrize(
    ("values", "changes", "why"),
    [
        (DECAYS[0][:100], {}, "100 samples"),
        (DECAYS[0], {"wf_increment": 1e-3}, "another sampling rate"),
        (DECAYS[0], {"wf_start_time": np.datetime64("2026-11-24T10:01")}, "begins at another time"),
        (["a"] * 800, {}, "no numbers"),
    ],
)
def test_what_does_not_belong_to_the_recording_is_named(tmp_path: Path, values, changes, why: str) -> None:
    assert import_recording(tdms(tmp_path / "x.tdms", changes, other=values)).left_out == (f"other ({why})",)


def test_without_a_step_the_rate_is_asked_for(tmp_path: Path) -> None:
    with TdmsWriter(str(tmp_path / "x.tdms")) as writer:
        writer.write_segment([ChannelObject("a", "x", DECAYS[0]), ChannelObject("b", "x", DECAYS[1])])
    with pytest.raises(RecordingError, match="give the rate in Hz"):
        import_recording(tmp_path / "x.tdms")
    assert import_recording(tmp_path / "x.tdms", rate_hz=RATE).names == ("a/x", "b/x")


def test_without_the_library_it_is_said_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(RecordingError, match=r"pip install 'mesotap\[tdms\]' lets mesotap read; or write it as CSV"):
        read_tdms(tmp_path / "x.tdms", b"TDSm")


@pytest.mark.parametrize("write", [wav, tdms], ids=["wav", "tdms"])
def test_what_is_cut_or_damaged_is_refused_in_a_sentence_or_read(tmp_path: Path, write: Callable[..., Path]) -> None:
    path = write(tmp_path / "x") if write is tdms else write(tmp_path / "x", DECAYS)
    content, random = path.read_bytes(), np.random.default_rng(22)
    for share in (0.02, 0.3, 0.6, 0.97, 0.999):
        with pytest.raises(RecordingError, match=r"truncated|damaged"):
            columns_of(path, content[: int(share * len(content))])
    for _ in range(150):
        damaged = bytearray(content)
        for place in random.integers(4, 400, size=3):
            damaged[place] = random.integers(256)
        try:
            columns = columns_of(path, bytes(damaged))
        except RecordingError as error:
            assert "\n" not in str(error)
        else:
            assert all(values.ndim == 1 for values in columns.data)


def test_other_riff_files_and_compressed_sound_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.avi").write_bytes(b"RIFF" + (600).to_bytes(4, "little") + b"AVI " + bytes(600))
    with pytest.raises(RecordingError, match=r"is not a recording but a RIFF file of kind b'AVI '"):
        import_recording(tmp_path / "x.avi")
    content = bytearray(wav(tmp_path / "x.wav", np.int16(1000 * DECAYS)).read_bytes())
    content[20] = 2  # ADPCM
    (tmp_path / "x.wav").write_bytes(content)
    with pytest.raises(RecordingError, match=r"samples are not plain numbers .*; write it as PCM"):
        import_recording(tmp_path / "x.wav")


def test_frequency_responses_and_shapes_alone_say_what_to_do(tmp_path: Path) -> None:
    frequency = np.arange(64.0)
    response = pyuff.prepare_58(
        binary=0,
        func_type=4,
        rsp_node=1,
        rsp_dir=1,
        ref_dir=1,
        ref_node=1,
        data=1 / (1j * frequency + 1),
        x=frequency,
        id1="H",
        rsp_ent_name="a",
        ref_ent_name="b",
        abscissa_spacing=1,
        abscissa_spec_data_type=18,
        ordinate_spec_data_type=12,
        orddenom_spec_data_type=13,
    )
    shape = pyuff.prepare_55(
        model_type=1,
        analysis_type=2,
        data_ch=2,
        spec_data_type=12,
        data_type=2,
        r1=np.ones(3),
        r2=np.ones(3),
        r3=np.ones(3),
        n_data_per_node=3,
        node_nums=[1, 2, 3],
        load_case=1,
        mode_n=1,
        modal_m=0,
        freq=10.0,
        modal_damp_vis=0.0,
        modal_damp_his=0.0,
    )
    file = tmp_path / "x.uff"
    pyuff.UFF(str(file)).write_sets([response, response, shape], mode="overwrite")
    with pytest.raises(RecordingError) as caught:
        import_recording(file)
    assert "holds no time response (data set 58), but 2 x frequency response, 1 x mode shape: modes are" in str(
        caught.value
    )
    assert "write its time records (data sets 58 of function type 1), or as CSV or MAT" in str(caught.value)


def test_a_wave_of_unknown_length_is_read_to_its_end(tmp_path: Path) -> None:
    content = bytearray(wav(tmp_path / "x.wav", np.int16(1000 * DECAYS)).read_bytes())
    at = content.index(b"data") + 4
    content[at : at + 4] = b"\xff" * 4  # a program that wrote to a pipe could not know
    assert columns_of(tmp_path / "x.wav", bytes(content)).data[0].size == T.size
