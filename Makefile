.DEFAULT_GOAL := help
.PHONY: run install test mutants chaos ui bench docs lint format help
SHELL := /bin/bash
PYTHON ?= python3

# The environment is made anew when what it is made from changes: its name is their checksum.
STAMP := .venv/installed-$(shell (echo "$(CURDIR)"; cat pyproject.toml constraints.txt) | cksum | cut -d' ' -f1)
ACTIVATE := . .venv/bin/activate
# What hardly anything imports is compiled where it is.
RARE := /(tests?|sympy|_inductor|rllib|serve)/
PIP := .venv/bin/pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
# PyPI's torch for Linux brings over 2 GB of CUDA's libraries to download; this index has one without.
CPU_INDEX := https://download.pytorch.org/whl/cpu

run: install ## Materialise every asset into .tactile/, then print the tables
	@$(ACTIVATE) && { python -m tactile_assets.fresh || dagster job execute --job whole_chain; } && tactile results

install: $(STAMP) ## Make the virtual environment .venv with everything pinned (does nothing if it is there)

$(STAMP):
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' \
	  || { echo "Python 3.11, 3.12 or 3.13 is needed; name one: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	@echo "Installing into .venv: about 3 GB (7 with an NVIDIA GPU), one to five minutes"
	@$(PYTHON) -m venv --clear .venv || { echo "No venv could be made (Debian: apt install python3-venv)"; exit 1; }
	@[ "$$(uname -s)" != Linux ] || command -v nvidia-smi >/dev/null \
	  || $(PIP) --no-deps --retries 0 --extra-index-url $(CPU_INDEX) torch || true  # PyPI's, where it does not answer
	@$(PIP) -e '.[dev]'
	@$(PIP) --no-deps hpbandster  # it asks for netifaces, which needs a compiler and is never imported
	@.venv/bin/python -W ignore -m compileall -qq -j 0 -x '$(RARE)' .venv/lib || true  # on all processors, where pip takes one
	@echo '. "$$VIRTUAL_ENV/../environment.sh"' >> .venv/bin/activate
	@touch $@

# One process more than cores: tests of daemons, browsers and clusters wait a lot.
test: install ## Install what is missing and run the tests, in random order on all cores
	@$(ACTIVATE) && pytest -n $$(($$(getconf _NPROCESSORS_ONLN) + 1)) --maxprocesses 8 --dist loadscope --no-loadscope-reorder

mutants: install ## See whether the tests tell small changes of the code; docs/mutation.md
	@$(ACTIVATE) && python -m tests.mutants

chaos: install ## Kill runs at random moments and see that nothing is lost (an hour); docs/chaos.md
	@$(ACTIVATE) && python -m tests.chaos --kills 50

ui: install ## Dagster's web interface in a browser, with the pictures of the last run
	@$(ACTIVATE) && python -m tactile_assets.ui

bench: install ## Measure the ratios of docs/results/README.md into build/bench (five quiet minutes)
	@$(ACTIVATE) && python -m benchmarks.bench

docs: install ## Make the docs' site in build/site, strictly
	@$(ACTIVATE) && NO_MKDOCS_2_WARNING=1 python -m mkdocs build --strict && echo "Open build/site/index.html"

lint: install ## Check formatting, style and types
	@$(ACTIVATE) && ruff format --check . && ruff check . && mypy

format: install ## Apply formatting and the style fixes that are safe
	@$(ACTIVATE) && ruff format . && ruff check --fix .

help: ## This list
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
