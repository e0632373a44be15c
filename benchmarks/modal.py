"""How near is modal identification to what the data allow, and how fast, beside other programs?

Accuracy over the published range against the Cramer-Rao bound; the same through pulse and band-pass; bias where the
contact resonance scatters; time beside the peers; growth with the record's length; damping against amplitude of a
real beam. Prints the table of goals and writes docs/benchmarks/modal.md with its figure.

usage: modal.py [--quick] [--seed N] [--output FOLDER] [--json OUT.json] [--from IN.json]
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from modal_accuracy import of_free_decays, of_scatter, of_taps
from modal_data import published_range
from modal_peers import PEERS, version
from modal_report import figure, markdown, summary_table
from modal_speed import beside_the_peers, growth
from threadpoolctl import threadpool_limits

from analysis.modal.amplitude import along_the_decay
from analysis.modal.identify import identify_ring_down
from daq.exchange import import_recording

ROOT = Path(__file__).parents[1]
SCATTER = 0.005  # of f2 between impacts
WORKERS = 2


def _one_thread() -> None:
    threadpool_limits(1)


def accuracy(seed: int, quick: bool) -> dict[str, Any]:
    """Sections 1 to 3, each combination with a seed of its own."""
    draws, loads, lost = (8, 1, 4) if quick else (200, 50, 50)
    cases, faint = published_range(40.0, 60.0), published_range(20.0)
    with ProcessPoolExecutor(WORKERS, initializer=_one_thread) as pool:
        free = [pool.submit(of_free_decays, c, draws, [seed, 1, i]) for i, c in enumerate(cases)]
        low = [pool.submit(of_free_decays, c, lost, [seed, 20, i]) for i, c in enumerate(faint)]
        whole = [pool.submit(of_taps, c, loads, [seed, 2, i]) for i, c in enumerate(cases)]
        scattered = [pool.submit(of_scatter, c, draws, [seed, 3, i], SCATTER) for i, c in enumerate(cases)]
        futures = {"free": free, "faint": low, "taps": whole, "scatter": scattered}
        return {"draws": draws, "loads": loads, **{k: [f.result() for f in v] for k, v in futures.items()}}


def beam() -> list[dict[str, Any]] | None:
    """Damping of the bolted beam's first mode against each channel's own amplitude; None without the recording."""
    folder = Path(os.environ.get("MESOTAP_DATA") or ROOT / ".." / "shared" / "data")
    file = folder / "brake-reuss-beam" / "HammerImpact.mat"
    if not file.exists():
        return None
    recording = import_recording(file)
    found = identify_ring_down(recording.data, recording.rate_hz)
    poles = np.array([np.exp(m.pole / recording.rate_hz) for m in found.modes], np.complex128)
    decay = recording.data[:, found.start :] - recording.data.mean(axis=1, keepdims=True)
    first = int(np.argmin([abs(m.frequency_hz.value - 80.4) for m in found.modes]))
    return [
        {
            "channel": name,
            "points": [
                [p.amplitude, p.frequency_hz.value, p.damping_ratio.value, p.damping_ratio.standard_error]
                for p in along_the_decay(decay[c : c + 1], recording.rate_hz, poles, first)
            ],
        }
        for c, name in enumerate(recording.names)
    ]


def measured(seed: int, quick: bool) -> dict[str, Any]:
    """Everything, as plain numbers."""
    _one_thread()
    return {
        "seed": seed,
        "quick": quick,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "python": platform.python_version(),
        "versions": {
            p: version(p) for p in (*sorted({package for package, _ in PEERS.values()}), "numpy", "scipy", "numba")
        },
        "speed": beside_the_peers(seed, quick),
        "growth": growth(seed, quick),
        "beam": beam(),
        "accuracy": accuracy(seed, quick),
    }


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few draws; writes only where --output says")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, help="folder of modal.md and modal.svg; default docs/benchmarks")
    parser.add_argument("--json", type=Path, help="write the numbers")
    parser.add_argument("--from", dest="kept", type=Path, help="numbers of an earlier run instead of a new one")
    chosen = parser.parse_args()
    found = json.loads(chosen.kept.read_text()) if chosen.kept else measured(chosen.seed, chosen.quick)
    if chosen.json:
        chosen.json.write_text(json.dumps(found) + "\n")
    sys.stdout.write(summary_table(found) + "\n")
    folder = chosen.output or (None if found["quick"] else ROOT / "docs" / "benchmarks")
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "modal.md").write_text(markdown(found))
        figure(found, folder / "modal.svg")


if __name__ == "__main__":
    main()
