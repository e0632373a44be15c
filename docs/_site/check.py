"""Check the site that was built, and the examples on its pages and in docstrings.

Every link and every picture leads to something that is there, in the site as in the pages of the repository; nothing is
fetched from elsewhere to show a page. Examples give what they say. Used by `make docs`.
"""

from __future__ import annotations

import doctest
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).parents[2]
PACKAGES = ("rig", "daq", "calibration", "analysis", "sim_backend", "mesotap")
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
TUTORIAL = ROOT / "docs" / "tutorial.md"
QUICK = ("config", "simulate", "info")  # commands of the tutorial that are run; tests run the others
LINK = re.compile(r"(?<!\!)\[[^\]]*\]\(([^)\s]+)\)")


class _Links(HTMLParser):
    """What a page links to, what it shows or runs, and the places in it that can be linked to."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.places: set[str] = set()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Collect."""
        given = dict(attributes)
        self.places |= {str(given[key]) for key in ("id", "name") if given.get(key)}
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        elif given.get("src") or (tag == "link" and given.get("href")):
            self.fetched.append(str(given.get("src") or given.get("href")))


def faults_of_site(site: Path) -> Iterator[str]:
    """Yield a line for each link or file that is not there, or that is fetched from elsewhere."""
    pages = {}
    for file in sorted(site.rglob("*.html")):
        pages[file.resolve()] = page = _Links()
        page.feed(file.read_text(encoding="utf-8"))
    for file, page in pages.items():
        where = file.relative_to(site.resolve())
        for link in (*page.links, *page.fetched):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.fetched and parts.scheme != "data":
                    yield f"{where}: fetches {link}"
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.exists():
                yield f"{where}: {link} is not there"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].places:
                yield f"{where}: {link} has no such place"


def faults_of_repository() -> Iterator[str]:
    """Yield a line for each link in a page beside the docs that leads nowhere."""
    for name in PAGES:
        for link in LINK.findall((ROOT / name).read_text(encoding="utf-8")):
            if not urlsplit(link).scheme and not (ROOT / link.partition("#")[0]).exists():
                yield f"{name}: {link} is not there"


def faults_of_tutorial() -> Iterator[str]:
    """Run the tutorial's quick commands and its Python in an empty folder; yield a line for what went wrong."""
    text = TUTORIAL.read_text(encoding="utf-8")
    commands = [shlex.split(line, comments=True) for line in text.splitlines() if line.startswith("    mesotap ")]
    back = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for command in commands:
                if command[1] in QUICK:
                    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False)
                    if done.returncode:
                        yield f"{TUTORIAL.name}: {shlex.join(command)}: {done.stderr.strip()}"
            failed = doctest.testfile(str(TUTORIAL), module_relative=False).failed
            if failed:
                yield f"{TUTORIAL.name}: {failed} examples fail"
        finally:
            os.chdir(back)


def modules_with_examples() -> list[str]:
    """Return the files whose docstrings hold examples, but those that a test of their own runs."""
    files = (file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py")))
    tested = {ROOT / "mesotap" / "__init__.py", ROOT / "mesotap" / "api.py"}
    return [str(f) for f in files if f not in tested and re.search(r"^ *>>> ", f.read_text("utf-8"), re.MULTILINE)]


def main(site: Path) -> int:
    """Print what is wrong, a line each; return the exit code."""
    faults = [*faults_of_site(site), *faults_of_repository(), *faults_of_tutorial()]
    for fault in faults:
        print(fault)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--doctest-modules", *modules_with_examples()]
    examples = subprocess.run(command, cwd=ROOT, check=False).returncode
    print(f"{len(list(site.rglob('*.html')))} pages, {len(faults)} faults")
    return 1 if faults or examples else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
