"""The screen of a session at the terminal: what it shows of each thing that it is told, and a whole session on it."""

from __future__ import annotations

import doctest
import fcntl
import io
import os
import pty
import re
import struct
import sys
import termios
import threading
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from daq.journal import SessionFolder
from mesotap.configuration.config import Config
from mesotap.operator import session_screen, tap_analysis
from mesotap.operator.session_screen import SessionScreen, sparkline
from mesotap.operator.tap_analysis import TapAnalysis
from mesotap.session.states import State
from tests.mesotap.report.test_report import make_session

TAP = replace(make_session(loads=1)[0].impacts[0], extra={"force_ratio": 0.51})
HANGS_S = 60.0
MODES = {"f2_hz": {"value": 1406.65}, "zeta2": {"value": 0.02756}, "k_c": {"value": 3.9288e6}}


@pytest.fixture
def screen():
    shown = SessionScreen(Console(force_terminal=True, width=150, record=True), keys=True)
    shown._plan, shown._limit_mn, shown._force_limit, shown._wanted = [300.0, 900.0], 1100.0, 0.8, 8
    return shown


def lines(screen: SessionScreen) -> list[str]:
    console = Console(width=150, file=io.StringIO(), record=True)
    console.print(screen.lines())
    return console.export_text().splitlines()


def test_before_anything_is_known(screen):
    where, load, row, tap, _, keys = [*lines(screen)[:4], "", lines(screen)[-1]]
    assert where.strip() == "starting"
    assert load.split()[0] == "–"
    assert "□□□□□□□□ 0 of 8 good taps; 0 of 16 in all" in row
    assert tap.strip() == "no tap yet"
    assert keys.strip() == "p pause   q end, with the surfaces apart"


def test_load_taps_and_what_the_last_came_to(screen):
    screen.progress(State.TAP, "waiting for tap 3")
    screen.load(-0.2)
    assert lines(screen)[1].split()[0] == "0"
    screen.load(550.0)
    screen.aim(1, 900.0)
    screen.impact(TAP, 3, 8)
    screen._found(TAP.number, MODES)
    where, load, row, tap, spectrum, _ = lines(screen)
    assert "waiting for tap 3" in where
    assert load.startswith(" 550 mN " + "━" * 11 + "┃" + "━" * 8 + "·" * 20)  # half of the limit
    assert "target 300" in load  # the tap is of the first load
    assert "■■■□□□□□ 3 of 8" in row
    assert "✓ used" in tap
    assert "51 % of the force that lifts off (limit 80 %)" in tap
    assert "f2 1406.7 Hz  zeta2 2.76 %  k_c 3.929 MN/m" in tap
    assert spectrum.startswith("100 ")


@pytest.mark.parametrize("width", [48, 60, 69, 80])
def test_load_and_spectrum_fit_a_narrow_screen(width):
    narrow = SessionScreen(Console(force_terminal=True, width=width, record=True), keys=True)
    narrow._plan, narrow._limit_mn, narrow._wanted = [300.0, 900.0], 1100.0, 8
    narrow.load(550.0)
    narrow.impact(TAP, 1, 8)
    _, load, _, _, spectrum, _ = (line.rstrip() for line in lines(narrow))
    assert max(len(load), len(spectrum)) <= width
    assert load.endswith("target 300, limit 1100 mN")
    assert spectrum.endswith(" 10000 Hz")
    assert "█" in spectrum


def test_the_last_tap_that_is_analysed_is_shown_with_its_number(screen):
    screen.impact(TAP, 1, 8)
    screen._found(TAP.number, MODES)
    screen.impact(replace(TAP, number=TAP.number + 2), 2, 8)
    assert f"tap {TAP.number + 2} ✓ used" in lines(screen)[3]
    assert f"  tap {TAP.number}:  f2 1406.7 Hz  zeta2 2.76 %  k_c 3.929 MN/m" in lines(screen)[3]
    screen._found(TAP.number + 2, MODES)
    assert ":  f2" not in lines(screen)[3]


@pytest.fixture
def told(monkeypatch):
    """What the analysis is told, number of the tap and whether it is an old one; there is no process."""
    told = []

    class Link:
        def __init__(self, connection, heard, lost, silent_s):
            self.end, self.start = connection.close, lambda: None

        def tell(self, message, numbers=b""):
            told.append((message.get("number"), message.get("old")))

    monkeypatch.setattr(tap_analysis, "SessionLink", Link)
    monkeypatch.setattr(tap_analysis, "ANALYST", "this")
    return told


def test_taps_that_come_faster_than_their_analysis_hold_it_up_by_one(told):
    analysis, found = TapAnalysis({}, lambda number, modes: found.append(number)), []
    try:
        for number in range(3):  # it has not begun
            analysis.tap(replace(TAP, number=number))
        assert told == [(None, None)]
        analysis._heard({"kind": "theory"})
        assert told[1:] == [(0, True), (1, True), (2, False)]
        analysis.tap(replace(TAP, number=3))
        analysis.tap(replace(TAP, number=4))
        assert len(told) == 4
        analysis._heard({"kind": "modes", "number": 2, "modes": MODES})
        analysis._heard({"kind": "results"})
        assert told[4:] == [(3, True), (4, False)]
        analysis._heard({"kind": "unanalysed"})
        analysis.tap(replace(TAP, number=5))
        assert told[6:] == [(5, False)]
        assert found == [2]
    finally:
        analysis.end()


def test_a_session_that_is_over_waits_for_its_latest_tap_and_for_nothing_else(told):
    analysis = TapAnalysis({}, lambda number, modes: None)
    settled = threading.Event()

    def settle():
        analysis.settle(HANGS_S)
        settled.set()

    try:
        analysis.settle(HANGS_S)  # no tap: whether it has begun does not matter
        analysis.tap(TAP)
        threading.Thread(target=settle, daemon=True).start()
        assert not settled.is_set()
        analysis._heard({"kind": "theory"})
        assert not settled.is_set()
        analysis._heard({"kind": "results"})
        assert settled.wait(HANGS_S / 2)
        analysis.tap(TAP)
        analysis.settle(0.0)  # it answers nothing
        analysis._lost()
        analysis.settle(HANGS_S)
    finally:
        analysis.end()


class Analysis:
    """Finds something in the latest tap when it is waited for."""

    def __init__(self, begun, found):
        self.found, self.settled = found, False

    def tap(self, impact):
        pass

    def settle(self, longest_s):
        self.settled = True
        self.shown = lines(self.found.__self__)
        self.found(TAP.number, MODES)

    def end(self):
        pass


def test_what_the_latest_tap_came_to_stays_on_the_terminal(screen, monkeypatch, tmp_path):
    monkeypatch.setattr(session_screen, "TapAnalysis", Analysis)
    with SessionFolder.create(tmp_path / "s", {"config": ""}) as folder, screen.watching(folder, Config()) as seen:
        seen.impact(TAP, 1, 8)
    assert f"tap {TAP.number}:  f2 1406.7 Hz  zeta2 2.76 %  k_c 3.929 MN/m" in screen._console.export_text()
    assert screen._analysis.shown[0] == "the surfaces are apart; working out the latest tap  "
    assert screen._analysis.shown[-1] == "Ctrl-C leaves out the report, which 'mesotap resume' writes"


def test_who_ends_a_session_waits_for_no_analysis(screen, monkeypatch, tmp_path):
    monkeypatch.setattr(session_screen, "TapAnalysis", Analysis)
    with (
        SessionFolder.create(tmp_path / "s", {"config": ""}) as folder,
        pytest.raises(RuntimeError),
        screen.watching(folder, Config()) as seen,
    ):
        seen.impact(TAP, 1, 8)
        raise RuntimeError
    assert not screen._analysis.settled


def test_a_tap_that_is_not_used_is_told_above(screen):
    screen.impact(replace(TAP, accepted=False, reject_reason="a second [impact]\x1b[2J"), 0, 8)
    assert "✗ not used" in lines(screen)[3]
    said = screen._console.export_text()
    assert "tap 0 not used: a second [impact]" in said
    assert "\x1b[2J" not in said


def test_a_hammer_has_a_line_of_its_own_and_leaves_none_without(screen):
    screen.impact(TAP, 1, 8)
    assert not any("hammer" in line for line in lines(screen))
    force = np.zeros(TAP.acceleration.shape[1])
    begin = max(TAP.pretrigger - 4, 0)
    force[begin : begin + 9] = 5 * np.sin(np.pi * np.arange(9) / 8)
    screen.impact(replace(TAP, force=force), 2, 8)
    assert "hammer 5 N, excites to" in lines(screen)[5]
    screen.impact(replace(TAP, force=0 * force), 3, 8)
    assert "never changes" in lines(screen)[5]
    screen.aim(1, 900.0)
    assert not any("hammer" in line for line in lines(screen))


def test_the_spectrum_has_its_peak_where_the_mode_is():
    t = np.arange(5000) / 25000
    for f in (356.0, 1406.0, 5000.0):
        line = sparkline(np.exp(-20 * t) * np.sin(2 * np.pi * f * t), 25000.0)
        letters = line.removeprefix("100 ").removesuffix(" 10000 Hz")
        assert len(letters) == 56
        assert letters.index("█") == pytest.approx(56 * np.log10(f / 100) / 2, abs=1.0)
    assert sparkline(np.zeros(100), 25000.0) == ""


def test_the_example():
    assert doctest.testmod(session_screen).failed == 0


SHORT = (
    "mesotap.load_plan_mn=[300]", "mesotap.impacts_per_load=3", "mesotap.dwell_s=1", "calibration.averaging_s=0.05",
    "calibration.repeats=1", "rig.limits.expected_contact_um=12", "sim_backend.contact_position_um=12",
    "sim_backend.gauge.weight_settling_s=0.1",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("time", [("--realtime",), ()], ids=["real time", "simulated time"])
def test_a_session_on_a_terminal(tmp_path, time):
    options = [word for change in SHORT for word in ("--set", change)]
    pid, terminal = pty.fork()
    if pid == 0:
        command = [sys.executable, "-m", "mesotap", "run", "--simulate", *time, *options, "-o", str(tmp_path / "s")]
        os.execve(sys.executable, command, {**os.environ, "TERM": "xterm", "COLUMNS": "150", "LINES": "40"})
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 150, 0, 0))
    seen = b""
    while True:
        try:
            piece = os.read(terminal, 65536)
        except OSError:  # it has ended
            break
        if not piece:
            break
        seen += piece
    os.close(terminal)
    assert os.waitpid(pid, 0)[1] == 0
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen.decode(errors="replace"))
    for words in ("p pause   q end", "■■■ 3 of 3 good taps", "✓ used", "target 300, limit 1100 mN"):
        assert words in text
    values = r"  f2 \d+\.\d Hz  zeta2 [\d.]+ %  k_c [\d.]+ MN/m"
    assert re.search(r"limit \d+ %\)" + values, text)
    assert re.search(r"[\r\n]tap \d+:" + values, text)
    assert (tmp_path / "s" / "report.html").is_file()
