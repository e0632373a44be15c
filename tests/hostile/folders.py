"""Session folders that were damaged, or put together by somebody else."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from daq.journal import SessionFolder
from mesotap.configuration.config import Config, effective_text
from tests.fuzz.sessions import small_session
from tests.hostile.case import Case, Make
from tests.hostile.hdf5_files import HOSTILE_TEXT, MERGE_BOMB

HEADER = {
    "created": "2026-01-01T00:00:00Z",
    "config": effective_text(Config()),
    "simulated": True,
    "emulated": False,
    "seed": 1,
    "realtime": False,
    "software": "mesotap 0.1.0",
}
Damage = Callable[[Path], Any]


def session(damage: Damage, command: str) -> Make:
    def make(folder: Path) -> list[str]:
        root = folder / "s"
        with SessionFolder.create(root, HEADER) as kept:
            kept.append({"event": "started"})
            kept.write_impact(small_session().impacts[0], {"state": 1})
        damage(root)
        return [command, "s"]

    return make


def header(**changes: Any) -> Damage:
    def damage(root: Path) -> None:
        content = {key: value for key, value in {**HEADER, **changes}.items() if value is not ...}
        (root / "session.json").write_text(json.dumps(content), encoding="utf-8")

    return damage


def journal(content: bytes) -> Damage:
    return lambda root: (root / "journal.jsonl").write_bytes(content)


def instead(name: str, put: Callable[[Path], Any]) -> Damage:
    def damage(root: Path) -> None:
        place = root / name
        if place.is_dir():
            shutil.rmtree(place)
        elif place.exists():
            place.unlink()
        put(place)

    return damage


def event(**entry: Any) -> Damage:
    return journal((json.dumps({"event": "started"}) + "\n" + json.dumps(entry) + "\n").encode())


def cut(name: str, share: float) -> Damage:
    def damage(root: Path) -> None:
        content = (root / name).read_bytes()
        (root / name).write_bytes(content[: int(share * len(content))])

    return damage


DAMAGES: dict[str, Damage] = {
    "no header": instead("session.json", lambda p: None),
    "an empty header": instead("session.json", lambda p: p.write_bytes(b"")),
    "half a header": cut("session.json", 0.5),
    "a header that is a pipe": instead("session.json", lambda p: os.mkfifo(p)),
    "a header that is a folder": instead("session.json", lambda p: p.mkdir()),
    "a header that is /dev/zero": instead("session.json", lambda p: p.symlink_to("/dev/zero")),
    "a header of 100,000 lists": instead("session.json", lambda p: p.write_bytes(b"[" * 100_000)),
    "a header without a configuration": header(config=...),
    "a header without a seed": header(seed=...),
    "a seed that is a text": header(seed=HOSTILE_TEXT),
    "a merge bomb as configuration": header(config=MERGE_BOMB),
    "a list as configuration": header(config=[1, 2]),
    "a date that is none": header(created=HOSTILE_TEXT),
    "no journal": instead("journal.jsonl", lambda p: None),
    "a journal of noise": journal(bytes(range(256)) * 10),
    "a journal of zeros": journal(bytes(1000)),
    "a journal that is a pipe": instead("journal.jsonl", lambda p: os.mkfifo(p)),
    "a journal that is a folder": instead("journal.jsonl", lambda p: p.mkdir()),
    "a journal of 100,000 lists": journal(b"[" * 100_000 + b"\n{}\n"),
    "an unknown event": event(event=HOSTILE_TEXT),
    "an event that is a list": event(event=[1]),
    "a shot without a number": event(event="shot"),
    "a shot of number 1e300": event(event="shot", number=1e300, accepted=True),
    "a shot that is not there": event(event="shot", number=7, accepted=True, reject_reason=""),
    "a shot number that is a text": event(event="shot", number="x", accepted=True),
    "a calibration of texts": event(event="calibrated", load_mn=["x"], voltage_mv=["y"], time="z", when="pre"),
    "half a shot": cut("shots/00000.h5", 0.5),
    "a shot of zeros": instead("shots/00000.h5", lambda p: p.write_bytes(bytes(1000))),
    "a shot that is a pipe": instead("shots/00000.h5", lambda p: os.mkfifo(p)),
    "a shot that is a folder": instead("shots/00000.h5", lambda p: p.mkdir()),
    "shots that are a file": instead("shots", lambda p: p.write_bytes(b"")),
    "shots that are a link to themselves": instead("shots", lambda p: p.symlink_to("shots")),
    "a lock that is a folder": instead("lock", lambda p: p.mkdir()),
}


def cases() -> Iterator[Case]:
    """Every damage, given to each command that reads a session folder."""
    for name, damage in DAMAGES.items():
        for command in ("info", "resume", "report", "recover"):
            yield Case("session folders", f"{name}, {command}", session(damage, command), either=True, lines=True)
