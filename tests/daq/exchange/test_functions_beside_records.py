"""Universal files that hold frequency responses and other functions beside their time records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyuff

from daq.errors import RecordingError
from daq.exchange import import_recording

RATE_HZ, SAMPLES = 1000.0, 64
RECORD = np.random.default_rng(58).standard_normal(SAMPLES)
RESPONSE = np.fft.rfft(RECORD)


def written(path: Path, *kinds: int | str) -> Path:
    """Write a data set for each function type of 58; "shape" stands for a data set 55."""
    sets = []
    for number, kind in enumerate(kinds, start=1):
        if kind == "shape":
            sets.append(
                pyuff.prepare_55(
                    model_type=1, analysis_type=3, data_ch=2, spec_data_type=12, load_case=1, mode_n=1, eig=-1 + 10j,
                    r1=np.ones(1, complex), r2=np.zeros(1, complex), r3=np.zeros(1, complex),
                    modal_a=0j, modal_b=0j, node_nums=[1],
                )
            )  # fmt: skip
            continue
        in_time = kind == 1
        data = RECORD if in_time else RESPONSE if kind in (3, 4) else np.abs(RESPONSE)
        step = 1 / RATE_HZ if in_time else RATE_HZ / SAMPLES
        sets.append(
            pyuff.prepare_58(
                binary=0, func_type=kind, id1=f"function {number}", rsp_node=number, rsp_dir=1, ref_node=1, ref_dir=1,
                num_pts=data.size, abscissa_spacing=1, abscissa_spec_data_type=17 if in_time else 18,
                abscissa_axis_units_lab="s" if in_time else "Hz", ordinate_spec_data_type=12,
                ordinate_axis_units_lab="m/s^2", orddenom_spec_data_type=0, z_axis_spec_data_type=0,
                data=data, x=step * np.arange(data.size),
            )
        )  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
    return path


def test_frequency_responses_beside_time_records_are_named(tmp_path: Path) -> None:
    recording = import_recording(written(tmp_path / "both.uff", 1, 1, 4, 4, 6, "shape"))
    assert recording.names == ("function 1", "function 2")
    assert recording.data[0] == pytest.approx(RECORD, rel=1e-10)
    assert recording.left_out == (
        "2 x frequency response, data sets 3 to 4 (modes are identified from time records alone)",
        "a coherence, data set 5 (modes are identified from time records alone)",
        "a mode shape, data set 6 (modes are identified anew)",
    )


def test_functions_between_time_records_are_counted_by_their_data_sets(tmp_path: Path) -> None:
    recording = import_recording(written(tmp_path / "mixed.uff", 4, 1, 4))
    assert recording.left_out == (
        "2 x frequency response, data sets 1 ... 3 (modes are identified from time records alone)",
    )


def test_time_records_alone_leave_nothing_out(tmp_path: Path) -> None:
    assert import_recording(written(tmp_path / "time.uff", 1, 1)).left_out == ()


def test_frequency_responses_alone_are_refused_still(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="2 x frequency response: modes are identified from the samples"):
        import_recording(written(tmp_path / "frf.uff", 4, 4))
