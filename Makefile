# The commands a person starts with: `make hil` and `make test`; `make help` lists the rest.
# Needs Python 3.11 or newer and make. Each step runs once for each content of the files that it depends on.

SHELL := /bin/sh
.DEFAULT_GOAL := help
.PHONY: help setup hil view test check lock clean
MAKEFLAGS += --no-print-directory
BEGUN_S := $(shell date +%s)

# A person's own pip settings must not send packages elsewhere (nor those of files: --target= and --no-user below)
# or add unhashed ones.
unexport PIP_USER PIP_TARGET PIP_PREFIX PIP_CONSTRAINT PYTHONHOME PYTHONPATH

PACKAGES := compilation firmware_py plant_sim hil tools
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input install --quiet --quiet --target= --no-user
content = $(shell cat $(1) | cksum | cut -d ' ' -f 1)
# A lock names all packages, so pip resolves nothing: an old pip takes the newest release of a package with extras,
# which has no hash here, and refuses it. `pip check` then says whether a lock lacks something.
FROM_LOCK := --no-deps --require-hashes -r
COMPLETE = missing=$$($(BIN)/python -m pip check) || \
    { echo "$$missing" >&2; echo "setup: these packages do not fit each other: make clean, then again" >&2; exit 1; }
# fewest: one version of a package for every Python, so that what one machine tests is what another runs
LOCKED := --quiet --universal --fork-strategy fewest --python-version 3.11 --generate-hashes --no-annotate \
    --no-emit-index-url
INSTALLED := $(VENV)/.installed-$(call content,requirements.lock pyproject.toml)
INSTALLED_DEV := $(VENV)/.installed-dev-$(call content,requirements-dev.lock pyproject.toml)
WARM := $(VENV)/.warm-$(call content,requirements.lock tools/dev/warm.py $$(find compilation plant_sim firmware_py hil -name '*.py' | sort))

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 15

setup: $(WARM) ## the virtual environment, the locked packages, the compiled kernels

hil: setup ## the default scenario in real time on the best available CAN bus, and its verdict
	@echo "hil: firmware and plant as two processes at 1 kHz; the run takes half a minute, as it is in real time"
	@$(BIN)/vibrohil run soft-start-multistable --clock real --bus auto --firmware compiled

view: setup ## the newest run in the Rerun viewer
	@$(BIN)/vibrohil view

test: setup $(INSTALLED_DEV) ## all tests: on all cores, then those that need a quiet machine one by one
	@echo "test: all but those that need a quiet machine, and the examples in docstrings, on all cores"
	@failed=; \
	$(BIN)/python -m pytest -n auto --dist worksteal --durations=3 -m "not quiet" --doctest-modules tests $(PACKAGES) \
	    || failed="those on all cores"; \
	echo "test: those that need a quiet machine, one by one"; \
	$(BIN)/python -m pytest --durations=3 -m quiet || failed="$${failed:+$$failed and }those on a quiet machine"; \
	if [ -n "$$failed" ]; then echo "test: FAILED: $$failed" >&2; exit 1; fi; \
	echo "test: all passed, both on all cores and one by one"

check: setup $(INSTALLED_DEV) ## formatter, linter, strict types, import contracts
	@echo "check: format"
	@$(BIN)/ruff format --check --quiet .
	@echo "check: lint"
	@$(BIN)/ruff check --quiet .
	@echo "check: types"
	@$(BIN)/mypy
	@echo "check: import contracts"
	@$(BIN)/lint-imports

lock: ## new locks from pyproject.toml (needs uv), with the same versions where these still fit
	@command -v uv > /dev/null || { echo "make lock: no uv on PATH; python3 -m pip install uv" >&2; exit 1; }
	@UV_CUSTOM_COMPILE_COMMAND="make lock" uv pip compile $(LOCKED) --extra setup \
	    --output-file requirements.lock pyproject.toml
	@UV_CUSTOM_COMPILE_COMMAND="make lock" uv pip compile $(LOCKED) --extra setup --extra dev \
	    --constraint requirements.lock --output-file requirements-dev.lock pyproject.toml

clean: ## remove the virtual environment and all caches; runs stay
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find $(PACKAGES) tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@python=$$(sh tools/dev/find-python.sh $(if $(PYTHON),"$(PYTHON)")) && \
	echo "setup: a virtual environment in $(VENV), so that nothing else on this machine changes" && \
	"$$python" -m venv --clear $(VENV)

# An environment that has the tests' packages gets their lock: it holds the other one, and old ones would not fit it.
# editable_mode=compat: setuptools' other way leaves a relative folder on Python's path, which the working folder could
# hold with modules of somebody else (tests/trust). LC_ALL: setuptools writes the checkout's path in the locale's
# encoding, and in the locale C a path with an umlaut has none.
$(INSTALLED): | $(BIN)/python
	@echo "setup: the packages of requirements.lock, checked against its hashes (1.3 GB on disk; some minutes)"
	@$(PIP) $(FROM_LOCK) $$(ls $(VENV)/.installed-dev-* > /dev/null 2>&1 && echo requirements-dev.lock || echo requirements.lock)
	@LC_ALL=C.UTF-8 $(PIP) --no-deps --no-build-isolation --config-settings editable_mode=compat -e .
	@$(COMPLETE)
	@rm -f $(VENV)/.installed-[0-9]* && touch $@

$(INSTALLED_DEV): | $(INSTALLED)
	@echo "setup: what tests and checks need, from requirements-dev.lock"
	@$(PIP) $(FROM_LOCK) requirements-dev.lock
	@$(COMPLETE)
	@rm -f $(VENV)/.installed-dev-* && touch $@

$(WARM): | $(INSTALLED)
	@$(BIN)/python -m tools.dev.warm --begun-s $(BEGUN_S)
	@rm -f $(VENV)/.warm-* && touch $@
