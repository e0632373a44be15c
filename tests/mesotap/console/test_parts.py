"""Numbers as the pages write them, by the page's own function in Node; skipped where there is none."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import mesotap.console

PARTS = Path(mesotap.console.__file__).parent / "static" / "parts.js"

# value, half, scale, what is written: by the rule of two significant digits of the uncertainty, worked out by hand
WRITTEN = [
    (0.0065, 2e-6, 100, "0.65000 ± 0.00020"),
    (7.0312e6, 0.012e6, 1e-6, "7.031 ± 0.012"),
    (1234.56, 0.0996, 1, "1234.56 ± 0.10"),
    (264.9, 12.4, 1, "265 ± 12"),
    (5000.0, 123.0, 1, "5000 ± 120"),
    (3.5, 0.0, 1, "3.500 ± 0"),
]


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")
def test_an_uncertainty_has_two_digits_and_the_value_as_many_decimals(tmp_path):
    module = tmp_path / "parts.mjs"
    module.write_bytes(PARTS.read_bytes())
    asked = [[{"value": value, "half": half}, scale] for value, half, scale, _ in WRITTEN]
    script = (
        f"import {{ within }} from {json.dumps(module.as_uri())};"
        f"console.log(JSON.stringify([...{json.dumps(asked)}.map((a) => within(...a)), within(null)]));"
    )
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert json.loads(done.stdout) == [*(written for *_, written in WRITTEN), "–"]
