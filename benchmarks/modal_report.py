"""The table of goals, the page and the figure, from the numbers of `modal.py`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from modal_accuracy import QUANTITIES
from modal_speed import COMPARABLE, comparable, farthest

matplotlib.use("svg")
from matplotlib import pyplot as plt

F2, ZETA2 = 1, 3
CONTACT = (F2, ZETA2)
ALL = (0, 1, 2, 3)
FACTORS = (2.0, 3.0, 4.0, 5.0, 6.0)  # bounds within which a peer might be called comparable
COVERED = 0.92, 0.98
BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#777777"


def _rms(rows: list[dict[str, Any]]) -> Any:
    return np.array([row["rms"] for row in rows])


def _coverage(rows: list[dict[str, Any]]) -> tuple[float, float, float]:
    inside = np.array([row["inside"] for row in rows])
    return 100 * float(inside.mean()), 100 * float(inside.min()), 100 * float(inside.max())


def _tolerance(impacts: int) -> tuple[float, float]:
    """Binomial standard errors, %, of a coverage at the lower and at the upper end of what is asked for."""
    low, high = (100 * float(np.sqrt(p * (1 - p) / impacts)) for p in COVERED)
    return low, high


def _outside(rows: list[dict[str, Any]]) -> tuple[int, int]:
    """Coverages below and above what is asked for, without any tolerance."""
    inside = np.array([row["inside"] for row in rows])
    return int((inside < COVERED[0]).sum()), int((inside > COVERED[1]).sum())


def _named(case: list[float]) -> str:
    return f"f2 {case[1]:g} Hz, zeta2 {100 * case[2]:g} %, {case[3]:g} dB"


def _verdict(met: bool) -> str:
    return "met" if met else "**not met**"


def _ratio(
    found: dict[str, Any], quantities: tuple[int, ...], case: int | None, factor: float = COMPARABLE
) -> tuple[float | None, str]:
    """Time of the fastest comparable peer over mesotap's, and which it is."""
    best = comparable(found["speed"]["peers"], quantities, case, factor)
    if best is None:
        return None, "none"
    return _times(found, best, case), f"{best['peer']}, {best['setting']}"


def _times(found: dict[str, Any], row: dict[str, Any], case: int | None) -> float:
    """Time of a peer over mesotap's; of all cases their sum."""
    chosen = range(len(found["speed"]["cases"])) if case is None else (case,)
    return float(sum(row["ms"][c] for c in chosen) / sum(found["speed"]["mesotap"]["ms"][c] for c in chosen))


def _least_ratio(
    found: dict[str, Any], quantities: tuple[int, ...], factor: float = COMPARABLE
) -> tuple[float | None, str]:
    """Least of the ratios of the cases, each peer with its best setting in each case."""
    single = [(*_ratio(found, quantities, c, factor), _named(case)) for c, case in enumerate(found["speed"]["cases"])]
    ratio, peer, case = min((s for s in single if s[0] is not None), key=lambda s: s[0] or 0.0, default=(None, "", ""))
    return ratio, f"{peer}; {case}" if peer else "none"


def _nearest(found: dict[str, Any], case: int | None) -> str:
    """Which peer comes nearest to the bound in all four quantities, how near, and at what cost."""
    rows = [r for r in found["speed"]["peers"] if "failure" not in r]
    if not rows:
        return "no peer ran"
    best = min(rows, key=lambda row: farthest(row, ALL, case))
    return (
        f"nearest {best['peer']}, {best['setting']}: {farthest(best, ALL, case):.3g} bounds, "
        f"{_times(found, best, case):.3g} times as long"
    )


def goals(found: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """(what, goal, reached, verdict)."""
    a, speed, grown = found["accuracy"], found["speed"], found["growth"]
    free, taps = _rms(a["free"]), _rms(a["taps"])
    median, worst = float(np.median(free)), float(free.max())
    where = _named(a["free"][int(free.max(axis=1).argmax())]["case"])
    tap_median, tap_worst = float(np.median(taps)), float(taps.max())
    tap_where = _named(a["taps"][int(taps.max(axis=1).argmax())]["case"])
    bias = max(a["scatter"], key=lambda row: abs(row["bias"]))
    lost, impacts = sum(sum(r["lost"]) for r in a["faint"]), sum(r["impacts"] for r in a["faint"])
    own = max(speed["mesotap"]["ms"])
    mean, low, high = _coverage(a["free"])
    tap_mean, tap_low, tap_high = _coverage(a["taps"])
    tap_tolerance = _tolerance(a["taps"][0]["impacts"])
    below, above = _outside(a["taps"])
    least, least_peer = _least_ratio(found, ALL)
    ratio, peer = _ratio(found, ALL, None)
    partial, partial_peer = _least_ratio(found, CONTACT)
    return [
        ("free decays: rms error over bound, median", "<= 1.05", f"{median:.3f}", _verdict(median <= 1.05)),
        ("the same, worst combination", "<= 1.15", f"{worst:.3f} ({where})", _verdict(worst <= 1.15)),
        (
            "free decays: 95 % intervals that cover",
            "92 to 98 %",
            f"{mean:.1f} % (combinations {low:.1f} to {high:.1f} %)",
            _verdict(low >= 92 and high <= 98),
        ),
        ("modes lost at 20 dB", "0", f"{lost} of {2 * impacts}", _verdict(lost == 0)),
        (
            "band-pass and pulse: rms error over bound, worst",
            "<= 1.3",
            f"{tap_worst:.3f} ({tap_where}); median {tap_median:.2f}",
            _verdict(tap_worst <= 1.3),
        ),
        (
            "the same: 95 % intervals that cover",
            f"92 (- {tap_tolerance[0]:.1f}) to 98 (+ {tap_tolerance[1]:.1f}) %",
            f"{tap_mean:.1f} % (combinations {tap_low:.1f} to {tap_high:.1f} %; of {4 * len(a['taps'])} "
            f"{below} below 92 %, {above} above 98 %)",
            _verdict(tap_low >= 92 - tap_tolerance[0] and tap_high <= 98 + tap_tolerance[1]),
        ),
        (
            "bias of zeta2, f2 scattered by 0.5 %, worst",
            "< 0.1 %",
            f"{100 * bias['bias']:.3f} +- {100 * bias['bias_error']:.3f} % ({_named(bias['case'])})",
            _verdict(abs(bias["bias"]) < 1e-3),
        ),
        ("8 x 2 x 5000, slowest of three cases", "<= 1.5 ms", f"{own:.2f} ms", _verdict(own <= 1.5)),
        (
            f"fastest peer within {COMPARABLE:g} bounds in all four, least of three cases",
            ">= 30",
            f"none is ({_nearest(found, None)})" if least is None else f"{least:.0f} ({least_peer})",
            "met: none" if least is None else _verdict(least >= 30),
        ),
        (
            "the same, one setting for all cases",
            ">= 30",
            f"none is ({_nearest(found, None)})" if ratio is None else f"{ratio:.0f} ({peer})",
            "met: none" if ratio is None else _verdict(ratio >= 30),
        ),
        (
            f"within {COMPARABLE:g} bounds in f2 and zeta2 alone, least of three cases",
            "(told, no goal)",
            "none is" if partial is None else f"{partial:.1f} ({partial_peer})",
            "-",
        ),
        (
            "growth of time with length",
            "at most linear",
            f"n^{grown['time_exponent']:.2f}; last decade n^{grown['last_time_exponent']:.2f}",
            _verdict(grown["last_time_exponent"] <= 1.05),
        ),
        (
            "growth of peak memory with length",
            "at most linear",
            f"n^{grown['memory_exponent']:.2f}; last decade n^{grown['last_memory_exponent']:.2f}",
            _verdict(grown["last_memory_exponent"] <= 1.05),
        ),
    ]


def summary_table(found: dict[str, Any]) -> str:
    """The goals for a terminal."""
    rows = [("what", "goal", "reached", "")] + [(*r[:3], r[3].strip("*")) for r in goals(found)]
    return "\n".join(f"{a:64s} {b:15s} {d:8s} {c}" for a, b, c, d in rows)


def _table(heading: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [heading, tuple("---" for _ in heading), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _accuracy_rows(found: dict[str, Any], key: str) -> list[tuple[str, ...]]:
    """One row per specimen, damping and signal-to-noise ratio: the worst over f2."""
    groups: dict[tuple[float, ...], list[dict[str, Any]]] = {}
    for row in found["accuracy"][key]:
        f1, _, zeta, snr = row["case"]
        groups.setdefault((f1, zeta, snr), []).append(row)
    answer: list[tuple[str, ...]] = []
    for (f1, zeta, snr), rows in groups.items():
        worst = _rms(rows).max(axis=0)
        mean, low, high = _coverage(rows)
        name = "flat" if f1 > 300 else "sphere"
        answer.append(
            (
                name,
                f"{100 * zeta:g}",
                f"{snr:g}",
                *(f"{w:.2f}" for w in worst),
                f"{mean:.1f} ({low:.1f} to {high:.1f})",
                str(sum(sum(r["lost"]) for r in rows)),
            )
        )
    return answer


def _peer_rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    speed = found["speed"]
    own = speed["mesotap"]

    def cell(row: dict[str, Any], c: int) -> str:
        error = row["rms"][c]
        times = row["ms"][c] / own["ms"][c]
        return f"{times:.3g}; {error[F2]:.3g}, {error[ZETA2]:.3g}; {max(error[0], error[2]):.3g}"

    cases = range(len(speed["cases"]))
    rows: list[tuple[str, ...]] = [("**mesotap**", "", *(cell(own, c) for c in cases))]
    for row in speed["peers"]:
        cells = [row["failure"], *["" for _ in cases][1:]] if "failure" in row else [cell(row, c) for c in cases]
        rows.append((row["peer"], row["setting"], *cells))
    return rows


def _ratio_rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for what, quantities in (("f1, f2, zeta1, zeta2", ALL), ("f2, zeta2", CONTACT)):
        for case in (*range(len(found["speed"]["cases"])), None):
            name = "one setting for all cases" if case is None else _named(found["speed"]["cases"][case])
            ratio, peer = _ratio(found, quantities, case)
            if ratio is None and quantities == ALL:
                peer = f"none; {_nearest(found, case)}"
            rows.append((what, name, "-" if ratio is None else f"{ratio:.3g}", peer))
    return rows


def _factor_rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """What the ratio would be, had another accuracy been called comparable."""
    rows: list[tuple[str, ...]] = []
    for factor in FACTORS:
        cells: list[str] = []
        for quantities in (ALL, CONTACT):
            ratio, peer = _least_ratio(found, quantities, factor)
            cells.append("none" if ratio is None else f"{ratio:.3g} ({peer})")
        rows.append((f"{factor:g}", *cells))
    return rows


def _scatter_text(found: dict[str, Any]) -> str:
    rows = found["accuracy"]["scatter"]
    averages: dict[float, list[float]] = {}
    for row in rows:
        if row["bias_of_average"] is not None:
            averages.setdefault(row["case"][2], []).append(row["bias_of_average"])
    told = ", ".join(f"{100 * np.mean(v):+.2g} % at {100 * z:g} %" for z, v in sorted(averages.items()))
    beyond = [r for r in rows if abs(r["bias"]) > 3 * r["bias_error"]]
    return (
        f"Largest bias of zeta2 over {len(rows)} combinations: "
        f"{100 * max(abs(r['bias']) for r in rows):.3f} %; biases beyond three of their "
        f"standard errors: {len(beyond)} (these are at most {100 * max(r['bias_error'] for r in rows):.3f} %). "
        f"Averaging the eight records first and fitting the average reads zeta2 wrong by "
        f"(mean over f2 and noise) {told}."
    )


def _beam_text(found: dict[str, Any]) -> str:
    if found["beam"] is None:
        return "The recording was not at hand in this run."
    rows = []
    for channel in found["beam"]:
        for amplitude, f, zeta, error in channel["points"]:
            rows.append((channel["channel"], f"{amplitude:.3g}", f"{f:.2f}", f"{100 * zeta:.4f} +- {196 * error:.4f}"))
    return _table(("channel", "amplitude, m/s2", "frequency, Hz", "damping ratio, %"), rows)


def markdown(found: dict[str, Any]) -> str:
    """The page docs/benchmarks/modal.md."""
    a, speed, grown = found["accuracy"], found["speed"], found["growth"]
    accuracy_heading = ("specimen", "zeta2, %", "dB", *QUANTITIES, "covered, %", "lost")
    versions = ", ".join(f"{k} {v}" for k, v in found["versions"].items())
    lengths = [
        (f"{n}", f"{t / grown['ms'][0]:.2f}", f"{m:.2f}")
        for n, t, m in zip(grown["samples"], grown["ms"], grown["mb"], strict=True)
    ]
    quick = " A short run: few draws." if found["quick"] else ""
    return f"""# Modal identification: accuracy and speed

What a session runs for the taps of a load, pulse, filter and ERA included, takes 12 to 13 ms of processor time for
eight taps, where the goal is 15; no other program that gets the same taps comes within three bounds of all four
quantities: [session-speed.md](session-speed.md). Below `identify_free_decays`, which fits free decays in white noise
and which no command calls, beside the same programs.

Written by `benchmarks/modal.py` (`make bench`; `make bench BENCH_ARGS=--quick` for a short run that writes nothing).
{found["date"]}, seed {found["seed"]}, Python {found["python"]}; {versions}.{quick}
One run on one machine, one thread; times in ms belong to that machine, ratios of times carry further, though a
shared machine moves them by about 30 %.{found.get("note", "")}

{_table(("what", "goal", "reached", ""), goals(found))}

![Accuracy, speed, growth and a real beam](modal.svg)

The bound is the Cramer-Rao bound of `benchmarks/cramer_rao.py`, computed from the true poles and amplitudes with an
explicit design matrix; it shares no code with the identification. Each error is divided by the bound of its own
impact. "dB" is the peak of a record over the standard deviation of its white noise. Worst values are the largest of
{4 * len(a["free"])} root-mean-square ratios, so that chance alone takes them above 1: with N impacts a ratio
scatters by 1 / sqrt(2 N), {100 / np.sqrt(2 * a["free"][0]["impacts"]):.1f} % for free decays and
{100 / np.sqrt(2 * a["taps"][0]["impacts"]):.1f} % for taps, and the largest of so many lies some 2.7 of these above
its mean.

## 1. Free decays

`identify_free_decays`, {a["draws"]} draws of 8 impacts x 2 channels x 5000 samples at 25 kHz in each combination; zeta1
uniform in 0.1 to 0.5 %, random phases, both modes of like amplitude at the first sample. Root-mean-square error over
the bound, the worst of three f2; "lost" are modes with no answer or one off by more than six bounds.

{_table(accuracy_heading, _accuracy_rows(found, "free"))}

At 20 dB, {a["faint"][0]["impacts"] // 8} draws each (a lost mode dominates its root mean square):

{_table(accuracy_heading, _accuracy_rows(found, "faint"))}

## 2. Whole taps: pre-trigger, pulse and band-pass

`identify_impacts` on the exact response of Eq. 9 to a half-sine of 0.3 ms through the declared band-pass (first-order
10 Hz, fourth-order 10 kHz Butterworth), {a["loads"]} loads of 8 impacts in each combination. The bound is that of the
unfiltered free decay from the first sample after the pulse, so that what the filter and the search for the
pulse's end cost counts against the result. With {a["taps"][0]["impacts"]} impacts in a combination the share of
intervals that cover scatters by {100 * np.sqrt(0.05 * 0.95 / a["taps"][0]["impacts"]):.1f} % by chance, were each
right 95 times in 100; the smallest of {4 * len(a["taps"])} such shares then lies some 2.7 of these below 95 %. The
tolerance in the table of goals is the binomial standard error of a share of 92 or of 98 %.

{_table(accuracy_heading, _accuracy_rows(found, "taps"))}

## 3. Scatter of f2 between impacts

f2 scattered by 0.5 % from impact to impact. {_scatter_text(found)}

## 4. Speed, beside other programs

All eight impacts fitted separately. In each cell: time over mesotap's; error over bound of f2, of zeta2; the larger
of f1 and zeta1. Mesotap gets both channels and takes
{", ".join(f"{t:.2f}" for t in speed["mesotap"]["ms"])} ms (median of many calls, warm); the peers get the mean of the
channels, which loses nothing and is faster, one impact at a time, times eight. Of a peer's poles the nearest to the
true ones count. All programs had the same {8 * speed["draws"]} impacts in each case, so that an error ratio is
uncertain by about {100 / np.sqrt(16 * speed["draws"]):.0f} % and one near {COMPARABLE:g} falls on either side by
chance. Every Hankel matrix or order that is listed was tried; a short one misses a slow decay, a long one costs time.

{_table(("program", "setting", *(_named(c) for c in speed["cases"])), _peer_rows(found))}

In each case every peer has its best setting. A peer is called of comparable accuracy if its root-mean-square error
is within {COMPARABLE:g} bounds in all four quantities that accuracy is asked of: an error of three bounds takes nine
times as many taps to average down. f1 and zeta1 belong to them: the springs, and with them k_c, are measured through
f1, the tubes' damping through zeta1 (decision 5). The fastest such peer, its time over mesotap's; below it, for
information, f2 and zeta2 alone:

{_table(("within the bounds in", "case", "ratio", "peer"), _ratio_rows(found))}

How much depends on that number: the least ratio over the cases, each peer with its best setting in each case.

{_table(("bounds", "f1, f2, zeta1, zeta2", "f2, zeta2 alone"), _factor_rows(found))}

A best setting in each case supposes that one knows the damping before choosing it. Mesotap has one setting for all, and
gives uncertainties in that time; of the peers only pyOMA2 gives any, and its were not asked for here.

## 5. Growth with the length of the record

One impact, two channels, 1925 Hz at 2 %. Time relative to the shortest; memory is the largest allocation at once
beyond the record itself.

{_table(("samples", "time", "peak memory, MB"), lengths)}

## 6. A real beam: damping against amplitude

Mode 1 of the bolted Brake-Reuss beam (`brake-reuss-beam/HammerImpact.mat` of ../shared/data or $MESOTAP_DATA; W. Chen
et al., Mechanical Systems and Signal Processing 166, 108401 (2022)), each channel against its own amplitude. Read
elsewhere from this recording: 80.4 Hz, damping 0.24 % at 16 m/s2 falling to 0.14 % at 1 m/s2. The intervals are those
of white noise.

{_beam_text(found)}
"""


def figure(found: dict[str, Any], path: Path) -> None:
    """Four panels."""
    plt.rcParams.update(
        {"font.size": 8, "svg.hashsalt": "mesotap", "axes.spines.top": False, "axes.spines.right": False}
    )
    picture, ((errors, peers), (grown, beam)) = plt.subplots(2, 2, figsize=(9, 6.6), layout="constrained")
    for key, label, colour, marker, shift in (
        ("free", "free decays", BLUE, "o", 0.95),
        ("taps", "taps, band-pass", ORANGE, "s", 1.05),
    ):
        rows = found["accuracy"][key]
        for q, fill in ((F2, colour), (ZETA2, "none")):
            errors.scatter(
                [100 * r["case"][2] * shift for r in rows],
                [r["rms"][q] for r in rows],
                s=14,
                marker=marker,
                facecolors=fill,
                edgecolors=colour,
                linewidths=0.8,
                label=f"{label}: {'f2' if q == F2 else 'zeta2'}",
            )
    errors.axhline(1.0, color=GREY, lw=0.8)
    errors.set(xscale="log", xlabel="zeta2, %", ylabel="rms error / Cramer-Rao bound", title="Accuracy, 40 and 60 dB")
    errors.set_xticks([0.16, 0.5, 2, 8, 17], ["0.16", "0.5", "2", "8", "17"], minor=False)
    errors.minorticks_off()
    errors.set_ylim(bottom=0)
    errors.legend(frameon=False)
    speed = found["speed"]
    for i, name in enumerate(dict.fromkeys(r["peer"] for r in speed["peers"])):
        rows = [r for r in speed["peers"] if r["peer"] == name and "failure" not in r]
        x = [float(np.mean(r["ms"])) for r in rows]
        y = [farthest(r, ALL, None) for r in rows]
        peers.plot(x, y, "o-", ms=4, lw=0.8, color=f"C{i}", label=name)
    own = speed["mesotap"]
    peers.plot(np.mean(own["ms"]), max(r[q] for r in own["rms"] for q in ALL), "k*", ms=11, label="mesotap")
    peers.axhline(COMPARABLE, color=GREY, lw=0.8, ls="--")
    peers.text(0.02, COMPARABLE * 1.05, "comparable", color=GREY, transform=peers.get_yaxis_transform())
    peers.set(
        xscale="log",
        yscale="log",
        xlabel="time for 8 x 2 x 5000, ms",
        ylabel="rms error / bound, worst of f1, f2, zeta1, zeta2",
        title="Beside other programs, worst of three cases",
    )
    peers.set_ylim(0.7, 2000)  # room for the legend
    peers.legend(frameon=False, fontsize=7, ncols=2, loc="upper right")
    g = found["growth"]
    grown.loglog(g["samples"], g["ms"], "o-", color=BLUE, label=f"time, ms: n^{g['time_exponent']:.2f}")
    grown.loglog(g["samples"], g["mb"], "s-", color=ORANGE, label=f"peak memory, MB: n^{g['memory_exponent']:.2f}")
    n = np.array(g["samples"], float)
    grown.loglog(n, g["ms"][-1] * n / n[-1], color=GREY, lw=0.8, ls="--", label="linear")
    grown.set(xlabel="samples, one impact in two channels", title="Growth with the record's length")
    grown.legend(frameon=False)
    if found["beam"] is None:
        beam.text(0.5, 0.5, "recording not at hand", ha="center", transform=beam.transAxes)
    else:
        for channel, colour, marker in zip(found["beam"], (BLUE, ORANGE, GREEN), "os^", strict=False):
            points = np.array(channel["points"])
            beam.errorbar(
                points[:, 0],
                100 * points[:, 2],
                196 * points[:, 3],
                fmt=marker + "-",
                ms=4,
                lw=0.8,
                color=colour,
                label=channel["channel"],
            )
        beam.legend(frameon=False)
    beam.set(xscale="log", xlabel="amplitude, m/s2", ylabel="damping ratio, %", title="Brake-Reuss beam, mode 1")
    picture.savefig(path, metadata={"Date": None})
    plt.close(picture)
