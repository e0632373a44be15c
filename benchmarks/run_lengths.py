"""Average run lengths of the control charts, by simulation: false alarms, and how soon a change of k_c is told.

usage: run_lengths.py [--runs N] [--seed N]
"""

from __future__ import annotations

import argparse

import numpy as np

from analysis.control_charts import run_lengths

CHANGE_PERCENT = 0.5
SCATTERS_PERCENT = (0.1, 0.2, 0.25, 0.3, 0.4, 0.5)
HISTORIES = (10, 20, 50)
LONGEST_FALSE, LONGEST = 4000, 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    false = run_lengths(0.0, 0, given.runs, LONGEST_FALSE, given.seed)
    # cut runs: as many alarms in as many values as there were
    rate = np.sum(false <= LONGEST_FALSE) / np.sum(np.minimum(false, LONGEST_FALSE))
    error = 1 / np.sqrt(np.sum(false <= LONGEST_FALSE)) / rate
    print(
        f"no change: one false alarm in {1 / rate:.0f} +- {error:.0f} sessions (standard error), both charts together"
    )
    print(f"k_c changes by {CHANGE_PERCENT} %: mean sessions until told, and share told within 10")
    print("scatter % | " + " | ".join(f"after {h} sessions" for h in HISTORIES))
    for scatter in SCATTERS_PERCENT:
        cells = []
        for history in HISTORIES:
            found = run_lengths(CHANGE_PERCENT / scatter, history, given.runs // 2, LONGEST, given.seed)
            cells.append(f"{np.mean(found):6.1f}, {100 * np.mean(found <= 10):3.0f} %")
        print(f"{scatter:9.2f} | " + " | ".join(cells))


if __name__ == "__main__":
    main()
