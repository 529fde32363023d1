# Everything runs in .venv, which `make setup` makes and every other target renews when the lock file has changed.

PYTHON ?= python3.11
BIN := .venv/bin
# OpenGL without a screen for the cell's pictures; a browser for the tests of the viewer.
SYSTEM_PACKAGES := libegl1 libgl1-mesa-dri chromium

.PHONY: help setup system-packages demo test test-all check references lock clean
.DEFAULT_GOAL := help

help:
	@echo "make demo     the whole loop in a simulated cell, with the browser viewer"
	@echo "make test     the tests that guard behaviour"
	@echo "make test-all the long ones as well"
	@echo "make check    style, strict types, layers"
	@echo "make setup    .venv and the system packages, for all of the above"
	@echo "make references  the recorded runs of tests/replay anew, after a change that is meant"
	@echo "make lock     requirements.lock anew, from pyproject.toml"
	@echo "make clean    everything that can be made again"

setup: .venv/.ready

.venv/.ready: requirements.lock pyproject.toml | system-packages
	@echo "step 2 of 4: the virtual environment .venv"
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "step 3 of 4: the Python packages of requirements.lock, some minutes"
	@.ci/python-packages $(BIN)/python requirements.lock
	@echo "step 4 of 4: dlokit itself"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	# Where Python is told to write no bytecode, as in many images, every process would compile dlokit anew.
	$(BIN)/python -m compileall -q src
	touch $@

system-packages:
	@test -e .venv/.ready || echo "step 1 of 4: the system packages that are missing"
	@PYTHON=$(PYTHON) .ci/system-packages $(SYSTEM_PACKAGES)

demo: setup
	$(BIN)/dlokit demo

# Those of live systems run one at a time (`tests/conftest.py`), the others beside them.
PYTEST := $(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadgroup

test: setup
	$(PYTEST)

test-all: setup
	$(PYTEST) -m ""

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

references: setup
	$(BIN)/python tests/replay/renew_references.py

lock:
	@command -v uv >/dev/null || { echo "make lock needs uv: python3 -m pip install --user uv"; exit 1; }
	uv pip compile --universal --all-extras --no-header --no-annotate --no-emit-index-url -o requirements.lock pyproject.toml

clean:
	rm -rf .venv .pytest_cache .ruff_cache .import_linter_cache build dist
	find src tests examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
