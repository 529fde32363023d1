# All targets use .venv. `make setup` creates it; the other targets update it when the lock file has changed.

# The newest of Python 3.11 to 3.13 on the PATH that can make an environment; PYTHON=… chooses another.
PYTHON ?= $(shell .ci/pythons --first 2>/dev/null)
BIN := .venv/bin
# OpenGL without a screen for the cell's pictures: those that `dlokit doctor` names.
SYSTEM_PACKAGES := libegl1 libopengl0 libgl1-mesa-dri
# A browser, an encoder of videos, and what librealsense and pyright are linked to or run in.
TEST_PACKAGES := chromium ffmpeg libusb-1.0-0 nodejs
# What makes a network of its own for the nodes of ROS 2.
ROS_PACKAGES := iproute2

.PHONY: help setup system-packages test-packages demo test test-all test-long test-documents test-pythons smoke-pythons \
	test-peers test-ros smoke-ros ros-packages check docs references lock clean
.DEFAULT_GOAL := help

help:
	@echo "make demo     run the whole loop in a simulated cell, with the browser viewer"
	@echo "make test     run the tests that guard behaviour, in virtual time, and a few live ones"
	@echo "make test-all run the live tests as well: processes, sockets, browser, fakes of devices; and the heavy ones"
	@echo "make test-long   run what takes minutes: documents as code, studies, every fault, an installed wheel"
	@echo "make test-pythons  run the tests in virtual time on every Python from 3.11 to 3.13 of this machine"
	@echo "make test-peers  run drivers against simulators of their devices, and exports through LeRobot; installs both (9 GB)"
	@echo "make test-ros  run what speaks ROS 2 with real nodes of two distributions; installs both (0.8 GB)"
	@echo "make smoke-ros  run the short half of them, with one distribution (0.3 GB)"
	@echo "make check    check style, strict types and layers"
	@echo "make setup    create .venv and install the system packages of the demo"
	@echo "make docs     build the documentation as a site, in site/"
	@echo "make references  record the runs of tests/replay again, after an intended change"
	@echo "make lock     update requirements.lock from pyproject.toml"
	@echo "make clean    delete all generated files"

setup: .venv/.ready

.venv/.ready: requirements.lock pyproject.toml | system-packages
	@echo "step 2 of 4: creating the virtual environment .venv"
	@test -x $(BIN)/python || test -n "$(PYTHON)" || .ci/pythons --first
	test -x $(BIN)/python || "$(PYTHON)" -m venv .venv
	@echo "step 3 of 4: installing the Python packages of requirements.lock (some minutes)"
	@.ci/python-packages $(BIN)/python requirements.lock
	@echo "step 4 of 4: installing dlokit"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	# Compile now: many container images disable bytecode files, and each process would otherwise compile dlokit again.
	$(BIN)/python -m compileall -q src
	touch $@

system-packages:
	@test -e .venv/.ready || echo "step 1 of 4: installing the missing system packages"
	@PYTHON="$(PYTHON)" .ci/system-packages $(SYSTEM_PACKAGES)

test-packages: setup
	@PYTHON="$(PYTHON)" .ci/system-packages $(TEST_PACKAGES)

demo: setup
	$(BIN)/dlokit demo

# Rooms of tests: tests/conftest.py. Live tests run one at a time, first, in parallel with the others.
PYTEST_OPTIONS := --numprocesses auto --maxprocesses 4 --dist loadgroup --no-loadscope-reorder
# Many container images disable bytecode files; without them each process would compile all tests again.
export PYTHONDONTWRITEBYTECODE :=
PYTEST := $(BIN)/pytest $(PYTEST_OPTIONS)
PURE := not live and not long and not peers and not ros
DOCUMENTS := $(addprefix tests/long/test_,documentation_code.py example_package.py examples_run.py python_api_page.py \
	readme_commands.py tutorial_scripts.py)

test: test-packages
	$(PYTEST)

test-all: test-packages
	$(PYTEST) -m "not long and not peers and not ros"

test-long: test-packages
	$(PYTEST) -m long

# What runs the documents, the examples and the tutorials as code.
test-documents: test-packages
	$(PYTEST) -m long $(DOCUMENTS)

# One Python a line: a path may have blanks.
EACH_PYTHON := pythons=$$(.ci/pythons); IFS=$$(printf '\n\t'); for python in $$pythons;

# One environment for each Python, .venv-3.12 and so on, besides .venv.
test-pythons: test-packages
	@set -e; $(EACH_PYTHON) do \
		environment=$$(.ci/environment "$$python"); \
		echo "$$($$environment/bin/python --version):"; \
		$$environment/bin/pytest $(PYTEST_OPTIONS) -m "$(PURE)"; \
	done

# A rope is shaped in lockstep, and its recording is read, exported and replayed, on each Python.
smoke-pythons: setup
	@set -e; $(EACH_PYTHON) do \
		environment=$$(.ci/environment "$$python"); dlokit="$$PWD/$$environment/bin/dlokit"; run=$$(mktemp -d); \
		echo "$$($$environment/bin/python --version): a rope is shaped in lockstep; its recording is read, exported, replayed"; \
		(cd "$$run" && set -x && "$$dlokit" shape --headless --seed 3 --out run && "$$dlokit" info run && \
			"$$dlokit" export run --to csv --out csv && "$$dlokit" export run --to lerobot --no-images --out lerobot && \
			"$$dlokit" replay run --into observer) >"$$run/log" 2>&1 || { cat "$$run/log"; exit 1; }; \
		rm -r "$$run"; \
	done

# Not in CI: franky-sim brings 0.5 GB, LeRobot 8, and the real-time tests want a quiet machine. franka-sim and LeRobot need
# other versions of packages than dlokit.
test-peers: test-packages .venv-franka-sim/.ready .venv-lerobot/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check franky-sim==1.0.4
	$(BIN)/pytest --numprocesses 0 -m peers tests/peers

.venv-franka-sim/.ready:
	test -x .venv-franka-sim/bin/python || "$(PYTHON)" -m venv .venv-franka-sim
	.venv-franka-sim/bin/python -m pip install --quiet --disable-pip-version-check \
		franka-sim==1.1.7 mujoco==3.2.7 numpy==1.26.4
	touch $@

# On Linux pip takes a torch for CUDA, 3 GB to download and 8 GB on the disk. For 1 GB, without a GPU:
# PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make test-peers
.venv-lerobot/.ready:
	test -x .venv-lerobot/bin/python || "$(PYTHON)" -m venv .venv-lerobot
	.venv-lerobot/bin/python -m pip install --quiet --disable-pip-version-check \
		"lerobot==0.4.4; python_version < '3.12'" "lerobot[dataset]==0.6.1; python_version >= '3.12'"
	touch $@

# rclpy from the package index, in environments of its own: nothing of dlokit is in them, and nothing of ROS in .venv.
ros-packages: test-packages
	@PYTHON="$(PYTHON)" .ci/system-packages $(ROS_PACKAGES)

test-ros: ros-packages
	.ci/ros-environment jazzy .venv-ros-jazzy --interfaces
	.ci/ros-environment kilted .venv-ros-kilted --interfaces
	$(BIN)/pytest --numprocesses 0 -m ros tests/ros

smoke-ros: ros-packages
	.ci/ros-environment jazzy .venv-ros-jazzy
	$(BIN)/pytest --numprocesses 0 -m "ros and smoke" tests/ros

check: test-packages
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
	rm -rf .venv .venv-* site .pytest_cache .ruff_cache .import_linter_cache build dist
	find src tests examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
