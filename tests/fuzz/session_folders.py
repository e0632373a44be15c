"""Session folders, each damaged in one way: what a disk, another program or a person can do to them."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py

from mesotap.commands.session import SESSION_FILE
from mesotap.session.bench import simulated_rig
from mesotap.session.progress import assemble
from rig import SessionAborted
from tests.mesotap.benches import new_runner, small_config

Damage = Callable[[Path], None]
TAPS_BEFORE_THE_END = 3


class _Leaving:
    """Ends a session after some taps."""

    def __init__(self) -> None:
        self.impacts = 0

    def progress(self, state: object, text: str) -> None:
        pass

    def impact(self, impact: object, accepted: int, wanted: int) -> None:
        self.impacts += 1
        if self.impacts == TAPS_BEFORE_THE_END:
            raise SessionAborted("enough")


def unfinished(path: Path) -> None:
    """Make a session folder with three of four taps."""
    config = small_config("mesotap.diagnose=false")
    folder, runner = new_runner(path, config, simulated_rig(config, seed=1), observer=_Leaving())
    with folder:
        try:
            runner.run()
        except SessionAborted:
            return
    raise AssertionError("the session was to be ended")


def finished(path: Path) -> None:
    """Make a session folder that is at its end, with its session file."""
    from daq.session_file import write_session

    config = small_config("mesotap.diagnose=false")
    folder, runner = new_runner(path, config, simulated_rig(config, seed=1))
    with folder:
        progress = runner.run()
        write_session(path / SESSION_FILE, assemble(folder.header, config, progress, folder.impacts()))
        runner.finish()


# --- what is damaged ------------------------------------------------------------------------------------------


def _lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "journal.jsonl").read_bytes().splitlines()]


def _entries(change: Callable[[list[dict[str, Any]]], Any]) -> Damage:
    """Damage that changes the journal's entries."""

    def damage(folder: Path) -> None:
        entries = _lines(folder)
        change(entries)
        (folder / "journal.jsonl").write_text("".join(json.dumps(e) + "\n" for e in entries))

    return damage


def _of(entries: list[dict[str, Any]], event: str) -> dict[str, Any]:
    return next(e for e in entries if e["event"] == event)


def _set(event: str, **items: Any) -> Damage:
    return _entries(lambda entries: _of(entries, event).update(items))


def _without(event: str, item: str) -> Damage:
    return _entries(lambda entries: _of(entries, event).pop(item))


def _bytes(name: str, change: Callable[[bytes], bytes]) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).write_bytes(change((folder / name).read_bytes()))

    return damage


def _header(**items: Any) -> Damage:
    def damage(folder: Path) -> None:
        header = json.loads((folder / "session.json").read_text())
        header.update(items)
        (folder / "session.json").write_text(json.dumps(header))

    return damage


def _gone(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


def _folder_instead(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).mkdir()

    return damage


def _grown(name: str) -> Damage:
    """A file with a hole of 3 GB, which takes no room on the disk."""
    return lambda folder: os.truncate(folder / name, 3 << 30)


def _fifo_instead(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return damage


def _link_instead(name: str, to: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(to)

    return damage


def _file_instead_of_impacts(folder: Path) -> None:
    shutil.rmtree(folder / "shots")
    (folder / "shots").write_text("no folder")


def _in_impact(change: Callable[[h5py.File], Any], name: str = "00001.h5") -> Damage:
    def damage(folder: Path) -> None:
        with h5py.File(folder / "shots" / name, "r+") as file:
            change(file)

    return damage


def _renamed(old: str, new: str) -> Damage:
    return lambda folder: (folder / "shots" / old).rename(folder / "shots" / new)


def _copied(old: str, new: str) -> Damage:
    return lambda folder: (folder / "shots" / new).write_bytes((folder / "shots" / old).read_bytes())


def _swapped(folder: Path) -> None:
    first, second = folder / "shots" / "00000.h5", folder / "shots" / "00001.h5"
    contents = first.read_bytes(), second.read_bytes()
    second.write_bytes(contents[0])
    first.write_bytes(contents[1])


def _checkpoint(text: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file["checkpoint"]
        file.create_dataset("checkpoint", data=text, dtype=h5py.string_dtype())

    return change


def _foreign(name: str) -> Damage:
    def damage(folder: Path) -> None:
        with h5py.File(folder / "shots" / name, "w") as file:
            file.attrs["format"] = "something else"

    return damage


def _every_impact_gone(folder: Path) -> None:
    for file in (folder / "shots").iterdir():
        file.unlink()


def _first_line(entries: list[dict[str, Any]], entry: dict[str, Any]) -> None:
    entries.insert(0, entry)


def _doubled(event: str) -> Damage:
    def change(entries: list[dict[str, Any]]) -> None:
        at = next(i for i, e in enumerate(entries) if e["event"] == event)
        entries.insert(at, entries[at])

    return _entries(change)


def _impacts_out_of_order(entries: list[dict[str, Any]]) -> None:
    first, second = [e for e in entries if e["event"] == "shot"][:2]
    first["number"], second["number"] = second["number"], first["number"]


def _truths(truth: Any) -> Damage:
    return _entries(lambda entries: [e.update(truth=truth) for e in entries if e["event"] == "loaded"])


def _middle(content: bytes) -> bytes:
    lines = content.split(b"\n")
    lines[3] = lines[3][: len(lines[3]) // 2]
    return b"\n".join(lines)


def _other_key(folder: Path) -> None:
    header = json.loads((folder / "session.json").read_text())
    header["config"] = header["config"].replace("dwell_s:", "dwell_of_another_version_s:")
    (folder / "session.json").write_text(json.dumps(header))


def _refused_value(folder: Path) -> None:
    header = json.loads((folder / "session.json").read_text())
    header["config"] = header["config"].replace("m1_kg: 0.107", "m1_kg: -1")
    (folder / "session.json").write_text(json.dumps(header))


def _refused_load(folder: Path) -> None:
    header = json.loads((folder / "session.json").read_text())
    header["config"] = header["config"].replace("impacts_per_load: 2", "impacts_per_load: none")
    (folder / "session.json").write_text(json.dumps(header))


DAMAGES: dict[str, Damage] = {
    "journal: a line damaged in the middle": _bytes("journal.jsonl", _middle),
    "journal: missing": _gone("journal.jsonl"),
    "journal: empty": _bytes("journal.jsonl", lambda content: b""),
    "journal: cut within a line": _bytes("journal.jsonl", lambda content: content[:-40]),
    "journal: without its first half": _bytes("journal.jsonl", lambda content: b"\n".join(content.split(b"\n")[5:])),
    "journal: zeros at its end": _bytes("journal.jsonl", lambda content: content + bytes(4096)),
    "journal: a zero line within": _bytes("journal.jsonl", lambda content: bytes(100) + b"\n" + content),
    "journal: a shot twice": _doubled("shot"),
    "journal: a calibration twice": _doubled("calibrated"),
    "journal: a load set twice": _doubled("loaded"),
    "journal: a load voltage too few": _set("calibrated", voltage_mv=[1.0]),
    "journal: a voltage that is NaN": _set("calibrated", voltage_mv=[0.0, float("nan"), 1.0]),
    "journal: voltages that are text": _set("calibrated", voltage_mv="012"),
    "journal: loads of lists": _set("calibrated", load_mn=[[0], [1], [2]]),
    "journal: a calibration without a date": _without("calibrated", "time"),
    "journal: a calibration of no date": _set("calibrated", time="yesterday"),
    "journal: contact load a list": _set("contact", load_mn=[1]),
    "journal: contact position infinite": _set("contact", position_um=float("inf")),
    "journal: contact without a position": _without("contact", "position_um"),
    "journal: load that is text": _set("loaded", load_mn="300"),
    "journal: load that is missing": _without("loaded", "load_mn"),
    "journal: truth that is text": _truths({"load_mn": "much"}),
    "journal: truth that is a list": _truths([1, 2]),
    "journal: an unknown event": _entries(lambda entries: _first_line(entries, {"event": "party"})),
    "journal: an event that is a number": _entries(lambda entries: _first_line(entries, {"event": 5})),
    "journal: an event that is a list": _entries(lambda entries: _first_line(entries, {"event": ["shot"]})),
    "journal: an event that cannot be": _entries(lambda entries: _first_line(entries, {"event": "plan done"})),
    "journal: more loads than the plan has": _entries(
        lambda entries: [entries.append({"event": "load done"}) for _ in range(5)]
    ),
    "journal: no first start": _entries(lambda entries: entries.pop(0)),
    "journal: shots out of order": _entries(_impacts_out_of_order),
    "journal: a shot of a negative number": _set("shot", number=-1),
    "journal: a shot that is not in it": _entries(lambda entries: entries.remove(_of(entries, "shot"))),
    "journal: a shot whose number is text": _set("shot", number="0"),
    "journal: a shot of a fractional number": _set("shot", number=0.5),
    "journal: a shot accepted maybe": _set("shot", accepted="maybe"),
    "journal: a shot without a reason": _without("shot", "reject_reason"),
    "journal: a shot without a number": _without("shot", "number"),
    "journal: a shot of another digest": _set("shot", digest="sha256:" + 64 * "0"),
    "journal: troubles that are a number": _set("safe", troubles=7),
    "journal: state of the rig a list": _entries(lambda entries: entries[-1].update(rig=[1, 2])),
    "journal: state of the rig of text": _entries(lambda entries: entries[-1].update(rig={"version": "x"})),
    "journal: state of the rig without its parts": _entries(
        lambda entries: entries[-1].update(rig={k: entries[-1]["rig"][k] for k in ("version", "seed", "time_s")})
    ),
    "journal: not UTF-8": _bytes("journal.jsonl", lambda content: content.replace(b"connected", b"conn\xff\xfe")),
    "journal: half a surrogate": _bytes("journal.jsonl", lambda c: c.replace(b'"connected"', b'"connected\\ud800"')),
    "journal: nested too deep": _bytes("journal.jsonl", lambda content: b"[" * 100_000 + b"\n" + content),
    "journal: a number of 5,000 digits": _bytes(
        "journal.jsonl", lambda content: content.replace(b'"number": 0', b'"number": ' + b"9" * 5000)
    ),
    "journal: a folder": _folder_instead("journal.jsonl"),
    "journal: a link": _link_instead("journal.jsonl", "/etc/passwd"),
    "journal: a FIFO": _fifo_instead("journal.jsonl"),
    "journal: 3 GB of zeros": _grown("journal.jsonl"),
    "header: 3 GB of zeros": _grown("session.json"),
    "header: missing": _gone("session.json"),
    "header: empty": _bytes("session.json", lambda content: b""),
    "header: cut": _bytes("session.json", lambda content: content[:-20]),
    "header: not UTF-8": _bytes("session.json", lambda content: content.replace(b"config", b"\xff\xfe")),
    "header: a list": _bytes("session.json", lambda content: b"[1, 2]"),
    "header: of another format": _header(format="photographs"),
    "header: of a newer version": _header(format_version=7, software="mesotap 9.9"),
    "header: version that is text": _header(format_version="one"),
    "header: configuration a number": _header(config=5),
    "header: configuration not YAML": _header(config="rig: [1, {"),
    "header: configuration of half a surrogate": _header(config="mesotap: {title: '\ud800'}"),
    "header: configuration with a value refused": _refused_value,
    "header: configuration with a load refused": _refused_load,
    "header: configuration with a key of another version": _other_key,
    "header: seed that is text": _header(seed="seven"),
    "header: seed that is infinite": _header(seed=float("inf")),
    "header: of no date": _header(created="yesterday"),
    "header: simulated maybe": _header(simulated="maybe"),
    "header: a folder": _folder_instead("session.json"),
    "header: a FIFO": _fifo_instead("session.json"),
    "header: a link in a circle": _link_instead("session.json", "session.json"),
    "lock: a folder": _folder_instead("lock"),
    "lock: a link": _link_instead("lock", "/etc/passwd"),
    "lock: a FIFO": _fifo_instead("lock"),
    "shots: a file": _file_instead_of_impacts,
    "shots: missing": lambda folder: shutil.rmtree(folder / "shots"),
    "shots: none": _every_impact_gone,
    "shots: one missing": _gone("shots/00001.h5"),
    "shots: the last missing": _gone("shots/00002.h5"),
    "shots: one cut": _bytes("shots/00001.h5", lambda content: content[: len(content) // 2]),
    "shots: one empty": _bytes("shots/00001.h5", lambda content: b""),
    "shots: one overwritten with zeros": _bytes("shots/00001.h5", lambda content: bytes(len(content))),
    "shots: a bit flipped in each tenth byte": _bytes(
        "shots/00001.h5", lambda content: bytes(b ^ (not i % 10) for i, b in enumerate(content))
    ),
    "shots: a sample altered": _in_impact(
        lambda file: file["shot/acceleration"].write_direct(0 * file["shot/acceleration"][()])
    ),
    "shots: a sample that is NaN": _in_impact(lambda file: file["shot/strain_mv"].__setitem__(3, float("nan"))),
    "shots: one whose verdict was altered": _in_impact(lambda file: file["shot"].attrs.__setitem__("accepted", False)),
    "shots: one of a load out of this world": _in_impact(
        lambda file: file["shot"].attrs.__setitem__("load_set", 10**8)
    ),
    "shots: checkpoint not JSON": _in_impact(_checkpoint("{"), "00002.h5"),
    "shots: checkpoint a list": _in_impact(_checkpoint("[1]"), "00002.h5"),
    "shots: one renamed": _renamed("00001.h5", "tap number 1.h5"),
    "shots: one under another's number": _renamed("00002.h5", "00007.h5"),
    "shots: two exchanged": _swapped,
    "shots: a copy of one": _copied("00001.h5", "00001 (copy).h5"),
    "shots: a copy under the next number": _copied("00001.h5", "00003.h5"),
    "shots: a foreign HDF5 file": _foreign("00003.h5"),
    "shots: a text of that name": lambda folder: (folder / "shots" / "00003.h5").write_text("hello") and None,
    "shots: a folder of that name": lambda folder: (folder / "shots" / "00003.h5").mkdir(),
    "shots: a FIFO of that name": lambda folder: os.mkfifo(folder / "shots" / "00003.h5"),
    "shots: a link to another": _link_instead("shots/00003.h5", "00000.h5"),
    "shots: a number of 30 digits": _copied("00001.h5", "1" * 30 + ".h5"),
    "shots: an unfinished one that is a link": lambda folder: (folder / "shots" / "00003.h5.part").symlink_to(
        "/etc/passwd"
    ),
    "permissions: none for the journal": lambda folder: (folder / "journal.jsonl").chmod(0),
    "permissions: none for the header": lambda folder: (folder / "session.json").chmod(0),
    "permissions: none for the lock": lambda folder: (folder / "lock").chmod(0),
    "permissions: none for a shot": lambda folder: (folder / "shots" / "00001.h5").chmod(0),
    "permissions: none for the shots": lambda folder: (folder / "shots").chmod(0),
    "permissions: none to write the folder": lambda folder: folder.chmod(0o500),
    "permissions: none for the folder": lambda folder: folder.chmod(0),
    "session file: a folder": _folder_instead("session.h5"),
    "session file: text": lambda folder: (folder / "session.h5").write_text("hello") and None,
    "session file: a FIFO": _fifo_instead("session.h5"),
}
"""By name. Whoever opens such a folder gets one sentence, or what is right. Permissions mean nothing to root."""
