# All targets use .venv. `make setup` creates it; the other targets update it when the lock file has changed.

PYTHON ?= python3.11
BIN := .venv/bin
# OpenGL without a screen for the cell's pictures; for the tests a browser and what librealsense is linked to.
SYSTEM_PACKAGES := libegl1 libgl1-mesa-dri chromium libusb-1.0-0

.PHONY: help setup system-packages demo test test-all test-peers check docs references lock clean
.DEFAULT_GOAL := help

help:
	@echo "make demo     run the whole loop in a simulated cell, with the browser viewer"
	@echo "make test     run the tests that guard behaviour"
	@echo "make test-all run the long tests as well"
	@echo "make test-peers  run drivers against simulators of their devices, and exports through LeRobot; installs both (9 GB)"
	@echo "make check    check style, strict types and layers"
	@echo "make setup    create .venv and install the system packages"
	@echo "make docs     build the documentation as a site, in site/"
	@echo "make references  record the runs of tests/replay again, after an intended change"
	@echo "make lock     update requirements.lock from pyproject.toml"
	@echo "make clean    delete all generated files"

setup: .venv/.ready

.venv/.ready: requirements.lock pyproject.toml | system-packages
	@echo "step 2 of 4: creating the virtual environment .venv"
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "step 3 of 4: installing the Python packages of requirements.lock (some minutes)"
	@.ci/python-packages $(BIN)/python requirements.lock
	@echo "step 4 of 4: installing dlokit"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	# Compile now: many container images disable bytecode files, and each process would otherwise compile dlokit again.
	$(BIN)/python -m compileall -q src
	touch $@

system-packages:
	@test -e .venv/.ready || echo "step 1 of 4: installing the missing system packages"
	@PYTHON=$(PYTHON) .ci/system-packages $(SYSTEM_PACKAGES)

demo: setup
	$(BIN)/dlokit demo

# Tests of live systems run one at a time (`tests/conftest.py`), in parallel with the other tests.
PYTEST := $(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadgroup

test: setup
	$(PYTEST)

test-all: setup
	$(PYTEST) -m "not peers"

# Not in CI: franky-sim brings 0.5 GB, LeRobot 8, and the real-time tests want a quiet machine. franka-sim and LeRobot need
# other versions of packages than dlokit.
test-peers: setup .venv-franka-sim/.ready .venv-lerobot/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check franky-sim==1.0.4
	$(BIN)/pytest --numprocesses 0 -m peers tests/peers

.venv-franka-sim/.ready:
	test -x .venv-franka-sim/bin/python || $(PYTHON) -m venv .venv-franka-sim
	.venv-franka-sim/bin/python -m pip install --quiet --disable-pip-version-check \
		franka-sim==1.1.7 mujoco==3.2.7 numpy==1.26.4
	touch $@

# On Linux pip takes a torch for CUDA, 3 GB to download and 8 GB on the disk. For 1 GB, without a GPU:
# PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make test-peers
.venv-lerobot/.ready:
	test -x .venv-lerobot/bin/python || $(PYTHON) -m venv .venv-lerobot
	.venv-lerobot/bin/python -m pip install --quiet --disable-pip-version-check lerobot==0.4.4
	touch $@

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

references: setup
	$(BIN)/python tests/replay/renew_references.py

lock:
	@command -v uv >/dev/null || { echo "make lock needs uv: python3 -m pip install --user uv"; exit 1; }
	uv pip compile --universal --all-extras --no-header --no-annotate --no-emit-index-url --generate-hashes -o requirements.lock pyproject.toml

clean:
	rm -rf .venv .venv-franka-sim .venv-lerobot site .pytest_cache .ruff_cache .import_linter_cache build dist
	find src tests examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
