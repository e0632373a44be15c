"""``console``: the page in the browser that runs sessions."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from rich.console import Console

from mesotap.commands.outputs import make_ready, write_json
from mesotap.configuration.config import ConfigError, load_config
from mesotap.console.at_work import Bench
from mesotap.console.gate import OPEN_PATH
from mesotap.console.server import Address, ConsoleError, ConsoleServer
from mesotap.operator.terminal import escape
from mesotap.session.order import RigChoice


def console(
    config_path: Path | None,
    changes: tuple[str, ...],
    choice: RigChoice,
    root: Path,
    address: Address,
    browser: bool,
    terminal: Console,
    log_wire: bool = False,
    scope: bool = False,
    json_path: Path | None = None,
) -> None:
    """Serve the console until a signal ends it; where it is and what opens it goes to ``json_path`` at its begin."""

    def said(text: str) -> None:
        terminal.print(escape(text), highlight=False, soft_wrap=True)

    if scope and log_wire:
        raise ConfigError(
            "--log-wire: the live view has no session.log; 'mesotap devices --record-wire' records the wire"
        )
    if root.exists() and not root.is_dir():
        raise ConsoleError(f"{root}: is not a folder, and sessions are written into one; name another --output")
    if not scope:
        make_ready(None, root)  # neither is it told to whoever presses Start that no folder can be made there
    load_config(config_path, changes)  # a mistake is told here, not to whoever opens the page
    server = ConsoleServer(Bench(config_path, changes, choice, root, log_wire, scope), address, said)
    if not address.loopback:
        said(f"warning: {address.host} can be reached by other machines; who has the link runs the rig")
        if address.certificate is None:
            said("warning: without --certfile and --keyfile, whoever listens on the network reads the link")
    server.run(browser, lambda link: _write_place(json_path, link, None if scope else root))


def _write_place(path: Path | None, link: str, sessions: Path | None) -> None:
    """Tell programs where the console is; only the user may read the file, as the link runs the rig."""
    content = {
        "format": "mesotap-console",
        "version": 1,
        "address": link.partition(OPEN_PATH)[0],
        "link": link,
        "sessions": None if sessions is None else str(sessions.absolute()),
    }
    mask = os.umask(0o077)
    try:
        write_json(path, content)
    finally:
        os.umask(mask)
    sys.stdout.flush()
