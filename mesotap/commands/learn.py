"""`mesotap learn`: keep a learned law as a mechanism of one's own."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from daq.errors import RecordingError
from mesotap.answers.kept_law import file_text, listed_twin, read_law
from mesotap.commands.outputs import write_json
from mesotap.configuration.rig_files import load_rig, tester_rig
from mesotap.operator.terminal import escape
from rig.plugins import PluginError
from sim_backend.mechanisms.catalogue import load_file


def learn(answer: Path, name: str, folder: Path, rig: Path | None, json: Path | None, console: Console) -> None:
    """Write the law that a diagnosis learned as ``folder/name.py``; nothing where it is a listed mechanism's.

    Raises
    ------
    RecordingError
        The answer has no law to keep, the name is taken, or the file is there already.
    """
    law = read_law(answer)
    described = tester_rig() if rig is None else load_rig(rig)
    text = file_text(law, name, described.arrangement)
    file = folder / f"{name}.py"
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise RecordingError(f"{file}: exists already and is left as it is; choose another --name") from None
    try:
        (mechanism,) = load_file(file)
    except PluginError as error:
        file.unlink()
        raise RecordingError(f"{answer}: its law cannot be kept: {error}") from error
    twin = listed_twin(mechanism)
    if twin is not None:
        file.unlink()
        console.print(
            f"{escape(law.formula)} is {twin}, which is listed already: nothing was written.", highlight=False
        )
    else:
        console.print(f"{escape(file)}: {escape(law.formula)}", highlight=False, soft_wrap=True)
        setting = escape(f"analysis: {{mechanisms: [{folder}]}}")
        console.print(
            f"Name its folder in the configuration ({setting}), and {escape(name)} is sought like any other; "
            f"'mesotap mechanisms --check {escape(file)}' checks it.",
            highlight=False,
            soft_wrap=True,
        )
    written = None if twin is not None else str(file)
    write_json(json, {"file": written, "id": name if twin is None else twin, "formula": law.formula})
