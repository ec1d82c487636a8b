# `make demo`, `make test` and `make test-long` do all their own set-up on a machine that has Python 3.11+ and make.
PYTHON ?= python3
BIN := .venv/bin

# compiled files are kept whatever the shell says (without them each of the gate's processes compiles every file
# again), and linear algebra has one thread, as under the command
export PYTHONDONTWRITEBYTECODE :=
export OPENBLAS_NUM_THREADS := 1

# glibc gives freed memory back to the system and asks for it anew, for each large array; tests do without
KEEP := MALLOC_MMAP_THRESHOLD_=268435456 MALLOC_TRIM_THRESHOLD_=1073741824
PYTEST := $(KEEP) $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder --durations=30 --durations-min=0.5

.PHONY: demo test test-long types install bench docs gallery format fuzz wheels clean

demo: .venv/demo
	$(BIN)/unseen demo -o out/demo

# types and import contracts are checked while loops are compiled, which keeps one core busy, and beside the
# tests; what they say comes after them
test: .venv/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@said=$$(mktemp); $(MAKE) --no-print-directory types >$$said 2>&1 & types=$$!; \
	$(MAKE) --no-print-directory .venv/warm && echo "$(PYTEST)" && $(PYTEST); tests=$$?; \
	wait $$types; held=$$?; cat $$said; rm $$said; test $$tests -eq 0 -a $$held -eq 0

types: .venv/dev
	$(BIN)/mypy
	$(BIN)/lint-imports

# what is long by nature (CONTRIBUTING.md), before an issue is resolved
test-long: .venv/warm
	$(PYTEST) -m long
	$(MAKE) --no-print-directory docs
	$(BIN)/python examples/gallery.py
	$(BIN)/python -m tests.robustness.fuzzing --files $(N) --seconds $(SECONDS)

install: .venv/dev

bench: .venv/bench
	for suite in $(SUITES); do $(BIN)/python -m benchmarks run $$suite || exit 1; done

# all suites: python -m benchmarks list
SUITES ?= rays texture-speed e57 stations frames segmentation

# so long at most, and so many files for each reader; half the time again where atheris is installed
SECONDS ?= 300
N ?= 20000

# the wheel, installed and tested under every Python that is here
PYTHONS ?= python3.11 python3.12 python3.13 python3.14
wheels: .venv/dev
	rm -rf out/wheels && mkdir -p out/wheels
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir out/wheels .
	for python in $(PYTHONS); do \
	  $$python --version || continue; \
	  mkdir out/wheels/$$python && cp -r tests examples benchmarks docs *.md pyproject.toml out/wheels/$$python && \
	  $$python -m venv out/wheels/$$python/.venv && \
	  out/wheels/$$python/.venv/bin/pip install --quiet "$$(ls out/wheels/*.whl)[all]" pytest hypothesis && \
	  (cd out/wheels/$$python && UNSEEN_DATA=$${UNSEEN_DATA:-$(CURDIR)/../shared/data} \
	    .venv/bin/python -m pytest -q tests/scenes tests/texture) || exit 1; \
	done

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
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[e57,pcd,las]'
	touch $@

.venv/dev: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[dev]'
	touch $@ .venv/demo

# loops that changed are compiled before any test that allows a command some seconds
.venv/warm: .venv/dev $(shell find scenes texture completion nbv -name '*.py')
	$(BIN)/unseen warm --quiet
	touch $@

.venv/bench: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	touch $@ .venv/dev .venv/demo

.venv/docs: pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	touch $@

clean:
	rm -rf out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
