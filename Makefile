# Everything a person does here. `make session` and `make test` need only Python 3.11+ and make.
ifeq ($(OS),Windows_NT)
PYTHON ?= python
BIN := .venv/Scripts
else
PYTHON ?= python3
BIN := .venv/bin
endif
INSTALL := $(BIN)/python -m pip install -q --disable-pip-version-check
# Names and versions alone: where packages come from is for each machine to say.
COMPILE := $(BIN)/pip-compile -q --strip-extras --no-emit-index-url --no-emit-trusted-host --no-emit-find-links --no-emit-options --no-header --no-annotate

.PHONY: setup developer session test test-all check docs bench soak fuzz lock clean

# What the program needs.
setup: .venv/.ready

.venv/.ready: pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Entoptic needs Python 3.11 or newer; run: make PYTHON=python3.12")'
	$(PYTHON) -m venv .venv
	$(INSTALL) -r requirements.lock
	$(INSTALL) --no-deps --no-build-isolation -e .
	touch $@

# And what tests and checks need.
developer: .venv/.developer

.venv/.developer: .venv/.ready requirements-dev.lock
	$(INSTALL) -r requirements-dev.lock
	touch $@

session: setup
	$(BIN)/entoptic session

test: developer
	$(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder

test-all: developer
	$(BIN)/pytest -m ''

check: developer
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture
	$(BIN)/check-jsonschema -q --builtin-schema vendor.compose-spec docker-compose.yml
	$(BIN)/check-jsonschema -q --builtin-schema vendor.github-workflows .github/workflows/ci.yml
	$(BIN)/check-jsonschema -q --builtin-schema vendor.citation-file-format CITATION.cff

# The tables in docs/ that say what the records say.
docs: setup
	$(BIN)/python docs/observer_file.py

bench: setup
	$(BIN)/python -m benchmarks

# One bridge through every fault of the stand-in for Pupil Capture: ten minutes.
soak: setup
	$(BIN)/python -m benchmarks.soak

# Linux alone: atheris has wheels for nothing else.
fuzz: developer
	$(INSTALL) atheris
	$(BIN)/python tests/fuzz/run.py

# Renews both. What both name has one version.
lock: developer
	$(COMPILE) --upgrade --build-deps-for editable -o requirements.lock pyproject.toml
	$(COMPILE) --upgrade --extra dev -c requirements.lock -o requirements-dev.lock pyproject.toml

clean:
	rm -rf .venv build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
