"""What is in the source distribution."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

from tests.mesotap.installed import ROOT

BUILD = "from setuptools import build_meta; build_meta.build_sdist('.')"


def test_it_has_what_changed_how_to_cite_and_how_to_change_it(tmp_path: Path) -> None:
    for file in (f for f in ROOT.iterdir() if f.is_file() and f.suffix in (".md", ".toml", ".cff", ".in", "")):
        shutil.copy(file, tmp_path)
    subprocess.run([sys.executable, "-c", BUILD], cwd=tmp_path, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as content:
        names = {Path(name).name for name in content.getnames()}
    assert {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md"} <= names
