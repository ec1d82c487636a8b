# `make demo` and `make test` do all their own set-up on a machine that has Python 3.11+ and make.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test install bench docs gallery format fuzz clean

demo: .venv/demo
	$(BIN)/unseen demo -o out/demo

test: .venv/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2 --dist loadfile

install: .venv/dev

bench: .venv/bench
	$(BIN)/python benchmarks/rays.py
	$(BIN)/python benchmarks/scans.py
	$(BIN)/python benchmarks/textures.py
	$(BIN)/python benchmarks/reports.py
	$(BIN)/python benchmarks/cluster.py
	$(BIN)/python -m pytest benchmarks --benchmark-only

# so long at most, and so many files for each reader; half the time again where atheris is installed
SECONDS ?= 300
N ?= 20000

fuzz: .venv/dev
	$(BIN)/python -m tests.robustness.fuzzing --files $(N) --seconds $(SECONDS) --guided $$(( $(SECONDS) / 2 ))

docs: .venv/docs
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -c docs . out/site
	@echo "open out/site/index.html"

gallery: .venv/dev
	$(BIN)/python examples/gallery.py

format: .venv/dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

.venv/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("unseen needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try: make PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv

.venv/demo: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[e57,pcd,las]'
	touch $@

.venv/dev: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@ .venv/demo

.venv/bench: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	touch $@ .venv/dev .venv/demo

.venv/docs: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	touch $@

clean:
	rm -rf out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
