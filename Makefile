# `make demo` and `make test` set everything up in .venv; nothing else needs to be installed.
# Another interpreter: make test PYTHON=python3.13. On Windows see docs/how-to/install.md.
FITS = import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
PYTHON ?= $(or $(shell for p in python3 python3.13 python3.12 python3.11; do \
  $$p -c '$(FITS)' 2>/dev/null && echo $$p && break; done),python3)
VENV := .venv
BIN := $(VENV)/bin
RUNTIME := $(VENV)/.runtime-installed
TESTING := $(VENV)/.testing-installed
SITE := $(VENV)/.site-installed
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
PROJECT := pyproject.toml benchtool/__init__.py

.PHONY: demo test test-all proof lint docs bench blind presses soak mutants coverage-truth kills fuzz requirements wheel clean faults peers

demo: $(RUNTIME)
	$(BIN)/benchtool demo

# CONTRIBUTING.md lists content and duration of each target.
PYTEST := $(BIN)/python -m pytest
PARALLEL := -n logical --dist worksteal
RESULTS := build/tests

# A worker a core, and one thread for the algebra of each: more of them wait for each other.
test test-all: export OPENBLAS_NUM_THREADS = 1
# Workers, stages and commands compile each module once.
test test-all: export PYTHONDONTWRITEBYTECODE =

test: $(TESTING)
	$(PYTEST) $(PARALLEL) -m "not slow and not proof" --junitxml $(RESULTS)/test.xml

# What talks to something in real time runs alone: on a busy machine it could only say so.
test-all: test
	$(PYTEST) $(PARALLEL) -m "slow and not alone and not proof" --junitxml $(RESULTS)/slow.xml
	$(PYTEST) -m "slow and alone and not proof" --junitxml $(RESULTS)/alone.xml

# What is run before a release only, beside the counts below: tests/proof/README.md.
proof: $(TESTING)
	$(PYTEST) -m proof tests/proof

lint: $(TESTING)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# These pages as a site, to be opened at build/site/index.html; a warning is an error.
docs: $(SITE)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build

# One table of all benchmarks, medians of five; nothing here passes or fails. ONLY="fit link": some.
# BESIDE=COMMIT: the same rows of another commit in turns. PAGE=1: write the page, measure nothing.
# TIMES=1: once in place of five times.
bench: $(TESTING)
	$(BIN)/python -m tests.proof.benchmarks.table $(ONLY) \
	  $(if $(BESIDE),--beside $(BESIDE)) $(if $(TIMES),--times $(TIMES)) $(if $(PAGE),--page)

# STOP on the page, PRESSES times in every way while motors turn; goes on where it was cut short.
PRESSES ?= 1000
presses: $(TESTING)
	$(BIN)/python -m tests.proof.presses.presses --presses $(PRESSES)

# Sweeps with random faults on every link for MINUTES; 0 rows lost, no motor without a host, no leak.
soak: $(TESTING)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.proof.soak.soak --minutes $(or $(MINUTES),60)

# Every cell of the fault matrix, and the table of stop times; cut short, it goes on where it was.
faults: $(TESTING)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.faults.matrix

# How to run real firmware beside the tests; builds nothing.
peers:
	@sed -n '/^## Tests with real firmware/,$$p' CONTRIBUTING.md | sed -E \
	  -e '/^(<!--|```)/d' -e 's/^## //' -e 's/\[([^]]*)\]\([^)]*\)/\1/g' -e 's/`//g' | cat -s

# How often the intervals hold the truth over 400 simulated sweeps of each kind: every basis, both
# estimators, budgets, calibrations, places, wander (takes hours; cut short, it goes on where it was).
coverage-truth: $(TESTING)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.proof.truth.count $(WORKERS)

# How often `benchtool explain` is right, on records with hidden effects: of our own generators, and
# of those beside the reference data where there are any. Takes hours; cut short, it goes on where it was.
# CLUSTER=tcp://HOST:8786: on the workers of a Dask scheduler, started in this folder.
WORKERS := $(if $(CLUSTER),--cluster $(CLUSTER))

blind: $(TESTING)
	@if [ -n "$$BENCHTOOL_REFERENCE_DATA" ]; then for bench in sweeps pitch; do \
	  OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.proof.blind.score_foreign $$bench \
	    $(WORKERS) --scoring --page build/scorecard-foreign-$$bench.md || exit 1; done; fi
	@for bench in single quad pitch; do OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
	  $(BIN)/python -m tests.proof.blind.score_virtual $$bench $(WORKERS) --scoring --page build/scorecard-virtual-$$bench.md || exit 1; done
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.proof.blind.score_pitch $(WORKERS) --scoring --page build/scorecard-pitch.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.proof.blind.score_sweep $(WORKERS) --scoring --page build/scorecard-sweep.md

# Lines of the product broken one by one: which does no test notice? MODULE= a group of modules
# (guard, limits, ...), COUNT= so many more of each, SEED= which. None is judged twice.
mutants: $(TESTING)
	@$(BIN)/python -m tests.proof.mutation.run --check $(MODULE)
	@$(BIN)/python -c "import cosmic_ray" 2>/dev/null || { echo "installing cosmic-ray into $(VENV)"; \
	  $(PIP) install "cosmic-ray==8.7.0"; }
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m tests.proof.mutation.run $(MODULE) \
	  $(if $(COUNT),--count $(COUNT)) $(if $(SEED),--seed $(SEED))

# A kill and power cuts before every change of the disk that each command makes.
kills: $(TESTING)
	$(BIN)/python -m tests.proof.kills.count

# Hostile bytes for every parser, MINUTES=n long; counts and what was found are in build/fuzz.
fuzz: $(TESTING)
	@$(BIN)/python -c "import atheris" 2>/dev/null || { echo "installing atheris into $(VENV)"; \
	  $(PIP) install "atheris==3.0.0" || true; }
	$(BIN)/python -m tests.proof.fuzz.run $(or $(MINUTES),10)

wheel: $(TESTING)
	$(BIN)/python -m pip --disable-pip-version-check wheel --quiet --no-deps \
	  --no-build-isolation --wheel-dir dist .

# Needs uv. The test set is resolved first, so that all files agree on every version.
UV := uv pip compile --quiet --universal --python-version 3.11 \
  --generate-hashes --no-header --no-annotate
WITH := --constraints requirements/test.txt --output-file
requirements:
	$(UV) pyproject.toml --group build --extra test --output-file requirements/test.txt
	$(UV) pyproject.toml --group build --extra fast $(WITH) requirements/run.txt
	$(UV) --group docs $(WITH) requirements/docs.txt

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The project itself comes after its hashed requirements: pip refuses a local folder under hashes.
$(TESTING): $(BIN)/python requirements/test.txt $(PROJECT)
	$(PIP) install --require-hashes --requirement requirements/test.txt
	$(PIP) install --no-deps --no-build-isolation --editable .
	touch $(TESTING) $(RUNTIME)

$(SITE): $(TESTING) requirements/docs.txt
	$(PIP) install --require-hashes --requirement requirements/docs.txt
	touch $(SITE)

# --no-compile: Python compiles what it imports; all files would take 45 s.
$(RUNTIME): $(BIN)/python requirements/run.txt $(PROJECT)
	@echo "Installing benchtool and what it needs into $(VENV); this takes half a minute."
	$(PIP) install --no-compile --require-hashes --requirement requirements/run.txt
	$(PIP) install --no-deps --no-build-isolation --editable .
	touch $(RUNTIME)

$(BIN)/python:
	@$(PYTHON) -c '$(FITS)' || { \
	  echo "Python 3.11 to 3.13 is needed and $(PYTHON) is not; name one: make PYTHON=python3.12"; \
	  exit 1; }
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }
