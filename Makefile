# Two commands on a fresh machine with Python 3.11: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := demo
SEED := 1

.PHONY: demo readme test test-ci test-all check lint types layers kills recovery gauges bench streaming fuzz fuzz-hypothesis faults faults-table hostile proof witness package docs clean
.PHONY: console-stop console-kills console-axe console-soak console-pictures

demo: $(VENV)/.installed
	rm -rf $(DEMO)
	$(BIN)/mesotap run --simulate --seed $(SEED) --config config.yaml --output $(DEMO)/session --json $(DEMO)/results.json
	$(BIN)/mesotap published --report $(DEMO)/published --json $(DEMO)/published.json
	@echo
	@echo "The session's report:          $(CURDIR)/$(DEMO)/session/report.html"
	@echo "The published tables, anew:    $(CURDIR)/$(DEMO)/published/report.html"

# without the tests marked slow or long; neighbours stay with one worker as long as both have work, so that what a module or a
# session sets up is set up once
PYTEST := $(BIN)/python -m pytest -n 2 --dist worksteal

# seconds after which a test has failed and says where it stands, rather than keeping all others waiting
STUCK := 900

test: $(VENV)/.tested
	$(PYTEST) --timeout $(STUCK) -m "not slow and not long" tests

# what continuous integration runs: the quick tests, and of the slow ones those whose turn it is by the second of the commit
TURNS := 6
TURN = $(shell git log -1 --format=%ct 2>/dev/null || echo 0)
test-ci: $(VENV)/.tested
	MESOTAP_TURN=$(TURN)/$(TURNS) $(PYTEST) --timeout $(STUCK) --durations 20 -m "not long" tests

test-all: $(VENV)/.tested
	$(PYTEST) tests

# every line of the README's blocks from the first session on, as it stands and in order, in a clone of what is committed and
# after `make demo` there; each line's time is printed
readme: $(VENV)/.tested
	MESOTAP_README=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -s -n 0 tests/mesotap/test_readme.py

# everything that continuous integration holds against a change
check: lint types layers test-ci

lint: $(VENV)/.tested
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.tested
	$(BIN)/mypy

layers: $(VENV)/.tested
	$(BIN)/lint-imports

# 200 sessions ended at random moments and resumed: a third by SIGKILL on the simulated rig, the others by SIGKILL and by
# other signals on emulated devices that outlive them, with the guardian
kills: $(VENV)/.tested
	MESOTAP_KILLS=66 $(BIN)/python -m pytest tests/mesotap/session/test_killed.py
	MESOTAP_GUARDED_KILLS=134 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -s tests/mesotap/session/test_guardian.py

# STOP in the page of the console, 50 times, until the stage is told to go back (half an hour)
console-stop: $(VENV)/.tested
	MESOTAP_STOPS=50 $(BIN)/python -m pytest -s -n 0 tests/mesotap/console/test_stop.py

# the console's pages through axe-core, which is fetched from the npm registry into a folder outside this one
AXE ?= $(HOME)/.cache/mesotap-axe
console-axe: $(VENV)/.tested
	npm install --silent --no-save --prefix $(AXE) axe-core@4.14.1
	MESOTAP_AXE=$(AXE) $(BIN)/python -m pytest -rs -n 0 tests/mesotap/console/test_accessible.py

# the console killed ten times in every state, each session resumed (an hour)
console-kills: $(VENV)/.tested
	MESOTAP_CONSOLE_KILLS=10 $(BIN)/python -m pytest -s -n 0 tests/mesotap/console/test_kills.py

# the pictures of docs/console, of sessions that run (some minutes)
PICTURES :=
console-pictures: $(VENV)/.tested
	$(BIN)/python -m tests.mesotap.console.pictures $(PICTURES)

# an hour of sessions in the console, one page that drives and three that watch: memory, and how late what comes
console-soak: $(VENV)/.tested
	$(BIN)/python -m benchmarks.console_soak --minutes $(or $(MINUTES),60)

# 200 seeded loads: does every interval cover as often as it says?
recovery: $(VENV)/.installed
	$(BIN)/python benchmarks/recovery.py

# loads of a gauge that is bowed, drifts, has hysteresis, and of weights that are off: does their interval cover?
gauges: $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/gauge_intervals.py

# an hour of the recorder's stream, emulated: lost samples, processor time, memory
streaming: $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/streaming.py

# random fault schedules over whole sessions with the drivers on emulated devices (ten minutes)
SCHEDULES := 2000
faults: $(VENV)/.tested
	MESOTAP_FAULT_SCHEDULES=$(SCHEDULES) OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 tests/faults/test_schedules.py

# docs/faults.md, written by what happens
faults-table: $(VENV)/.tested
	MESOTAP_WRITE_FAULTS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest tests/faults/test_table.py -k page_holds

# drivers that others wrote for the same devices, at the emulated ones, in a virtualenv of its own
witness: .venv-witness/.installed
	OPENBLAS_NUM_THREADS=1 .venv-witness/bin/python -m pytest -rs tests/sim_backend/emulators/test_newport_by_others.py

.venv-witness/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-witness
	.venv-witness/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev,witness]'
	touch $@

# damaged files, configurations and replies, FUZZ of each kind, drawn plainly at random; another FUZZ_SEED makes others
# (two hours); FUZZ_TARGET is all, a module of tests/fuzz or one kind, as exchange.damaged_tables
FUZZ := 100000
FUZZ_SEED := 1
FUZZ_TARGET := all
fuzz: $(VENV)/.tested
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz.plain $(FUZZ_TARGET) --inputs $(FUZZ) --seed $(FUZZ_SEED)

# the same kinds drawn by hypothesis, which makes a failing input small (a day for 100,000 of each)
fuzz-hypothesis: $(VENV)/.tested
	MESOTAP_FUZZ=$(FUZZ) MESOTAP_FUZZ_SEED=$(FUZZ_SEED) OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 tests/fuzz/test_hypothesis.py

# hostile files, folders and configurations through the command line; docs/hostile.md is written by what becomes of them
hostile: $(VENV)/.tested
	MESOTAP_WRITE_HOSTILE=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.hostile.corpus

# the diagnosis on sealed sessions (hours; an interrupted proof goes on where it stopped)
PROOF_SEED := 1
PROOF_SESSIONS := 300
proof: $(VENV)/.installed
	$(BIN)/mesotap prove --seed $(PROOF_SEED) --sessions $(PROOF_SESSIONS) --output docs/proof

# modal identification against the Cramer-Rao bound and beside other programs, in a virtualenv of its own; intervals on
# any recording; time and memory of a diagnosis; error and time of the propagator
bench: .venv-bench/.installed
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python benchmarks/modal.py $(BENCH_ARGS)
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python benchmarks/session_speed.py --write
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python benchmarks/recordings.py --write
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python benchmarks/harsh_taps.py --write
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python benchmarks/diagnosis.py
	OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python -m benchmarks.propagate

.venv-bench/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	touch $@

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV) || { echo "mesotap: '$(PYTHON) -m venv' failed; on Debian: apt-get install python3-venv" >&2; rm -rf $(VENV); exit 2; }

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	$(BIN)/python -m mesotap.compiled
	touch $@

$(VENV)/.tested: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	$(BIN)/python -m mesotap.compiled
	touch $(VENV)/.installed $@

# wheel and sdist, each built, installed in an environment that holds nothing else, and used away from this folder
package: $(VENV)/.tested
	rm -rf dist build .venv-package
	$(BIN)/python -m build --quiet
	set -e; bin=$(CURDIR)/.venv-package/bin; for file in $(CURDIR)/dist/*.whl $(CURDIR)/dist/*.tar.gz; do \
	echo "$$file"; rm -rf .venv-package; $(PYTHON) -m venv .venv-package; \
	$$bin/python -m pip install --quiet --disable-pip-version-check $$file; \
	(cd $$(mktemp -d); \
	$$bin/mesotap --version; $$bin/mesotap config init; $$bin/mesotap config check; \
	$$bin/mesotap simulate tap.h5 --seed 1; $$bin/mesotap analyze tap.h5; \
	$$bin/python -c "import mesotap; print(mesotap.read_session('tap.h5').impacts[0].acceleration.shape)"); done

# the documentation as a site in site/, from the pages in docs/ and the docstrings; links and examples are checked
docs: $(VENV)/.documented
	rm -rf site jupyter_execute
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -q -W --keep-going -b html -d build/docs docs site
	OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/_site/check.py site
	@echo "$(CURDIR)/site/index.html"

$(VENV)/.documented: $(VENV)/.tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,docs]'
	touch $@

clean:
	rm -rf $(VENV) site jupyter_execute .venv-bench .venv-witness .venv-package $(DEMO) build dist *.egg-info .mypy_cache .ruff_cache .hypothesis .import_linter_cache
