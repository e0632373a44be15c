"""The process that works out what each tap came to, so that neither the session nor the pages wait for it.

``python -m mesotap.console.analyst_process DESCRIPTOR``. It is told what the session tells (``begun``,
``points``, ``tap``, ``judged``), and answers with ``modes`` of each tap, ``results`` of each load, whether the gauge
drifted, and when it is asked, a ``snapshot``: the session so far as a session file. It ends with the connection.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.theory import theory
from analysis.results import ImpactResult, LoadResult, SessionResults
from analysis.session import AnalysisError
from analysis.statistics import BoxStatistics
from calibration.estimate import Estimate
from calibration.line import CalibrationError, compare
from daq.errors import RecordingError
from daq.hits import is_left_out
from daq.records import CalibrationPoints, Impact, Session
from daq.session_file import write_session
from mesotap import __version__
from mesotap.answers.analysing import analysed_as_configured
from mesotap.configuration.config import Config, parse_config
from mesotap.console.frames import Message, frame, read_frame
from mesotap.session.live_hammer import response_told
from mesotap.session.progress import chosen_of_surplus, describe_rig

NOT_ANALYSED = (AnalysisError, CalibrationError, RecordingError, ValueError, ArithmeticError, np.linalg.LinAlgError)
"""What a tap that is none may lead to; the session file holds it for a closer look."""

THEORY_POINTS = 40
LEAST_LOAD_MN = 50.0
WARM_HZ = (356.0, 1500.0)
WARM_DECAYS = (3.0, 60.0)


class Analyst:
    """What is known of the running session, and what it came to so far."""

    def __init__(self) -> None:
        self._config = Config()
        self._begun: Message = {}
        self._points: dict[str, list[list[float]]] = {"before": [], "after": []}
        self._impacts: dict[int, Impact] = {}
        self._results: dict[int, LoadResult] = {}

    def begin(self, message: Message) -> dict[str, Any]:
        """Begin anew with a session; returns the theory that its contact stands beside."""
        self.__init__()  # type: ignore[misc]
        self._begun = message
        self._config = parse_config(message["config"], "the session's configuration")
        highest = 1.1 * max(self._config.mesotap.load_plan_mn)
        loads = np.linspace(LEAST_LOAD_MN, highest, THEORY_POINTS)
        curves = [
            {"name": curve.name, "load_mn": loads.tolist(), "k_c": curve.stiffness(loads * 1e-3).tolist()}
            for curve in theory(self._config.analysis.contact)
        ]
        return {"kind": "theory", "curves": curves}

    def calibrated(self, when: str, points: list[list[float]]) -> None:
        """Take in readings of the gauge under weights."""
        self._points[when] += points

    def compared(self) -> Message | None:
        """Return whether the calibrations before and after the test differ; None while there are not both."""
        before, after = (np.array(self._points[when], dtype=np.float64) for when in ("before", "after"))
        if not len(before) or len(after) < len(before):
            return None
        pre, post = (CalibrationPoints(points[:, 0], points[:, 1], "") for points in (before, after))
        try:
            verdict = compare(pre, post, self._config.calibration.drift_test_level)
        except NOT_ANALYSED:
            return None  # the session itself says what is wrong with it
        return {"kind": "compared", "drifted": bool(verdict.drifted), "statement": verdict.statement}

    def tap(self, message: Message, numbers: bytes) -> int:
        """Take in a tap; returns its load set."""
        impact = impact_of(message, numbers)
        self._impacts[impact.number] = impact
        return impact.load_set

    def judge(self, message: Message) -> int | None:
        """Take in a verdict by hand; returns the load set of the tap."""
        impact = self._impacts.get(message["number"])
        if impact is None:
            return None
        reason = "" if message["accepted"] else f"by hand: {message['reason']}"
        self._impacts[impact.number] = replace(impact, accepted=message["accepted"], reject_reason=reason)
        return impact.load_set

    def results(self, load_set: int | None) -> list[Message]:
        """Analyse one load, or with None all of them together: springs and noise are those of all taps then."""
        asked = [i for i in self._impacts.values() if load_set is None or i.load_set == load_set]
        taken = list(chosen_of_surplus(asked, self._config))
        if not any(i.accepted for i in taken):
            self._results.pop(-1 if load_set is None else load_set, None)
            return [self._told()]
        try:
            results = self._analysed(taken)
        except NOT_ANALYSED as error:
            return [{"kind": "unanalysed", "load_set": load_set, "why": str(error)}]
        self._results |= {load.load_set: load for load in results.loads if load.impacts_used}
        modes = [
            {"kind": "modes", "number": impact.number, "modes": modes_of(found)}
            for impact, found in zip(taken, results.impacts, strict=True)
            if found.f2_hz is not None
        ]
        return [*self._choice(taken), *modes, self._told()]

    def _choice(self, taken: Sequence[Impact]) -> list[Message]:
        """Say which taps are left out by the choice of hits so far, and why; nothing where there is no surplus."""
        if not self._config.mesotap.surplus_impacts:
            return []
        left = {str(i.number): i.reject_reason for i in taken if is_left_out(i)}
        return [{"kind": "chosen", "taps": [i.number for i in taken], "left_out": left}]

    def hammer(self, number: int) -> list[Message]:
        """Say what a hammer's force shows in a tap, with the earlier ones of its load; nothing without one."""
        impact = self._impacts[number]
        if impact.force is None:
            return []
        from analysis.frequency_response.so_far import hammer_so_far  # only where there is a hammer

        own = [i for i in self._impacts.values() if i.load_set == impact.load_set and i.number <= number]
        taken = [i for i in own if i.accepted or i is impact]
        found = hammer_so_far(taken, describe_rig(self._config.rig), self._config.rig.wiring.hammer)
        return [
            {"kind": "hammer", "number": number, "words": found.words},
            response_told(found) | {"load_set": impact.load_set},
        ]

    def alone(self, number: int) -> list[Message]:
        """Analyse one tap by itself."""
        impact = self._impacts[number]
        if not impact.accepted:
            return []
        try:
            (found,) = self._analysed([impact]).impacts
        except NOT_ANALYSED:
            return []  # of all taps of its load together it is said why
        return [] if found.f2_hz is None else [{"kind": "modes", "number": number, "modes": modes_of(found)}]

    def snapshot(self, path: Path) -> Message:
        """Write the session so far to a file."""
        impacts = chosen_of_surplus((self._impacts[n] for n in sorted(self._impacts)), self._config)
        if not any(i.accepted for i in impacts):
            return {"kind": "snapshot", "why": "there is no accepted tap yet"}
        write_session(path, self._session(impacts))
        return {"kind": "snapshot", "path": str(path), "taps": len(impacts)}

    def _told(self) -> Message:
        return {"kind": "results", "loads": [load_told(self._results[k]) for k in sorted(self._results)]}

    def _session(self, impacts: tuple[Impact, ...]) -> Session:
        pre, post = (self._calibration(when) for when in ("before", "after"))
        names = self._config.mesotap
        return Session(
            created=str(self._begun.get("created", "")),
            rig=replace(describe_rig(self._config.rig), sample_rate_hz=impacts[0].sample_rate_hz),
            impacts=impacts,
            pre=pre,
            post=post,
            operator=names.operator,
            specimen=names.specimen,
            title=names.title,
            software=f"mesotap {__version__}" + (" (simulated rig)" if self._begun.get("simulated") else ""),
            config=str(self._begun.get("config", "")),
            source="the session so far",
        )

    def _analysed(self, impacts: list[Impact]) -> SessionResults:
        config = self._config
        # what the hammer says of k_c is the report's: here it would only take time
        session = replace(self._session(tuple(replace(i, force=None) for i in impacts)), post=None)
        return analysed_as_configured(session, config)

    def _calibration(self, when: str) -> CalibrationPoints | None:
        weights = len(set(self._config.calibration.weights_mn))
        points = np.array(self._points[when], dtype=np.float64)
        if len(points) < weights:
            return None
        time = min((i.time for i in self._impacts.values()), default=str(self._begun.get("created", "")))
        return CalibrationPoints(points[:, 0], points[:, 1], time)


def impact_of(message: Message, numbers: bytes) -> Impact:
    """Return the impact that a session told of."""
    rows = np.frombuffer(numbers, dtype=np.float64).reshape(-1, message["samples"])

    def known(name: str) -> float:
        return float("nan") if message[name] is None else float(message[name])

    return Impact(
        number=message["number"],
        load_set=message["load_set"],
        target_load_mn=message["target_mn"],
        time=message["time"],
        sample_rate_hz=message["rate_hz"],
        pretrigger=message["pretrigger"],
        acceleration=rows[:2],
        force=rows[2] if len(rows) > 2 else None,
        accepted=message["accepted"],
        reject_reason=message["reason"],
        load_before_mn=known("before_mn"),
        load_after_mn=known("after_mn"),
        voltage_before_mv=known("before_mv"),
        voltage_after_mv=known("after_mv"),
    )


def told(estimate: Estimate | None) -> dict[str, float] | None:
    """Return an estimate with half of its 95 % interval."""
    return None if estimate is None else {"value": estimate.value, "half": estimate.half_width}


def modes_of(impact: ImpactResult) -> dict[str, Any]:
    """What a page shows of one tap."""
    return {
        "f1_hz": told(impact.f1_hz),
        "f2_hz": told(impact.f2_hz),
        "zeta2": told(impact.zeta2),
        "k_c": told(impact.contact_stiffness_n_per_m),
        "c_c": told(impact.contact_damping_n_s_per_m),
        "notes": list(impact.notes),
    }


def load_told(load: LoadResult) -> dict[str, Any]:
    """What a page shows of one load."""
    return {
        "load_set": load.load_set,
        "load_mn": load.target_load_mn if load.load_mn is None else load.load_mn.value,
        "used": load.impacts_used,
        "f2_hz": told(load.f2_hz),
        "zeta2": told(load.zeta2),
        "k_c": told(load.contact_stiffness_n_per_m),
        "c_c": told(load.contact_damping_n_s_per_m),
        "stiffness_box": box_told(load.stiffness_box),
        "damping_box": box_told(load.damping_box),
        "notes": list(load.notes),
    }


def box_told(box: BoxStatistics | None) -> dict[str, Any] | None:
    """Return box and whiskers as a page draws them."""
    if box is None:
        return None
    names = ("lower_whisker", "lower_quartile", "median", "upper_quartile", "upper_whisker")
    return {**{name: getattr(box, name) for name in names}, "outliers": list(box.outliers)}


def warm_up() -> None:
    """Have compiled what is compiled at first use, before the first tap is waited for."""
    config, rng = Config(), np.random.default_rng(1)
    rate, n, before = config.rig.wiring.sample_rate_hz, 3000, 250
    t = np.arange(n - before) / rate
    ringing = sum(np.exp(-decay * t) * np.cos(2 * np.pi * f * t) for f, decay in zip(WARM_HZ, WARM_DECAYS, strict=True))
    impacts = []
    for number in range(2):
        record: NDArray[np.float64] = 1e-3 * rng.standard_normal((2, n))
        record[:, before:] += ringing
        impacts.append(Impact(number, 0, 300.0, 300.0, 300.0, "2026-01-01T00:00:00.000Z", rate, before, record, True))
    session = Session("2026-01-01T00:00:00.000Z", describe_rig(config.rig), tuple(impacts))
    try:
        analysed_as_configured(session, config)
    except NOT_ANALYSED:
        return


def main(descriptor: int) -> None:
    """Answer until the connection ends."""
    connection = socket.socket(fileno=descriptor)
    threading.Thread(target=_end_with, args=(connection.fileno(),), daemon=True).start()
    analyst = Analyst()
    warm_up()
    with connection.makefile("rb") as stream:
        while (got := read_frame(stream.read)) is not None:
            message, numbers = got
            for answer in answers(analyst, message, numbers):
                connection.sendall(frame(answer))


def _end_with(descriptor: int) -> None:
    """End this process with its connection, whatever is being compiled or worked out: nobody wants it any more."""
    watched = select.poll()
    watched.register(descriptor, select.POLLRDHUP)
    watched.poll()
    os._exit(0)


def answers(analyst: Analyst, message: Message, numbers: bytes) -> Iterator[Message]:
    """Yield what is said to one message; of a tap first what it is by itself, which does not grow with their number."""
    what = message.get("kind")
    if what == "begun":
        yield analyst.begin(message)
    elif what == "points":
        analyst.calibrated(message["when"], message["points"])
        if (compared := analyst.compared()) is not None:
            yield compared
    elif what == "tap":
        load_set = analyst.tap(message, numbers)
        if not message.get("old"):
            yield from analyst.alone(message["number"])
            yield from analyst.hammer(message["number"])
            yield from analyst.results(load_set)
    elif what == "judged":
        judged = analyst.judge(message)
        if judged is not None:
            yield from analyst.results(judged)
    elif what == "all":
        yield from analyst.results(None)
    elif what == "snapshot":
        yield analyst.snapshot(Path(message["path"]))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(int(sys.argv[1]))
