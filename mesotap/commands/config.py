"""``config migrate``: an older configuration rewritten as this version writes it."""

from __future__ import annotations

import difflib
from pathlib import Path

from rich.console import Console

from daq.durable import write_whole
from mesotap.commands.outputs import write_json
from mesotap.configuration.config import text_of
from mesotap.configuration.settings import CONFIG_VERSION
from mesotap.configuration.versions import migrated_soundly, remark_on, version_of
from mesotap.operator.terminal import escape


def older(file: Path | None) -> str:
    """Return what to do about a configuration file of an older version; empty for this one, or where there is none."""
    path = file or Path("config.yaml")
    if file is None and not path.exists():
        return ""
    return remark_on(text_of(path, "a configuration"), str(path))


def migrate(file: Path, dry_run: bool, json_path: Path | None, console: Console) -> None:
    """Show what changes, and write it; the file as it was stays beside it, under a name of its own."""
    path = file.resolve()  # behind a link it is the file that is rewritten, not the link
    before = text_of(path, "a configuration")
    version = version_of(before)
    after = migrated_soundly(before, str(file))
    answer = {"file": str(file), "from": version, "to": CONFIG_VERSION, "written": False, "backup": None}
    if after == before:
        console.print(f"{escape(file)}: is of version {CONFIG_VERSION} already", highlight=False, soft_wrap=True)
        write_json(json_path, answer)
        return
    names = f"{file} (version {version})", f"{file} (version {CONFIG_VERSION})"
    for line in difflib.unified_diff(before.splitlines(), after.splitlines(), *names, lineterm="", n=1):
        console.print(escape(line), highlight=False, soft_wrap=True)
    if not dry_run:
        backup = _free(path, version)
        mode = path.stat().st_mode
        write_whole(backup, before.encode(), new=True)
        write_whole(path, after.encode())
        for written in (path, backup):
            written.chmod(mode)
        console.print(f"{escape(file)}: written; as it was: {escape(backup)}", highlight=False, soft_wrap=True)
        answer |= {"written": True, "backup": str(backup)}
    write_json(json_path, answer)


def _free(path: Path, version: int) -> Path:
    """Return a name beside a file that no file has."""
    names = (f"{path.name}.v{version}{number}" for number in ("", *(f".{n}" for n in range(1, 1000))))
    return next(name for name in map(path.with_name, names) if not name.exists() and not name.is_symlink())
