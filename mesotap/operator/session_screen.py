"""A session at the terminal, as it runs: the load, the taps of this load, what the last one came to, and the keys."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from daq.journal import SessionFolder
from daq.records import Impact
from mesotap.configuration.config import Config
from mesotap.operator.console import SessionLines
from mesotap.operator.tap_analysis import TapAnalysis
from mesotap.session.hand_verdicts import accepted_in
from mesotap.session.progress import describe_rig
from mesotap.session.states import State
from mesotap.session.watching import GaugeWatch
from rig.settings import RigSettings

LOOKS_PER_S = 8
LONGEST_SETTLING_S = 8.0
"""For which a session that is complete stays on this screen until its latest tap is analysed: more than the 3 s that
the analysis takes to begin beside a session in simulated time, over by then. On the bench it has long begun."""

SETTLING = "the surfaces are apart; working out the latest tap"
BAR, SHORTEST_BAR = 40, 8  # letters from no load to the limit; the screen may be narrow
BLOCKS = " ▁▂▃▄▅▆▇█"
BINS, FEWEST_BINS, LOWEST_HZ, HIGHEST_HZ, RANGE_DB = 56, 16, 100.0, 10_000.0, 60.0
"""Of the small spectrum: letters, the fewest of a narrow screen, ends of its logarithmic frequency axis, and what is
shown below its peak."""


class SessionScreen(SessionLines, GaugeWatch):
    """Six lines that are drawn anew several times a second; what the session prints scrolls above them.

    Parameters
    ----------
    console
        Terminal.
    keys
        Whether somebody can press keys there.
    """

    def __init__(self, console: Console, keys: bool) -> None:
        super().__init__(console)
        self._keys = keys
        self._words, self._text = "starting", ""
        self._load_mn: float | None = None
        self._plan: list[float] = []
        self._limit_mn = self._force_limit = 0.0
        self._load_set = self._accepted = self._wanted = self._done = 0
        self._last: Impact | None = None
        self._spectrum = self._hammer = ""
        self._rig = RigSettings()
        self._of_load: list[Impact] = []
        self._modes: dict[int, dict[str, Any]] = {}
        self._analysis: TapAnalysis | None = None

    @contextmanager
    def watching(self, folder: SessionFolder, config: Config) -> Iterator[SessionScreen]:
        """Show a session from its beginning, or from where it goes on."""
        self._plan = list(config.mesotap.load_plan_mn)
        self._limit_mn, self._force_limit = config.rig.limits.load_mn, config.daq.quality.largest_force_ratio
        self._rig = config.rig
        self._wanted, self._done = config.mesotap.taps_per_load, len(accepted_in(folder.events()))
        told = {name: folder.header.get(name) for name in ("config", "created", "simulated")}
        self._analysis = TapAnalysis(told, self._found)
        screen = Live(console=self._console, get_renderable=self.lines, refresh_per_second=LOOKS_PER_S, transient=True)
        screen.start()
        try:
            yield self
            self._words, self._text = SETTLING, ""
            self._analysis.settle(LONGEST_SETTLING_S)
        finally:
            with suppress(OSError):  # the terminal was closed: what ended the session says more
                screen.stop()
            self._analysis.end()
        if latest := self._latest_analysed():
            self._console.print(latest, highlight=False)

    # --- what the session tells -----------------------------------------------------------------------------

    def load(self, load_mn: float) -> None:
        """See the load."""
        self._load_mn = load_mn

    def aim(self, load_set: int, target_mn: float) -> None:
        """See which load is set."""
        self._load_set, self._accepted = load_set, 0
        self._of_load, self._hammer = [], ""

    def progress(self, state: State, text: str) -> None:
        """See where the session is."""
        self._words, self._text = state.value, text

    def impact(self, impact: Impact, accepted: int, wanted: int) -> None:
        """See a tap and its verdict."""
        self._last, self._accepted, self._wanted, self._load_set = impact, accepted, wanted, impact.load_set
        self._done += impact.accepted
        self._spectrum = sparkline(
            impact.acceleration.mean(axis=0)[impact.pretrigger :], impact.sample_rate_hz, self._console.width
        )
        if impact.force is not None:
            self._see_hammer(impact)
        if self._analysis is not None:
            self._analysis.tap(impact)
        super().impact(impact, accepted, wanted)

    def _see_hammer(self, impact: Impact) -> None:
        from analysis.frequency_response.so_far import hammer_so_far  # only where there is a hammer

        self._of_load = [*(i for i in self._of_load if i.load_set == impact.load_set), impact]
        taken = [i for i in self._of_load if i.accepted or i is impact]
        rig = self._rig
        self._hammer = hammer_so_far(taken, describe_rig(rig), rig.wiring.hammer).words

    def _found(self, number: int, modes: dict[str, Any]) -> None:
        self._modes[number] = modes

    # --- what is shown ----------------------------------------------------------------------------------------

    def lines(self) -> Group:
        """Return the lines as they are now."""
        hammer = [Text(self._hammer)] if self._hammer else []
        shown = (self._where(), self._loaded(), self._row(), self._tap(), Text(self._spectrum), *hammer)
        return Group(*shown, self._to_press())

    def _where(self) -> Text:
        return Text.assemble((self._words, "bold"), f"  {self._text}" if self._text != self._words else "")

    def _loaded(self) -> Text:
        target = self._plan[self._load_set] if self._load_set < len(self._plan) else 0.0
        load = "   –" if self._load_mn is None else f"{max(self._load_mn, 0.0) + 0.0:4.0f}"
        now, limits = f"{load} mN ", f" target {target:.0f}, limit {self._limit_mn:.0f} mN"
        letters = max(SHORTEST_BAR, min(BAR, self._console.width - len(now) - len(limits)))
        filled = round(letters * min(1.0, max(0.0, self._load_mn or 0.0) / (self._limit_mn or 1.0)))
        bar = "━" * filled + "·" * (letters - filled)
        at = min(letters - 1, round(letters * target / (self._limit_mn or 1.0)))
        bar = f"{bar[:at]}┃{bar[at + 1 :]}"
        return Text.assemble((now, "bold"), bar, limits)

    def _row(self) -> Text:
        boxes = "■" * min(self._accepted, self._wanted) + "□" * max(0, self._wanted - self._accepted)
        total = self._wanted * len(self._plan)
        load = f"load {self._load_set + 1} of {len(self._plan)}"
        return Text(f"{load}  {boxes} {self._accepted} of {self._wanted} good taps; {self._done} of {total} in all")

    def _tap(self) -> Text:
        tap = self._last
        if tap is None:
            return Text("no tap yet")
        verdict = ("✓ used", "green") if tap.accepted else ("✗ not used", "red")
        share = tap.extra.get("force_ratio")
        parts: list[Any] = [f"tap {tap.number} ", verdict]
        if isinstance(share, int | float):
            parts.append(f"  {100 * share:.0f} % of the force that lifts off (limit {100 * self._force_limit:.0f} %)")
        if latest := self._latest_analysed():
            parts.append("  " + latest.removeprefix(f"tap {tap.number}:  "))
        return Text.assemble(*parts)

    def _latest_analysed(self) -> str:
        """Return what the latest tap came to whose modes are known; nothing before there is one."""
        analysed = [number for number, modes in tuple(self._modes.items()) if modes.get("f2_hz")]
        if not analysed:
            return ""
        modes = self._modes[max(analysed)]
        f2, zeta2, k_c = (_value(modes.get(name)) for name in ("f2_hz", "zeta2", "k_c"))
        return f"tap {max(analysed)}:  f2 {f2:.1f} Hz  zeta2 {100 * zeta2:.3g} %  k_c {1e-6 * k_c:.4g} MN/m"

    def _to_press(self) -> Text:
        if self._words == SETTLING:
            return Text("Ctrl-C leaves out the report, which 'mesotap resume' writes", style="dim")
        keys = "p pause   q end, with the surfaces apart" if self._keys else "Ctrl-C ends it, with the surfaces apart"
        return Text(keys, style="dim")


def _value(estimate: Any) -> float:
    return (
        float(estimate["value"]) if isinstance(estimate, dict) and estimate.get("value") is not None else float("nan")
    )


def sparkline(y: NDArray[np.float64], rate_hz: float, width: int = 80) -> str:
    """Return the amplitude spectrum of a transient (n,) in a line of letters, dB below its peak, with its ends in Hz.

    On a screen of less than 70 letters there are fewer of them.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2500) / 25000
    >>> line = sparkline(np.exp(-50 * t) * np.sin(2 * np.pi * 1000 * t), 25000.0)
    >>> line.index("█") in (31, 32, 33, 34)
    True
    """
    amplitude = np.abs(np.fft.rfft(y))
    hz = np.fft.rfftfreq(y.size, 1 / rate_hz)
    ends = LOWEST_HZ, min(HIGHEST_HZ, rate_hz / 2)
    number = max(FEWEST_BINS, min(BINS, width - len(f"{ends[0]:.0f}  {ends[1]:.0f} Hz")))
    edges = np.geomspace(*ends, number + 1)
    bins = np.searchsorted(edges, hz) - 1
    peaks = np.array([amplitude[bins == i].max(initial=0.0) for i in range(number)])
    for i in np.flatnonzero(peaks == 0.0):  # narrower than the lines of the spectrum
        peaks[i] = np.interp(np.sqrt(edges[i] * edges[i + 1]), hz, amplitude)
    largest = peaks.max(initial=0.0)
    if not largest > 0.0:
        return ""
    with np.errstate(divide="ignore"):
        level = np.clip(1 + 20 * np.log10(peaks / largest) / RANGE_DB, 0.0, 1.0)
    letters = "".join(BLOCKS[int(np.ceil(one * (len(BLOCKS) - 1)))] for one in level)
    return f"{edges[0]:.0f} {letters} {edges[-1]:.0f} Hz"
