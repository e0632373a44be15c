"""The command line as a person and a program use it: what is answered, and one sentence for whatever is wrong."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import jsonschema
import numpy as np
import pytest
import scipy.io
from rich.console import Console

from tests.mesotap.benches import SMALL
from tests.mesotap.forked_command import run_forked
from tests.mesotap.interruptible import interruptible

CONTRACTS = Path(__file__).parents[1] / "contracts"
COMMANDS = ["run", "resume", "calibrate", "analyze", "report", "simulate", "published", "surface", "figures"]
COMMANDS += ["import", "export", "config", "info", "devices", "check", "diagnose", "mechanisms"]
QUICK = [part for change in SMALL for part in ("--set", change)]


def mesotap(*arguments, cwd=None, code=0):
    done = run_forked([*map(str, arguments)], cwd)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def started_anew(*arguments, cwd=None, code=0):
    """The same in a new process."""
    done = subprocess.run(
        [sys.executable, "-m", "mesotap", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "COLUMNS": "200"},
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def refused(*arguments, cwd=None) -> str:
    """Return the one sentence on standard error of a command that ends with code 2."""
    done = mesotap(*arguments, cwd=cwd, code=2)
    assert "Traceback" not in done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("mesotap: ")
    return lines[0]


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "session"
    mesotap("run", "--simulate", "--seed", 4, "-o", folder, "--json", folder.parent / "run.json", *QUICK)
    return folder


def test_help_names_every_command():
    text = started_anew("--help").stdout
    for command in COMMANDS:
        assert command in text
        said = mesotap(command, "--help").stdout
        assert "Usage" in said
        assert "--json" in said or command == "config", command  # an answer for programs
    assert started_anew("--version").stdout.startswith("mesotap ")


@pytest.mark.slow
def test_a_new_process_answers_as_a_fork_of_the_tests(session, tmp_path):
    """What the other tests run in a fork, which is a tenth of the time: one answer, one refusal, one wrong option."""
    for arguments, code in (
        (["published"], 0),
        (["analyze", str(session / "session.h5"), "--json", "-"], 0),
        (["analyze", "absent.h5"], 2),
        (["analyze", "absent.h5", "--wrong"], 2),
    ):
        new, forked = (run(*arguments, cwd=tmp_path, code=code) for run in (started_anew, mesotap))
        assert (forked.stdout, forked.stderr) == (new.stdout, new.stderr)


def test_a_run_leaves_all_it_should(session):
    for name in ("session.h5", "report.html", "results.json", "results.csv", "impacts.csv", "journal.jsonl"):
        assert (session / name).stat().st_size > 0
    assert json.loads((session.parent / "run.json").read_text()) == json.loads((session / "results.json").read_text())


@pytest.mark.long
def test_a_run_is_diagnosed_where_its_configuration_says_so(tmp_path):
    mesotap("run", "--simulate", "-o", tmp_path / "s", *QUICK, "--set", "mesotap.diagnose=true", cwd=tmp_path)
    answer = json.loads((tmp_path / "s" / "diagnosis.json").read_text())
    assert answer["recordings"][0]["file"] == "session.h5"
    assert (tmp_path / "s" / "diagnosis.html").stat().st_size > 0


@pytest.mark.parametrize("method", ["ml", "era"])
def test_analyze_answers_by_its_contract(session, tmp_path, method):
    out = tmp_path / "out.json"
    mesotap("analyze", session / "session.h5", "--method", method, "--json", out)
    answer = json.loads(out.read_text())
    jsonschema.validate(answer, json.loads((CONTRACTS / "results.schema.json").read_text()))
    assert answer["method"] == method
    assert [load["impacts_used"] for load in answer["loads"]] == [2, 2]
    assert answer["calibration"]["sensitivity_mv_per_mn"]["value"] == pytest.approx(0.042, rel=0.08)
    for load in answer["loads"]:
        for key in ("f1_hz", "f2_hz", "zeta2", "contact_stiffness_n_per_m", "contact_damping_n_s_per_m", "load_mn"):
            assert load[key]["low"] < load[key]["value"] < load[key]["high"]


def test_several_files_give_a_list(session, tmp_path):
    out = tmp_path / "out.json"
    file = session / "session.h5"
    mesotap("analyze", file, file, "--json", out)
    assert len(json.loads(out.read_text())) == 2


@pytest.mark.slow
def test_resume_of_a_finished_session_answers_again(session):
    before = (session / "session.h5").read_bytes()
    mesotap("resume", session)
    with h5py.File(session / "session.h5") as file:
        assert file.attrs["complete"]
    assert len((session / "session.h5").read_bytes()) == len(before)


@pytest.mark.slow
def test_report_of_a_folder_and_of_a_file(session, tmp_path):
    mesotap("report", session, "-o", tmp_path / "a")
    mesotap("report", session / "session.h5", "-o", tmp_path / "b")
    for folder in "ab":
        assert (tmp_path / folder / "report.html").exists()


def test_published_by_its_contract(tmp_path):
    out = tmp_path / "p.json"
    text = mesotap("published", "--json", out).stdout
    answer = json.loads(out.read_text())
    assert answer["format"] == "mesotap-published"
    assert answer["version"] == 1
    flat, sphere = answer["tables"]
    assert (flat["table"], sphere["table"]) == (5, 3)
    assert flat["k1_n_per_m"] == pytest.approx(0.538e6, rel=1e-3)
    assert sphere["k1_n_per_m"] == pytest.approx(0.335e6, rel=1e-3)
    measured = [round(k * 1e-6, 2) for k in flat["contact_stiffness_n_per_m"]]
    assert measured == [3.95, 5.87, 7.03, 7.59, 8.04, 8.90, 9.50, 10.32]
    measured = [round(k * 1e-6, 3) for k in sphere["contact_stiffness_n_per_m"]]
    assert measured == [0.591, 0.680, 0.920, 0.973, 1.232, 1.380, 1.544, 1.768]
    assert len(answer["conflicts"]) >= 5
    assert answer["conflicts"][0][:40] in text.replace("\n", " ")


def test_simulate_and_info(tmp_path):
    file = tmp_path / "one.h5"
    mesotap("simulate", file, "--load", 500, "--seed", 2, "--json", tmp_path / "truth.json")
    truth = json.loads((tmp_path / "truth.json").read_text())["truth"]
    mesotap("analyze", file, "--json", tmp_path / "a.json")
    load = json.loads((tmp_path / "a.json").read_text())["loads"][0]
    assert load["f2_hz"]["value"] == pytest.approx(truth["f2_hz"], rel=2e-3)
    mesotap("info", file, "--json", tmp_path / "i.json")
    info = json.loads((tmp_path / "i.json").read_text())
    assert info["impacts"] == 1


def test_calibrate(tmp_path):
    text = mesotap("calibrate", "--simulate", "--json", tmp_path / "c.json").stdout
    assert "mV/mN" in text
    answer = json.loads((tmp_path / "c.json").read_text())
    assert answer["sensitivity_mv_per_mn"]["low"] < answer["sensitivity_mv_per_mn"]["high"]
    assert len(answer["load_mn"]) == 14


def test_config_init_check_show(tmp_path):
    mesotap("config", "init", cwd=tmp_path)
    checked = mesotap("config", "check", cwd=tmp_path).stdout
    assert "config.yaml: valid" in checked
    assert "mN can be set to +-2.8 mN (a step of 0.02 um is up to 5.54 mN)" in checked
    assert "m1_kg: 0.107" in mesotap("config", "show", cwd=tmp_path).stdout
    assert "left as it is" in refused("config", "init", cwd=tmp_path)


def decay(path, columns=2, rate=5000.0, spoil=None):
    t = np.arange(4000) / rate
    data = [t] + [
        (0.5 + c) * np.exp(-8 * t) * np.sin(2 * np.pi * 120 * t) + np.exp(-20 * t) * np.sin(2 * np.pi * 700 * t + c)
        for c in range(columns)
    ]
    table = np.stack(data, axis=1)
    if spoil is not None:
        spoil(table)
    header = "time," + ",".join(f"acc{c + 1}" for c in range(columns))
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    return path


def test_import_and_analyze_a_csv(tmp_path):
    file = decay(tmp_path / "r.csv")
    mesotap("import", file, tmp_path / "r.h5")
    mesotap("analyze", tmp_path / "r.h5", "--report", tmp_path / "page", "--json", tmp_path / "m.json")
    answer = json.loads((tmp_path / "m.json").read_text())
    assert answer["format"] == "mesotap-modes"
    f = [m["frequency_hz"]["value"] for m in answer["modes"]]
    assert f == pytest.approx([np.hypot(120, 8 / 2 / np.pi), np.hypot(700, 20 / 2 / np.pi)], rel=1e-4)
    assert (tmp_path / "page" / "report.html").exists()


def spoiled_nan(table):
    table[1234, 2] = np.nan


def test_what_is_wrong_with_a_recording(tmp_path):
    assert "NaN" in refused("import", decay(tmp_path / "n.csv", spoil=spoiled_nan))
    one = refused("import", decay(tmp_path / "one.csv", columns=1))
    assert "one.csv" in one
    assert "channel" in one
    good = decay(tmp_path / "good.csv")
    missing = refused("import", good, "--channel", "acc1", "--channel", "acc7")
    assert "acc7" in missing
    assert "acc1" in missing
    assert "rate" in refused("import", good, "--rate", "25000")
    mesotap("import", good)
    whole = (tmp_path / "good.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[: len(whole) // 2])
    assert "cut.h5" in refused("analyze", tmp_path / "cut.h5")
    scipy.io.savemat(tmp_path / "m.mat", {"time": np.arange(500) / 1e3, "a": np.ones(500), "b": np.ones(500)})
    (tmp_path / "short.mat").write_bytes((tmp_path / "m.mat").read_bytes()[:3000])
    assert "short.mat" in refused("import", tmp_path / "short.mat")
    (tmp_path / "letter.csv").write_text("Dear reader,\nthis is not a recording at all.\nYours\n")
    assert "letter.csv" in refused("import", tmp_path / "letter.csv")
    (tmp_path / "picture.mat").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20)
    assert "picture.mat" in refused("import", tmp_path / "picture.mat")


def test_import_says_what_it_takes_for_granted(tmp_path):
    said = mesotap("import", decay(tmp_path / "a.csv"), tmp_path / "a.h5").stdout
    assert "no known unit of acc1 and acc2: the numbers are taken as m/s2" in said
    file = decay(tmp_path / "b.csv")
    file.write_text(file.read_text().replace("acc1,acc2", "acc1 [mg],acc2 [m/s2]"))
    assert "unit" not in mesotap("import", file, tmp_path / "b.h5").stdout
    file.write_text(file.read_text().replace("[m/s2]", "[V]"))
    assert "channel acc2 is in V" in refused("import", file, tmp_path / "c.h5")


def test_what_is_left_out_of_a_recording_is_told(tmp_path):
    file, ones = tmp_path / "m.mat", np.ones(500)
    scipy.io.savemat(file, {"fs": 1e3, "a": ones + 0j, "b": ones, "c": 2 * ones})
    assert "left out: a (complex)" in mesotap("info", file).stdout
    assert "name A and B with --channel" in refused("import", file)
    assert "left out: a (complex)" in mesotap("import", file, "--channel", "b", "--channel", "c").stdout


def with_changes(session, path, change):
    path.write_bytes((session / "session.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put_nan(file):
    file["impacts/00001/acceleration"][0, 7] = np.nan


def cut_short(file):
    values = file["impacts/00001/acceleration"][:, :100]
    del file["impacts/00001/acceleration"]
    file["impacts/00001/acceleration"] = values
    file["impacts/00001/acceleration"].attrs["units"] = "m/s2"


def put_pretrigger(file):
    file["impacts/00001"].attrs["pretrigger"] = 10**6


@pytest.mark.parametrize(
    ("change", "said"),
    [(put_nan, "holds a NaN"), (cut_short, "has shape"), (put_pretrigger, "pretrigger 1000000 lies outside")],
)
def test_a_bad_record_of_a_session_file_is_named_and_left_out(session, tmp_path, change, said):
    path = with_changes(session, tmp_path / "s.h5", change)
    done = mesotap("info", path)
    (line,) = [line for line in done.stdout.splitlines() if "left out" in line]
    assert line.startswith(f"- {path}: /impacts/00001")
    assert said in line


@pytest.mark.slow
def test_each_command_says_once_which_record_it_left_out(session, tmp_path):
    path = with_changes(session, tmp_path / "s.h5", put_nan)
    whole = len(h5py.File(path)["impacts"])
    sentence = "/impacts/00001/acceleration holds a NaN at channel A, sample 7; this record is left out"
    answer, page, csv, other = (tmp_path / name for name in ("a.json", "page", "s.csv", "other.h5"))
    commands = [
        ("analyze", path, "--json", answer),
        ("report", path, "-o", page),
        ("export", path, csv),
        ("hits", path, "--best", "1", "-o", other),
        ("catalog", tmp_path, "--index", tmp_path / "index.sqlite"),
    ]
    for command in commands:
        said = mesotap(*command).stdout
        assert said.count("/impacts/00001/acceleration") == 1, said
    content = json.loads(answer.read_text())
    assert sentence in content["notes"]
    assert len(content["impacts"]) == whole - 1
    assert (page / "report.html").read_text().count("this record is left out") == 1
    assert "left out" not in mesotap("info", other).stdout.replace("left out:", "")


def test_what_is_read_for_a_diagnosis_says_which_record_is_left_out(session, tmp_path):
    from mesotap.commands.diagnose import read_files

    path = with_changes(session, tmp_path / "s.h5", put_nan)
    console = Console(file=io.StringIO(), width=300)
    read = read_files([path], None, console)
    (sentence,) = [one for one in read.remarks if "left out" in one]
    assert console.file.getvalue().count(sentence) == 1


def test_a_session_file_of_bad_records_is_refused(session, tmp_path):
    def all_nan(file):
        for impact in file["impacts"].values():
            impact["acceleration"][0, 7] = np.nan

    path = with_changes(session, tmp_path / "s.h5", all_nan)
    for command in (("analyze", path), ("diagnose", path), ("hits", path), ("export", path, tmp_path / "s.csv")):
        assert "/impacts/00000/acceleration holds a NaN" in refused(*command)


def test_a_configuration_of_another_version_does_not_lock_a_recording_away(session, tmp_path):
    path = tmp_path / "old.h5"
    path.write_bytes((session / "session.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        del file["config"]
        file["config"] = "rig: {gadget: 3}\n"
    done = mesotap("analyze", path, "--json", tmp_path / "o.json")
    assert "another version" in done.stdout
    assert json.loads((tmp_path / "o.json").read_text())["loads"][0]["impacts_used"] == 2


def test_one_bad_file_does_not_cost_the_others_their_answers(session, tmp_path):
    out = tmp_path / "many.json"
    assert "absent.h5" in refused("analyze", session / "session.h5", tmp_path / "absent.h5", "--json", out)
    good, bad = json.loads(out.read_text())
    assert good["format"] == "mesotap-results"
    assert bad["format"] == "mesotap-refusal"


@pytest.mark.parametrize("command", [["published"], ["mechanisms"], ["formats"], ["simulate", "tap.h5"]])
def test_an_answer_that_cannot_be_written_is_told_before_anything_is_computed(command, tmp_path):
    done = mesotap(*command, "--json", "no/folder/x.json", cwd=tmp_path, code=2)
    assert done.stdout == ""
    assert "no/folder/x.json: cannot be written: the folder does not exist" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_an_answer_may_lie_in_a_folder_that_the_command_makes(tmp_path):
    mesotap("published", "--report", tmp_path / "new" / "page", "--json", tmp_path / "new" / "p.json")
    assert json.loads((tmp_path / "new" / "p.json").read_text())["version"] == 1


def test_json_on_standard_output_is_nothing_but_json():
    assert json.loads(mesotap("published", "--json", "-").stdout)["version"] == 1


def test_what_is_refused_is_refused_before_anything_is_computed_or_served(tmp_path):
    (tmp_path / "file").write_text("kept")
    assert "is not a folder" in refused("console", "--simulate", "--no-browser", "-o", "file", cwd=tmp_path)
    refused("prove", "--sessions", "1", "--json", "nowhere/x.json", cwd=tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["file"]


def every_command():
    """Names of all commands, whatever groups they stand in, as they are typed, with whether they have an answer."""
    from typer.main import get_command

    from mesotap.cli import app

    def within(command, words):
        inner = getattr(command, "commands", None)
        if inner is None:
            yield words, "--json" in [name for p in command.params for name in p.opts]
            return
        for name, one in inner.items():
            yield from within(one, (*words, name))

    return list(within(get_command(app), ()))


@pytest.mark.parametrize(
    ("words", "answers"), every_command(), ids=lambda v: " ".join(v) if isinstance(v, tuple) else ""
)
def test_every_command_answers_programs_and_refuses_with_code_2_and_a_sentence(words, answers, tmp_path):
    assert answers
    assert "--no-such-option" in refused(*words, "--no-such-option", cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_mechanisms_for_programs():
    answer = json.loads(mesotap("mechanisms", "--json", "-").stdout)
    friction = next(m for m in answer["mechanisms"] if m["id"] == "guide_friction")
    assert friction["parameters"] == [{"name": "friction_force_n", "unit": "N", "meaning": "friction force"}]


def test_a_recording_is_not_overwritten(session, tmp_path):
    assert "left as it is" in refused("simulate", session / "session.h5")
    assert "left as it is" in refused("import", decay(tmp_path / "r.csv"), session / "session.h5")
    one = tmp_path / "one.h5"
    mesotap("import", tmp_path / "r.csv", one)
    there = one.read_bytes()
    assert "name another file" in refused("import", decay(tmp_path / "other.csv"), one)
    assert "name another file" in refused("import", tmp_path / "r.csv", one)
    assert one.read_bytes() == there


def test_nothing_is_left_of_a_run_that_could_not_begin(tmp_path):
    assert "--simulate" in refused("run", "-o", "s", cwd=tmp_path)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["analyze", "absent.h5"], "absent.h5"),
        (["info", "."], "session"),
        (["resume", "nowhere"], "nowhere"),
        (["run"], "--simulate"),
        (["run", "--simulate", "--set", "mesotap.load_plan_mn=[5000]"], "rig.limits.load_mn"),
        (["run", "--simulate", "--config", "absent.yaml"], "absent.yaml"),
        (["analyze", "x.h5", "--method", "guess"], "ml and era"),
        (["simulate", "x.h5", "--load", "5000"], "rig.limits.load_mn"),
        (["simulate", "no/such/folder/x.h5"], "no/such/folder"),
        (["published", "--json", "no/such/folder/x.json"], "no/such/folder"),
        (["prove", "--sessions", "1", "--json", "no/such/folder/x.json"], "no/such/folder"),
    ],
)
def test_one_sentence_for_what_a_person_can_cause(arguments, expected, tmp_path):
    assert expected in refused(*arguments, cwd=tmp_path)


@pytest.mark.parametrize("command", ["run", "console", "devices", "check", "calibrate"])
def test_no_command_takes_two_rigs(command, tmp_path):
    assert "name two rigs" in refused(command, "--simulate", "--emulate", cwd=tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_second_program_in_one_session_is_refused(session):
    from daq.journal import SessionFolder

    with SessionFolder.open(session):
        assert "another program" in refused("resume", session)


def test_nothing_is_begun_over_a_session(session):
    assert "resume it" in refused("run", "--simulate", "-o", session)


@pytest.mark.slow
def test_control_c_ends_safely_and_resume_goes_on(tmp_path):
    import signal
    import time

    folder = tmp_path / "s"
    running = subprocess.Popen(
        [sys.executable, "-m", "mesotap", "run", "--simulate", "-o", str(folder), *QUICK, "--realtime"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    journal = folder / "journal.jsonl"
    for _ in range(600):
        if journal.exists() and "connected" in journal.read_text():
            break
        time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "resume" in errors
    assert "Traceback" not in errors
    ended = [json.loads(line)["event"] for line in journal.read_text().splitlines()[-2:]]
    assert ended == ["safe", "hardware"]  # and then what the run had to repeat


def test_what_a_command_of_a_group_writes_is_an_answer_for_programs(tmp_path):
    written = tmp_path / "new.yaml"
    assert json.loads(mesotap("config", "init", written, "--json", "-").stdout) == {"written": str(written)}
    checked = json.loads(mesotap("config", "check", written, "--json", "-").stdout)
    assert (checked["file"], checked["valid"]) == (str(written), True)


def test_an_interrupt_while_the_program_is_loading_has_no_traceback():
    loading = "import sys\nfrom mesotap.__main__ import main\nclass Late:\n def find_spec(self, name, *more):\n"
    loading += "  if name == 'mesotap.cli': raise KeyboardInterrupt\nsys.meta_path.insert(0, Late())\nmain()"
    ended = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, timeout=120.0)
    assert (ended.returncode, ended.stderr) == (130, "mesotap: interrupted\n")


def test_an_interrupt_is_said_and_ends_with_130(tmp_path):
    (tmp_path / "design.yaml").write_text("repeats: 1", encoding="utf-8")
    command = [sys.executable, "-m", "mesotap", "sweep", "design.yaml", "-o", "sweep"]
    running = subprocess.Popen(
        command,
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=interruptible,
    )
    until = time.monotonic() + 120.0
    while not (tmp_path / "sweep/campaign.json").exists() and running.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    assert running.communicate(timeout=120.0)[1] == "mesotap: interrupted\n"
    assert running.returncode == 130
