"""`mesotap trend`: which sessions count, what is told, and the figure."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from mesotap.catalogue.store import Catalogue
from mesotap.catalogue.trends import CHECK, alarm_sentence, in_order, stiffness_at, trends
from tests.mesotap.catalogue.lab import entry, kept, load
from tests.mesotap.test_cli import mesotap, refused


def sessions(change: float = 0.0):
    """Thirty sessions of a check specimen, whose k_c changes at the twentieth; the gauge stays."""
    noise = np.random.default_rng(1)
    found = []
    for i in range(30):
        k_c = 8e6 * (1 + 0.002 * noise.standard_normal() + (change if i >= 20 else 0.0))
        loads = (load(0, 400.0, 0.8 * k_c), load(1, 600.0, k_c))
        slope = 0.042 * (1 + 1e-3 * noise.standard_normal())
        more = {"created": f"2026-03-{i + 1:02d}T08:00:00Z", "specimen": "check block", "slope_mv_per_mn": slope}
        found.append(entry(f"s{i:02d}", *loads, **more))
    return found


def test_a_change_of_k_c_is_told_and_nothing_else():
    made, said = trends(sessions(0.01), 500.0)
    told = {t.quantity: t for t in made}
    (alarm,) = told[CHECK].chart.alarms
    assert abs(alarm.since - 20) <= 1
    assert alarm.upwards
    assert told["gauge slope"].chart.alarms == ()
    assert any(note.startswith("f1: had by 0 sessions") for note in said)


def test_an_alarm_without_a_size_says_why():
    found = sessions()[:20]
    last = replace(found[-1], loads=(load(0, 400.0, 0.8 * 9e6), load(1, 600.0, 9e6)))
    made, _ = trends([*found[:-1], last], 500.0)
    (chart,) = (t for t in made if t.quantity == CHECK)
    (alarm,) = chart.chart.alarms
    assert alarm.change is None
    said = alarm_sentence(chart, 0)
    assert said.endswith("by how much cannot be said: it shows in one session so far, and an interval needs two")


def test_k_c_is_read_off_between_the_loads_and_not_far_from_them():
    one = entry("a", load(0, 400.0, 4e6), load(1, 900.0, 9e6))
    assert stiffness_at(one, 600.0) == pytest.approx(6e6)
    assert stiffness_at(one, 400.0) == pytest.approx(4e6)
    assert stiffness_at(one, 300.0) is None
    assert stiffness_at(entry("b"), 600.0) is None
    assert stiffness_at(entry("c", load(0, 500.0, 5e6)), 500.0) == pytest.approx(5e6)


def test_copies_and_what_cannot_be_read_or_dated_does_not_count():
    first = sessions()[0]
    others = [
        replace(first, path="/other/place"),
        entry("torn", state="damaged"),
        replace(first, path="/x", created=""),
    ]
    assert [e.path for e in in_order([first, *others])] == ["/lab/s00"]


def test_of_two_copies_the_one_with_results_counts():
    first = sessions()[0]
    assert in_order([replace(first, path="/a", loads=()), first]) == [first]


def test_a_declared_quantity_is_no_chart():
    made, said = trends([replace(e, k1_n_per_m=538e3) for e in sessions()], None)
    assert "k1" not in {t.quantity for t in made}
    assert any("declared, not measured" in note for note in said)


def test_the_command_writes_text_json_and_figure(tmp_path):
    with Catalogue(tmp_path / "i.sqlite") as catalogue:
        catalogue.put(kept(*sessions(0.01)))
    arguments = ["trend", "--index", tmp_path / "i.sqlite", "--specimen", "check", "--figure", tmp_path / "t.png"]
    done = mesotap(*arguments, "--json", tmp_path / "t.json")
    answer = json.loads((tmp_path / "t.json").read_text())
    charted = {c["quantity"]: c for c in answer["charts"]}
    assert charted[CHECK]["alarms"][0]["direction"] == "up"
    assert charted[CHECK]["alarms"][0]["statement"] in " ".join(done.stdout.split())
    assert len(charted[CHECK]["points"]) == 30
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
    assert "is not a load" in refused("trend", "--index", tmp_path / "i.sqlite", "--at", -math.inf)
