"""``mesotap export``: sessions and recordings for other programs."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
import pyuff
from rich.console import Console

from daq.errors import RecordingError
from daq.exchange import import_recording
from daq.session_file import write_session
from mesotap.commands.export import export
from tests.mesotap.report.test_report import make_session


def exported(source, output, **options) -> str:
    said = io.StringIO()
    flags = options.get("text", False), options.get("modes", False), options.get("json")
    export(source, output, options.get("rate"), *flags, Console(file=said))
    return said.getvalue()


@pytest.fixture(scope="module")
def session_file(tmp_path_factory):
    session = make_session(loads=2)[0]
    file = tmp_path_factory.mktemp("export") / "session.h5"
    write_session(file, session)
    return file, session


def test_the_accepted_impacts_of_a_session(tmp_path, session_file):
    file, session = session_file
    assert "32 channels, 5000 samples at 25000 Hz" in exported(file, tmp_path / "s.mat")
    accepted = np.concatenate([i.acceleration for i in session.impacts if i.accepted])
    assert np.array_equal(import_recording(tmp_path / "s.mat").data, accepted)


def test_the_force_of_a_hammer_goes_along(tmp_path, session_file):
    _, session = session_file
    force = np.linspace(0.0, 2.0, 5000)
    impacts = [i if k else replace(i, force=force) for k, i in enumerate(i for i in session.impacts if i.accepted)]
    write_session(tmp_path / "hammer.h5", replace(session, impacts=tuple(impacts)))
    assert "33 channels" in exported(tmp_path / "hammer.h5", tmp_path / "hammer.uff")
    third = pyuff.UFF(str(tmp_path / "hammer.uff")).read_sets(3)
    assert np.array_equal(third["data"], force)
    assert (third["id1"], third["ordinate_spec_data_type"]) == (f"{impacts[0].name} force", 13)
    again = import_recording(tmp_path / "hammer.uff")
    assert again.units[:4] == ("m/s2", "m/s2", "N", "m/s2")


def test_modes_of_a_recording_go_along(tmp_path):
    t = np.arange(4000) / 4000
    rng = np.random.default_rng(2)
    tones = [np.exp(-2 * np.pi * f * 0.01 * t) * np.sin(2 * np.pi * f * np.sqrt(1 - 1e-4) * t) for f in (90.0, 400.0)]
    data = np.array([[1.0, 0.5], [2.0, -0.5]]) @ np.array(tones) + 1e-3 * rng.standard_normal((2, 4000))
    np.savetxt(tmp_path / "r.csv", np.column_stack([t, data.T]), delimiter=",", header="time [s],a,b", comments="")
    assert "2 modes" in exported(tmp_path / "r.csv", tmp_path / "r.uff", modes=True, json=tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text())["channels"] == ["a", "b"]
    modes = [s for s in pyuff.UFF(str(tmp_path / "r.uff")).read_sets() if s["type"] == 55]
    for mode, f, shape in zip(modes, (90.0, 400.0), ([0.5, 1.0], [1.0, -1.0]), strict=True):
        assert abs(mode["eig"]) == pytest.approx(2 * np.pi * f, rel=1e-3)
        assert -mode["eig"].real / abs(mode["eig"]) == pytest.approx(0.01, rel=0.02)
        assert mode["r1"] / mode["r1"][np.argmax(np.abs(shape))] == pytest.approx(np.array(shape), abs=0.01)


def test_what_cannot_be_exported_is_one_sentence(tmp_path, session_file):
    file, session = session_file
    with pytest.raises(RecordingError, match="is a session, whose modes"):
        exported(file, tmp_path / "s.uff", modes=True)
    none = tmp_path / "none.h5"
    write_session(none, replace(session, impacts=tuple(replace(i, accepted=False) for i in session.impacts)))
    with pytest.raises(RecordingError, match="holds no accepted impact"):
        exported(none, tmp_path / "s.uff")
    unlike = tmp_path / "unlike.h5"
    first = replace(session.impacts[0], acceleration=session.impacts[0].acceleration[:, :4000])
    write_session(unlike, replace(session, impacts=(first, *session.impacts[1:])))
    with pytest.raises(RecordingError, match="unlike in length or rate"):
        exported(unlike, tmp_path / "s.uff")
    assert not (tmp_path / "s.uff").exists()
