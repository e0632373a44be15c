"""The folder of a proof: what is hashed stays, what is answered is kept, and the diagnosis sees a session alone."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from daq.session_file import read_session
from mesotap.__main__ import _sentence
from mesotap.campaigns import one_task
from mesotap.campaigns.engine import Processes
from mesotap.commands.prove import outside, prove, prove_practice
from mesotap.proof import sealed
from mesotap.proof.errors import ProofError
from mesotap.proof.generator.outside_scenarios import held_back

ANSWER = {
    "version": 2,
    "verdict": "consistent",
    "p_value": 0.5,
    "mechanisms": [],
    "location": None,
    "fit": {"heldout_rms_before": 1.0, "heldout_rms_after": None},
    "seconds": 1.0,
}


def quiet(done: int, total: int) -> None:
    pass


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A proof of two sessions that are no real ones."""
    (tmp_path / "sessions").mkdir()
    truths = {
        "session-0000": {"kinds": [], "kind": "null", "d": 0.0, "without": None},
        "session-0001": {"kinds": ["adhesion"], "kind": "excluded", "d": 30.0, "without": "adhesion"},
    }
    content = json.dumps(truths).encode()
    (tmp_path / sealed.SEALED).write_bytes(gzip.compress(content))
    lines = ["# mesotap prove --seed 4 --sessions 2", f"{hashlib.sha256(content).hexdigest()}  truths.json"]
    for name in truths:
        (tmp_path / "sessions" / f"{name}.h5").write_bytes(name.encode())
        lines.append(f"{hashlib.sha256(name.encode()).hexdigest()}  sessions/{name}.h5")
    (tmp_path / sealed.HASHES).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tmp_path


def test_sealed_proof_is_gone_on_with(folder: Path) -> None:
    text = sealed.seal(folder, 4, 2, None, 1, quiet)
    assert text == (folder / sealed.HASHES).read_text(encoding="utf-8")
    assert sealed.names(folder) == ["session-0000", "session-0001"]
    assert sealed.excluded(folder) == {"session-0001": "adhesion"}


def test_another_proof_is_not_mixed_in(folder: Path) -> None:
    with pytest.raises(ProofError, match="holds another proof"):
        sealed.seal(folder, 5, 2, None, 1, quiet)


def test_changed_session_is_found_out(folder: Path) -> None:
    (folder / "sessions" / "session-0001.h5").write_bytes(b"else")
    with pytest.raises(ProofError, match=r"session-0001\.h5: is not the file"):
        sealed.unseal(folder)


def test_missing_session_is_named(folder: Path) -> None:
    (folder / "sessions" / "session-0000.h5").unlink()
    with pytest.raises(ProofError, match=r"session-0000\.h5: is missing"):
        sealed.check(folder)


def test_changed_truths_are_found_out(folder: Path) -> None:
    (folder / sealed.SEALED).write_bytes(gzip.compress(b"{}"))
    with pytest.raises(ProofError, match=r"truths\.json: is not the file"):
        sealed.unseal(folder)


def test_truths_are_in_the_open_only_after_unsealing(folder: Path) -> None:
    assert not (folder / sealed.TRUTHS).exists()
    sealed.unseal(folder)
    digest = hashlib.sha256((folder / sealed.TRUTHS).read_bytes()).hexdigest()
    assert f"{digest}  truths.json" in (folder / sealed.HASHES).read_text(encoding="utf-8")


def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    """Have something else run in the place of `python -m mesotap`."""
    root = tmp_path / "stand-in"
    (root / "mesotap").mkdir(parents=True)
    (root / "mesotap" / "__main__.py").write_text(body, encoding="utf-8")
    monkeypatch.setattr(one_task, "PACKAGE_ROOT", root)


def test_diagnosis_sees_a_copy_of_the_session_and_what_is_struck(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = f"""
import json, os, sys
answer = dict({ANSWER!r}, arguments=sys.argv[1:], files=sorted(os.listdir('.')))
json.dump(answer, open('answer.json', 'w'))
"""
    stand_in(tmp_path, monkeypatch, body)
    files = {n: sealed.files_of(folder, n) for n in sealed.names(folder)}
    seen: list[tuple[int, int]] = []
    sealed.diagnose_all(
        files, sealed.excluded(folder), folder / "answers", Processes(2), lambda a, b: seen.append((a, b))
    )
    plain, excluded = (sealed.answer_of(folder / "answers", n) for n in files)
    assert plain["arguments"] == ["diagnose", "session.h5", "--json", "answer.json", "--contract", "2"]
    assert plain["files"] == ["session.h5"]
    assert excluded["arguments"][-2:] == ["--without", "adhesion"]
    assert seen == [(0, 2), (1, 2), (2, 2)]


def test_answers_are_kept_and_failures_tried_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering = f"json.dump({ANSWER!r}, open('answer.json', 'w'))"
    body = f"""
import json, sys
if open('session.h5').read() == 'session-0000':
    {answering}
else:
    sys.exit('it broke')
"""
    stand_in(tmp_path, monkeypatch, body)
    files = {n: sealed.files_of(folder, n) for n in sealed.names(folder)}
    answers = folder / "answers"
    sealed.diagnose_all(files, {}, answers, Processes(2), quiet)
    assert sealed.answer_of(answers, "session-0000") == ANSWER
    assert sealed.answer_of(answers, "session-0001")["failed"] == "exit code 1: it broke"
    changed = body.replace("sys.exit('it broke')", answering).replace(answering, "sys.exit('asked again')", 1)
    (one_task.PACKAGE_ROOT / "mesotap" / "__main__.py").write_text(changed, encoding="utf-8")
    sealed.diagnose_all(files, {}, answers, Processes(2), quiet)
    assert sealed.answer_of(answers, "session-0000") == ANSWER
    assert sealed.answer_of(answers, "session-0001") == ANSWER


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "there is no such file"),
        ("{", "is not JSON"),
        ('{"a": 1}', "expected"),
        ('{"a": {"kinds": []}}', "no number 'd'"),
        ('{"a": {"kinds": [], "d": 0.0}}', "missing"),
    ],
)
def test_bad_practice_folder_gets_a_sentence(tmp_path: Path, content: str | None, said: str) -> None:
    if content is not None:
        (tmp_path / "truth.json").write_text(content, encoding="utf-8")
    with pytest.raises(ProofError, match=said):
        sealed.practice_sessions(tmp_path)


def test_practice_sessions_are_scored(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path, monkeypatch, f"import json; json.dump({ANSWER!r}, open('answer.json', 'w'))")
    truths: dict[str, Any] = {
        "session-0000": {"kinds": [], "d": 0.0},
        "session-0001": {"kinds": ["adhesion"], "d": 31.0},
    }
    (folder / "sessions" / "truth.json").write_text(json.dumps(truths), encoding="utf-8")
    output = tmp_path / "scored"
    prove_practice(folder / "sessions", None, output, Processes(1), (), Console(quiet=True))
    found = json.loads((output / "scores.json").read_text(encoding="utf-8"))
    assert found["nulls"]["alarms"]["of"] == 1
    assert [g["missed"]["hits"] for g in found["single"] if g["grade"] == 30.0] == [1]


def test_sessions_are_chosen_evenly() -> None:
    names = [f"s{i}" for i in range(10)]
    assert list(sealed.chosen(names, 3)) == ["s0", "s3", "s6"]
    assert list(sealed.chosen(names, None)) == names


def test_what_is_wrong_with_a_proof_is_told_in_a_sentence() -> None:
    assert _sentence(ProofError("the folder holds another proof")) == "the folder holds another proof"


def test_unknown_kind_gets_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ProofError, match="expected one of null, single"):
        prove(1, 2, "double", tmp_path, 1, Processes(1), (), Console(quiet=True))


@pytest.mark.long
def test_proof_of_effects_outside_the_list_scores_what_is_said_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = {**ANSWER, "verdict": "unexplained", "p_value": 0.0, "location": {"component": "contact"}}
    stand_in(tmp_path, monkeypatch, f"import json; json.dump({answer!r}, open('answer.json', 'w'))")
    folder = tmp_path / "proof"
    prove(3, 2, "outside", folder, 1, Processes(1), (), Console(quiet=True), outside("1x2", 4, None))
    heading = (folder / "hashes.txt").read_text(encoding="utf-8").splitlines()[0]
    assert heading == "# mesotap prove --outside --size 1x2 --sealed 4 --seed 3 --sessions 2 --only outside"
    found = json.loads((folder / "scores.json").read_text(encoding="utf-8"))
    hidden = {line["effect"] for line in found["laws"]["effects"]}
    assert hidden <= set(held_back(4))
    assert found["laws"]["goals"][0]["reached"]["of"] == 2
    assert all(len(read_session(folder / "sessions" / f"session-000{i}.h5").impacts) == 2 for i in range(2))
    assert "## Laws that nobody listed" in (folder / "proof.md").read_text(encoding="utf-8")


SEED = 70  # of two small sessions: nothing, and tube springs that dissipate


@pytest.mark.long
def test_small_proof_is_right(tmp_path: Path) -> None:
    """Two sessions through everything: one in which nothing is hidden, one with an effect that nobody can miss."""
    prove(SEED, 2, None, tmp_path, 2, Processes(2), (), Console(quiet=True))
    found = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    assert found["failures"] == {}
    null, strong = sorted(found["entries"], key=lambda e: e["d"])
    assert (null["kind"], null["verdict"]) == ("null", "consistent")
    assert strong["kind"] == "single"
    assert strong["d"] > 80
    assert strong["verdict"] == "missing_physics"
    assert strong["named"][0]["id"] == strong["hidden"][0]
    assert null["heldout_over_knowing"] == pytest.approx(1.0, abs=0.05)
    for path in (tmp_path / "sessions").iterdir():
        session = read_session(path)
        assert not any(word in repr(session.rig) + session.title + session.config for word in strong["hidden"])
    before = (tmp_path / "hashes.txt").read_bytes()
    prove(SEED, 2, None, tmp_path, 2, Processes(2), (), Console(quiet=True))
    assert (tmp_path / "hashes.txt").read_bytes() == before
