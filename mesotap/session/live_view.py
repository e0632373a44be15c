"""The live view: both accelerometers and the load, for setting up; nothing moves, and the load is watched.

Somebody may turn the micrometer by hand meanwhile. So the view begins with the surfaces apart, what the gauge reads
then counts as no load, and from then on the interlock watches as in a session: over the limit, with a gauge that is
silent or a stage that does not answer, the surfaces are taken apart. So they are by STOP, and when the console dies.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq.live_signals import LiveSignals
from mesotap.configuration.config import Config
from mesotap.session.guardian import Guardian
from mesotap.session.live_hammer import LiveHammer
from mesotap.session.runner import Control
from mesotap.session.self_test import gauge_zero
from mesotap.session.tap_check import DONE, QUIET, WAITING, TapCheck
from mesotap.session.watching import GaugeWatch
from rig import GaugeScale, Operator, Rig, RigError
from rig.attention import Attention
from rig.errors import MesotapError, SessionAborted
from rig.interlock import Interlock
from rig.watch import LoadWatch

PICTURE_S = 0.1
FIRST_AVERAGES, FIRST_SPAN_MS = 16, 50.0
NEAR_LIMIT = 0.8  # of the load limit, from which the person is told to turn no further
BELOW_ZERO = 3.0  # contact thresholds under the zero that no load makes: the zero was read under load
SETUP_DAMPING = 0.005
"""Damping ratio of the simulated tube springs: without any a simulated mass rings on until its record ends."""

TAP_FIRST = "Press 'Check by one tap', then tap the lower mass once, from above."


@dataclass(frozen=True, slots=True)
class ViewBench:
    """What a live view is run with: rig and people, as a session's."""

    rig: Rig
    operator: Operator
    control: Control
    tell: Callable[..., None]
    """Sends a message, with its numbers."""
    guardian: Guardian
    gauge: GaugeWatch
    wishes: deque[dict[str, Any]]
    """What pages want: ``view``, ``reset``, ``drop``, ``check``, ``tap``, ``end``; filled by the thread that hears."""
    simulated: bool = False


class LiveView:
    """One live view.

    Parameters
    ----------
    config
        The configuration in force.
    bench
        Rig and people.
    now
        By which pictures are told, s.
    """

    def __init__(self, config: Config, bench: ViewBench, now: Callable[[], float] = time.monotonic) -> None:
        self._config, self._bench, self._now = config, bench, now
        self._rig, self._tell = bench.rig, bench.tell
        limits, sensitivity = config.rig.limits, config.rig.gauge_sensitivity_mv_per_mn
        self._interlock = Interlock(self._rig, limits, GaugeScale(sensitivity), config.rig.spring_stiffness())
        self._interlock.shown = self._see_load
        watch = LoadWatch(self._rig, self._interlock, limits.stale_reading_s)
        watch.taps = True
        self._attention = Attention(self._rig, watch, bench.guardian.beat, bench.control.check)
        self._attention.attend(bench.operator)
        self._wishes = bench.wishes
        self._load_mn, self._watched, self._ended = math.nan, False, False
        self._told_s = -math.inf
        self._hammer: LiveHammer | None = None
        self._check = TapCheck(config, self._rig.accelerometers, self._rig.clock, self._tap)

    def run(self) -> None:
        """Show what there is until somebody ends it.

        Raises
        ------
        RigError
            A part failed, or the interlock refused; whether the surfaces are apart is among its notes.
        SessionAborted
            Somebody pressed STOP.
        """
        error: BaseException | None = None
        try:
            try:
                self._begin()
                self._show()
            finally:
                self._attention.leaving = True
                self._bench.guardian.leave()
        except BaseException as caught:
            error = caught
            self._leave_safely(error)
            raise
        finally:
            self._let_go(error)

    def _begin(self) -> None:
        """Connect, and see that the surfaces are apart as far as that can be seen."""
        for line in self._rig.open():
            self._tell({"kind": "said", "text": line})
        self._attention.watch_moves()
        limits = self._config.rig.limits
        position = self._rig.stage.read().position_um
        if math.isfinite(position) and position >= limits.expected_contact_um:
            raise RigError(
                f"stage: it is at {position:.1f} um, where the surfaces are expected to touch (from "
                f"{limits.expected_contact_um:g} um on, rig.limits.expected_contact_um); take them apart, then begin"
            )
        zero_mv, usable, says = gauge_zero(self._rig, self._config)
        if not usable:
            raise RigError(f"gauge: {says}; without it nobody watches the load, so nothing is begun")
        scale = GaugeScale(self._config.rig.gauge_sensitivity_mv_per_mn, zero_mv)
        self._interlock.scale = scale
        self._bench.guardian.start()
        self._bench.guardian.scale(scale)
        self._bench.guardian.arm(True)
        self._interlock.contact = (position, 0.0)  # from now on they may touch whenever somebody turns
        self._watched = True
        self._tell({"kind": "said", "text": f"no load is {zero_mv:.3f} mV"})

    def _show(self) -> None:
        recorder, level = self._rig.accelerometers, self._config.daq.trigger.threshold_m_s2
        recorder.start()
        self._signals = LiveSignals(recorder, FIRST_AVERAGES, FIRST_SPAN_MS, False, level)
        if (hammer := self._config.rig.wiring.hammer) is not None:
            self._hammer = LiveHammer(self._config, hammer, self._signals)
            self._tell(self._hammer.told())
        while not self._ended:
            self._signals.read()
            self._attention.idle()
            while self._wishes:
                self._heed(self._wishes.popleft())
            self._check.follow(self._signals)
            if self._hammer is not None and self._hammer.follow():
                self._tell(self._hammer.told())
            if self._now() - self._told_s >= PICTURE_S:
                self._told_s = self._now()
                self._tell_picture()

    # --- what is wished -------------------------------------------------------------------------------------

    def _heed(self, message: dict[str, Any]) -> None:
        what = message["do"]
        if what == "view":
            self._signals.view(
                int(message["averages"]), float(message["span_ms"]), bool(message["triggered"]), float(message["level"])
            )
        elif what == "reset":
            self._signals.spectrum.reset()
            self._heed_hammer(LiveHammer.reset)
        elif what == "drop":
            self._heed_hammer(LiveHammer.drop)
        elif what == "check":
            self._check.begin(str(message["side"]), self._signals)
        elif what == "tap":
            self._tap(0)
        elif what == "end":
            self._end()

    def _heed_hammer(self, change: Callable[[LiveHammer], None]) -> None:
        if self._hammer is not None:
            change(self._hammer)
            self._tell(self._hammer.told())

    def _end(self) -> None:
        """End without a move, which only a rig without load may."""
        threshold = self._config.rig.limits.contact_threshold_mn
        if abs(self._load_mn) < threshold:
            self._ended = True
        else:
            text = f"The gauge shows {self._load_mn:.0f} mN: take the surfaces apart, or press STOP, which does."
            self._tell({"kind": "said", "text": text})

    def _tap(self, side: int) -> None:
        """Have the simulated person tap the lower mass; a real one needs no telling."""
        tap = getattr(self._rig, "tap_lower_mass", None)
        if self._bench.simulated and tap is not None:
            tap(side)

    # --- what is told ---------------------------------------------------------------------------------------

    def _see_load(self, load_mn: float) -> None:
        self._load_mn = load_mn
        self._bench.gauge.load(load_mn)

    def _tell_picture(self) -> None:
        signals = self._signals
        trace, levels, spectrum = signals.trace(), signals.levels(), signals.spectrum
        points = np.zeros((2, 0)) if trace is None else trace.acceleration
        force = None if trace is None else trace.force
        density = spectrum.amplitude_density()
        quality, trigger = self._config.daq.quality, self._config.daq.trigger
        message = {
            "kind": "picture",
            "told_at": time.time(),
            "points": points.shape[1],
            "forces": 0 if force is None else 1,
            "hammer": None if self._hammer is None else self._hammer.level(),
            "first_ms": None if trace is None else trace.first_ms,
            "step_ms": None if trace is None else trace.step_ms,
            "bins": density.shape[1],
            "bin_hz": spectrum.sample_rate_hz / spectrum.segment_samples,
            "count": spectrum.count,
            "averages": spectrum.averages,
            "span_ms": signals.span_ms,
            "triggered": signals.triggered,
            "level": signals.level_m_s2,
            "levels": [
                {
                    "rms": level.rms_m_s2,
                    "peak": level.peak_m_s2,
                    "share": level.share,
                    "noise": level.noise_m_s2,
                    "overloaded": level.overloaded,
                }
                for level in levels
            ],
            "full_scale": self._rig.accelerometers.full_scale_m_s2,
            "largest_noise": quality.largest_noise_m_s2,
            "least_tap": quality.smallest_signal_to_noise * max(level.noise_m_s2 for level in levels),
            "threshold": trigger.threshold_m_s2,
            "lost": signals.lost,
            "check": self._check.outcome,
            "simulated": self._bench.simulated,
            "next": self._what_to_do(levels),
        }
        drawn = [points.ravel(), *([] if force is None else [force]), density.ravel()]
        self._tell(message, np.concatenate(drawn).astype("<f4").tobytes())

    def _what_to_do(self, levels: Any) -> str:
        """One sentence: what is dangerous first, then what is wrong, then the next step."""
        limits, quality, load = self._config.rig.limits, self._config.daq.quality, self._load_mn
        names = dict(zip("AB", levels, strict=True))
        if load > NEAR_LIMIT * limits.load_mn:
            return f"The load is about {10 * round(load / 10)} of {limits.load_mn:g} mN: turn no further."
        if load < -BELOW_ZERO * limits.contact_threshold_mn:
            shown = f"The gauge shows about {10 * round(load / 10)} mN"
            return f"{shown}: it was not free when the view began. Press STOP, then begin again."
        if over := [name for name, level in names.items() if level.overloaded]:
            return f"{' and '.join(over)} overloaded: tap more gently, or take a larger rig.wiring.input_range_v."
        if dead := [name for name, level in names.items() if level.noise_m_s2 == 0.0]:
            return f"{' and '.join(dead)} shows nothing at all: check sensor, cable and conditioner."
        if self._hammer is not None and self._hammer.level()["dead"]:
            return "The hammer's channel shows nothing at all: check its cable, its supply and rig.wiring.hammer.input."
        if self._check.state == QUIET:
            return "Keep off the rig for a second: the noise is measured."
        if self._check.state == WAITING:
            if self._bench.simulated:
                return "Nothing to do: the simulated rig taps itself."
            return f"Tap the lower mass once, from above, {self._check.where()}."
        if loud := [name for name, level in names.items() if level.noise_m_s2 > quality.largest_noise_m_s2]:
            noisy = f"{' and '.join(loud)} noisier than {quality.largest_noise_m_s2:g} m/s2"
            return f"{noisy}: wait until the bench is quiet, check cables and grounding."
        bad = [v for v in self._check.outcome["verdicts"] if v["passed"] is False]
        if bad:
            return f"Mend what the check found: {', '.join(v['name'] for v in bad)}. Then check again."
        if self._check.state == DONE:
            return "Wiring and noise are as a session needs them: end the view."
        return f"Quiet enough for a session. {TAP_FIRST}"

    # --- leaving --------------------------------------------------------------------------------------------

    def _leave_safely(self, error: BaseException) -> None:
        """Say at once what is wrong, take the surfaces apart, and say whether they are."""
        if not self._watched:
            error.add_note("nothing was moved")
            return
        if isinstance(error, MesotapError) and not isinstance(error, SessionAborted):
            self._tell({"kind": "alarm", "text": str(error)})
        safe = self._interlock.make_safe()
        error.add_note(safe.sentence().replace(f": {error}", ""))
        if not safe.troubles:
            self._bench.guardian.arm(False)

    def _let_go(self, error: BaseException | None) -> None:
        """Let go of all of it; what fails hides nothing that was said before."""
        if error is None:
            self._rig.accelerometers.stop()
            self._bench.guardian.arm(False)
        for end in (self._bench.guardian.dismiss, self._rig.close):
            try:
                end()
            except Exception as failure:
                if error is None:
                    raise
                error.add_note(str(failure))


def for_setting_up(config: Config) -> Config:
    """Return the configuration with which a simulated rig is looked at live."""
    if config.sim_backend.tube_damping_ratio > 0:
        return config
    simulated = config.sim_backend.model_copy(update={"tube_damping_ratio": SETUP_DAMPING})
    return config.model_copy(update={"sim_backend": simulated})
