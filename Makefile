# Everything runs in an environment of its own, made from pyproject.toml and constraints.txt.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
BENCH := $(VENV)/.bench
# one test process per processor, at least one
WORKERS ?= $(shell nproc 2>/dev/null || echo 1)

.PHONY: reproduce sweep robust endtoend honest compare sensors sequential arm examples emps crosscheck bench bench-suites bench-design test test-all long mutants oldest check clean

reproduce: $(READY)  ## the paper's tables and figures, into figures/
	$(BIN)/python -m experiments.paper

sweep: $(READY)  ## J_f and tracking over horizons, bandwidths, gains and scenarios: data and heat maps
	$(BIN)/python -m experiments.beyond.sweep

robust: $(READY)  ## motions whose limits the axis itself keeps, sampled and proved; an hour, goes on motion by motion
	$(BIN)/python -m experiments.beyond.robust

endtoend: $(READY)  ## designs through filter and closed loop, table 6 and 7; four hours, goes on where it stopped
	$(BIN)/python -m experiments.beyond.endtoend

honest: $(READY)  ## intervals from 10,000 simulated logs beside the truths; goes on where it stopped
	$(BIN)/python -m experiments.beyond.honest

compare: $(READY)  ## chirps, multisines and other excitations, each optimised, beside ours; twelve minutes
	$(BIN)/python -m experiments.beyond.compare

sensors: $(READY)  ## what a guarantee costs over encoder resolutions and servo periods; two minutes
	$(BIN)/python -m experiments.beyond.sensors

sequential: $(READY)  ## three experiments, each under limits that the ones before have widened; 15 minutes
	$(BIN)/python -m experiments.beyond.sequential

arm: $(READY)  ## the second axis: designs, how good they are, and what one run proves; three minutes
	$(BIN)/python -m experiments.beyond.arm

examples: $(READY)  ## a pendulum with an objective of its own, a cart with cogging; three minutes
	$(BIN)/python -m experiments.axes.pendulum
	$(BIN)/python -m experiments.axes.cart

emps: $(READY)  ## what a real record proves: make emps DATA=…/DATA_EMPS.mat; three minutes
	$(BIN)/python -m experiments.axes.emps --data $(DATA)

crosscheck: $(READY)  ## Table I beside three longer searches; up to 50 minutes
	$(BIN)/python -m experiments.beyond.crosscheck

bench: $(BENCH)  ## how fast, compared with C and CasADi, and what a user waits for; ten minutes
	$(BIN)/python -m experiments.bench

bench-suites: $(BENCH)  ## the same, with the times of make reproduce and make test; 45 minutes
	$(BIN)/python -m experiments.bench --suites

bench-design: $(BENCH)  ## the design search beside IPOPT, cell by cell; 15 minutes, goes on where it stopped
	$(BIN)/python -m experiments.bench.design_against_ipopt

test: $(READY)  ## every promise; ten minutes the first time, five again
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m "not slow"

test-all: test  ## and every study, with minimal effort; five minutes more
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m slow

long: $(READY)  ## a log of 200 MB, read in little memory; six minutes
	JAXID_LONG_LOG=200 $(BIN)/python -m pytest tests/test_long_log.py

mutants: $(READY)  ## a test fails when a term of a bound is halved or left out; 20 minutes, goes on where it stopped
	$(BIN)/python tests/mutants.py

# an environment of its own with the oldest of everything, a command, and tests that touch all of it
OLDEST := .venv-oldest
oldest:  ## with the oldest versions that pyproject.toml allows: a few commands and tests
	$(PYTHON) -m venv $(OLDEST)
	$(PYTHON) tests/oldest.py > $(OLDEST)/oldest.txt
	$(OLDEST)/bin/python -m pip install --quiet --disable-pip-version-check -c $(OLDEST)/oldest.txt -e '.[test]'
	rm -rf $(OLDEST)/slide.toml && $(OLDEST)/bin/jaxid init $(OLDEST)/slide.toml
	$(OLDEST)/bin/python -m pytest -W ignore::DeprecationWarning $(addprefix tests/test_,axis_file.py axis_sweep.py docstrings.py log_file.py setpoints.py sweep.py)

check: $(READY)  ## lint and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/basedpyright

clean:  ## the environment, and what programs have compiled
	rm -rf $(VENV) $(OLDEST) "$${XDG_CACHE_HOME:-$$HOME/.cache}/jaxid"

# PIP_CONSTRAINT, not -c: it also pins what the build of the package itself needs
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "jaxid needs Python 3.11 or newer as $(PYTHON): install it, or name another one with 'make PYTHON=/path/to/python3'."; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "$(PYTHON) cannot make virtual environments: install its venv module (Debian and Ubuntu: apt install python3-venv)."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,check]'
	@touch $@

# CasADi, only here
$(BENCH): $(READY)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	@touch $@
