# One command for everything; `make` alone lists the targets. Each target sets up .venv first when it is missing or old.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test browser faults hostile memory fuzz repairs reproduce figures check format bench lock clean

BIN := .venv/bin
PACKAGES := rled_msgs_py rled_sim rled_agent rled_teleop
# --use-pep517 puts commands into .venv/bin although setup.cfg names lib/<package> for colcon; compat puts the packages
# on the path as folders, which pytest, mypy and a Python started in this folder all need.
EDITABLE := --use-pep517 --no-build-isolation --no-deps --config-settings editable_mode=compat $(PACKAGES:%=-e %)

IS_USABLE := import sys, ensurepip; sys.exit(sys.version_info[:2] != (3, 11))
PYTHON ?= $(shell for each in python3.11 python3; do "$$each" -c "$(IS_USABLE)" 2>/dev/null && echo "$$each" && break; done)
NO_PYTHON = error: Python 3.11 with venv was not found (tried: $(or $(PYTHON),python3.11, python3)); accepted: 3.11, the newest for which \
PyBullet has a wheel; install that (apt install python3.11-venv, or: pyenv install 3.11) or name it: make setup PYTHON=path
NO_PLATFORM = error: this is $(shell uname -sm); accepted: Linux x86_64, for which ROS 2 has wheels; use the Dockerfile instead

help: ## List the targets.
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' Makefile

setup: .venv/packages.stamp ## Make .venv with Python 3.11 from requirements.lock, and the four packages in it.
	@:

.venv/lock.stamp: requirements.lock
	@test "$$(uname -sm)" = "Linux x86_64" || { echo "$(NO_PLATFORM)" >&2; exit 2; }
	@"$(PYTHON)" -c "$(IS_USABLE)" 2>/dev/null || { echo "$(NO_PYTHON)" >&2; exit 2; }
	@$(BIN)/python -c "$(IS_USABLE)" 2>/dev/null || { set -x; "$(PYTHON)" -m venv --clear .venv; }
	$(BIN)/python -m pip install -r requirements.lock
	@touch $@

.venv/packages.stamp: .venv/lock.stamp $(wildcard $(PACKAGES:%=%/setup.py) $(PACKAGES:%=%/setup.cfg))
	$(BIN)/python -m pip install $(EDITABLE)
	@mkdir -p .venv/share/rled_sim && cp rled_sim/package.xml .venv/share/rled_sim  # editable packages have no share
	@ln -sfn ../../lib/python3.11/site-packages/pybullet_data .venv/share/rled_sim/robots
	@touch $@

demo: setup ## Record a demonstration, learn it, drive the robot; results in out/demo.
	$(BIN)/demo $(ARGS)

test: setup ## Run the tests (ARGS="-k bag" chooses some).
	$(BIN)/python -m pytest tests --ignore=tests/bench --ignore=tests/web/test_page.py -n 2 --dist loadfile $(ARGS)

browser: setup ## Run the tests of the page in a headless Chromium (some minutes, on a machine that does nothing else).
	$(BIN)/python -m pytest tests/web/test_page.py $(ARGS)

faults: setup ## Measure the table of faults anew: docs/faults.md.
	RLED_FAULTS=write $(BIN)/python -m pytest tests/faults -k table $(ARGS)
	$(BIN)/python tests/faults/table.py

hostile: setup ## Send more than 30,000 malformed and hostile messages to all nodes (some minutes).
	RLED_HOSTILE=250 $(BIN)/python -m pytest tests/faults -k hostile --timeout 600 $(ARGS)

fuzz: setup ## Mutated inputs to every reader, guided by coverage (MINUTES=5, SEED=, ARGS="mcap_bag urdf").
	$(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),5) --seed $(or $(SEED),0) $(ARGS)

memory: setup ## Flood all nodes with messages of 3 MB for a minute and print what memory they keep.
	$(BIN)/python -m tests.faults.memory $(ARGS)

repairs: setup ## Repair 500 random bags of several makers, and 500 that are damaged.
	RLED_BAGS=500 $(BIN)/python -m pytest tests/rled_msgs_py/test_bag_repair.py -k as_rich --timeout 600 $(ARGS)

reproduce: setup ## Make the missing runs behind the figures of chapter 4 (FIG=4.6: of one, DEVICE=cuda; hours).
	$(BIN)/python -m rled_agent.experiments.reproduce $(FIG) $(if $(DEVICE),--device $(DEVICE)) $(ARGS)

figures: setup ## Draw all figures and write docs/results.md from the runs that are kept.
	$(BIN)/python -m rled_agent.experiments.draw_figures $(FIG)

check: setup ## Lint, formatting, strict types, Dockerfile.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/hadolint Dockerfile

format: setup ## Put the code into the form that `make check` wants.
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: setup ## Measure; figures in out/bench/summary.json.
	$(BIN)/python -m pytest tests/bench -s $(ARGS)

# Local versions (+cpu) and the CUDA packages that PyPI's torch names itself are left out, so the lock fits every machine.
lock: ## Resolve requirements*.txt anew into requirements.lock.
	@"$(PYTHON)" -c "$(IS_USABLE)" 2>/dev/null || { echo "$(NO_PYTHON)" >&2; exit 2; }
	"$(PYTHON)" -m venv --clear out/lock
	out/lock/bin/pip install --quiet pip-tools==7.6.2
	CUSTOM_COMPILE_COMMAND="make lock" out/lock/bin/pip-compile --quiet --upgrade --no-annotate --strip-extras --allow-unsafe \
	    --no-emit-index-url --no-emit-find-links --output-file=out/lock/all requirements-dev.txt
	sed -E '/^(nvidia|cuda|triton)/d; s/\+[a-z0-9.]+$$//' out/lock/all > requirements.lock

clean: ## Remove everything that was made: .venv, out, build and cache folders.
	rm -rf .venv out .pytest_cache .mypy_cache .ruff_cache .hypothesis ros_ws/build ros_ws/install ros_ws/log
	rm -rf $(PACKAGES:%=%/build) $(foreach each,$(PACKAGES),$(each)/$(each).egg-info)
	find $(PACKAGES) tests ros_ws -name __pycache__ -type d -prune -exec rm -rf {} +
