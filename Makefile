# Everything a person does here. `make session` and `make test` need only Python 3.11+ and make.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup session test test-all check docs bench soak fuzz lock clean

setup: .venv/.ready

.venv/.ready: pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Entoptic needs Python 3.11 or newer; run: make PYTHON=python3.12")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install -q --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

session: setup
	$(BIN)/entoptic session

test: setup
	$(BIN)/pytest -n auto --dist loadfile --no-loadscope-reorder

test-all: setup
	$(BIN)/pytest -m ''

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/check-jsonschema -q --builtin-schema vendor.compose-spec docker-compose.yml

# The tables in docs/ that say what the records say.
docs: setup
	$(BIN)/python docs/observer_file.py

bench: setup
	$(BIN)/python -m benchmarks

# One bridge through every fault of the stand-in for Pupil Capture: ten minutes.
soak: setup
	$(BIN)/python -m benchmarks.soak

# Linux alone: atheris has wheels for nothing else.
fuzz: setup
	$(BIN)/python -m pip install -q --disable-pip-version-check atheris
	$(BIN)/python tests/fuzz/run.py

lock: setup
	$(BIN)/pip-compile -q --extra dev --strip-extras --no-emit-index-url --no-emit-trusted-host --no-emit-find-links --no-emit-options --no-header --no-annotate --upgrade -o requirements.lock pyproject.toml

clean:
	rm -rf .venv build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
