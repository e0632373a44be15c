"""`mesotap crate`: held against RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) and against its own hashes."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import urllib.parse

import pytest

from tests.mesotap.catalogue.lab import filed, results, session
from tests.mesotap.test_cli import mesotap, refused


@pytest.fixture
def lab(tmp_path):
    filed(tmp_path / "lab" / "dry", session("steel", config="mesotap: {specimen: steel}\n", seed=1))
    filed(tmp_path / "lab" / "wörn 2", session("brass", seed=2), results(k_c=9e6))
    again = tmp_path / "lab" / "dry" / "reanalysis" / "0123"
    again.mkdir(parents=True)
    (again / "results.json").write_text(json.dumps(results(k_c=5.1e6)))
    return tmp_path / "lab"


def graph_of(crate) -> dict:
    metadata = json.loads((crate / "ro-crate-metadata.json").read_text())
    assert metadata["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    entities = {entity["@id"]: entity for entity in metadata["@graph"]}
    assert len(entities) == len(metadata["@graph"])
    return entities


def references(value) -> list[str]:
    if isinstance(value, dict):
        return [value["@id"]] if set(value) == {"@id"} else []
    return [found for one in value for found in references(one)] if isinstance(value, list) else []


def test_it_says_what_the_specification_asks_for(lab, tmp_path):
    crate = tmp_path / "crate"
    mesotap(
        "crate", lab / "dry", lab / "wörn 2", "-o", crate, "--license", "https://creativecommons.org/licenses/by/4.0/"
    )
    entities = graph_of(crate)
    descriptor, root = entities["ro-crate-metadata.json"], entities["./"]
    assert descriptor["@type"] == "CreativeWork"
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert descriptor["about"] == {"@id": "./"}
    assert root["@type"] == "Dataset"
    assert {"name", "description", "datePublished", "license"} <= root.keys()
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", root["datePublished"])
    for entity in entities.values():
        assert {"@id", "@type"} <= entity.keys()
        for key, value in entity.items():
            for reference in references(value):
                assert reference in entities or reference.startswith("https://w3id.org/"), (key, reference)
    files = {name for name, entity in entities.items() if entity["@type"] == "File"}
    reached, waiting = set(), ["./"]
    while waiting:
        for part in references(entities[waiting.pop()].get("hasPart", [])):
            reached.add(part)
            waiting.append(part)
    assert files <= reached
    for name in files:
        content = (crate / urllib.parse.unquote(name)).read_bytes()
        assert entities[name]["sha256"] == hashlib.sha256(content).hexdigest()
        assert entities[name]["contentSize"] == str(len(content))


def test_it_has_everything_to_check_an_answer(lab, tmp_path):
    crate = tmp_path / "crate"
    answer = json.loads(mesotap("crate", lab / "dry", "-o", crate, "--json", "-").stdout)
    assert set(answer["files"]) == {
        *("dry/session.h5", "dry/config.yaml", "dry/results.json", "dry/reanalysis/0123/results.json"),
        *("ro-crate-metadata.json", "manifest-sha256.txt"),
    }
    assert (crate / "dry" / "config.yaml").read_text() == "mesotap: {specimen: steel}\n"
    assert (crate / "dry" / "session.h5").read_bytes() == (lab / "dry" / "session.h5").read_bytes()
    entities = graph_of(crate)
    (value,) = (e for e in entities.values() if e.get("propertyID") == "contact_stiffness_n_per_m")
    assert (value["value"], value["unitText"]) == (5.1e6, "N/m")
    assert entities["#analysis-0"]["result"] == {"@id": "dry/reanalysis/0123/results.json"}
    if shutil.which("sha256sum"):
        subprocess.run(
            ["sha256sum", "-c", "--strict", "manifest-sha256.txt"], cwd=crate, check=True, capture_output=True
        )


def test_a_selection_is_packed_and_nothing_is_written_over(lab, tmp_path):
    index = ("--index", tmp_path / "i.sqlite")
    mesotap("crate", "--in", lab, "--where", "kc:8..", *index, "-o", tmp_path / "crate")
    folders = [p.name for p in (tmp_path / "crate").iterdir() if p.is_dir()]
    assert folders == ["w-rn-2"]
    assert "exists already" in refused("crate", lab / "dry", "-o", tmp_path / "crate")
    assert "nothing to write" in refused("crate", "--where", "kc:99..", *index, "-o", tmp_path / "other")
    assert "is not a session" in refused("crate", lab, "-o", tmp_path / "other")
    assert "name sessions, or ask" in refused("crate", "-o", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_copy_is_packed_once(lab, tmp_path):
    shutil.copytree(lab / "dry", tmp_path / "copied")
    done = mesotap("crate", lab / "dry", tmp_path / "copied", "-o", tmp_path / "crate")
    assert "is a copy of" in done.stdout
    assert "crate: 1 session, " in done.stdout
