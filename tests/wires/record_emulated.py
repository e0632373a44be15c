"""Record `emulated.jsonl` anew when a driver asks for more than it did: ``python -m tests.wires.record_emulated``."""

from __future__ import annotations

import json
from pathlib import Path

from mesotap.commands.wire_options import WireOptions
from mesotap.configuration.config import parse_config
from mesotap.session.bench import emulated_rig

HERE = Path(__file__).parent
PARTS = """
rig:
  parts:
    load_cell: {driver: modbus-rtu, preset: seneca-ze-sg3, port: /dev/ttyUSB0}
    stage: {driver: conex-cc, port: /dev/ttyUSB1, resolution_um: 0.02}
"""
READINGS = 5


def main() -> None:
    """Connect, read the gauge a few times, and keep what each driver said with the recording."""
    path = HERE / "emulated.jsonl"
    path.unlink(missing_ok=True)
    config = parse_config(PARTS)
    with WireOptions(path).begun(config, "check") as file:
        rig = emulated_rig(config, seed=1, wire_file=file)
        said = rig.open()[:3]
        for _ in range(READINGS):
            rig.load_cell.read()
        rig.close()
    header, *acts = path.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = {**json.loads(header), "connected": said}
    path.write_text(json.dumps(kept) + "\n" + "".join(acts), encoding="utf-8")


if __name__ == "__main__":
    main()
