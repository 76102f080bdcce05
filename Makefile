# make assemble    one assembly, from nothing        make test    the tests, from nothing
#
#   SEED=7               the trial to run                     ARGS='...'     further arguments of the command
#   PYTHON=python3.12    the interpreter to use               VENV=folder    where the environment is made
#   TORCH_INDEX_URL=...  an index with torch's CPU build, for machines whose package index has only the CUDA build
#                        (on Linux several gigabytes larger); where no index has it torch is left out
#   TORCH=any            take the larger build then
#   WORKERS=2            of the tests: one starts processes, the others compute in what it leaves of the cores

PYTHON ?=
VENV ?= .venv
TORCH_INDEX_URL ?=
TORCH ?=
SEED ?=
WORKERS ?= 3
ARGS ?=

BIN := $(VENV)/bin

.PHONY: help env env-run assemble up results test docs lint format typecheck clean distclean
.DEFAULT_GOAL := help

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1|/p' $(MAKEFILE_LIST) | while IFS='|' read -r target text; do printf '%-18s %s\n' "$$target" "$$text"; done

SET_UP = PYTHON='$(PYTHON)' VENV='$(VENV)' TORCH_INDEX_URL='$(TORCH_INDEX_URL)' TORCH='$(TORCH)' sh deploy/bootstrap.sh

env: ## make or renew the environment, with torch and what the tests need
	@PARTS=all $(SET_UP)

env-run:
	@PARTS=run $(SET_UP)

assemble: env-run ## start the system, do one assembly, stop everything
	@$(BIN)/crosspih assemble $(if $(SEED),--seed $(SEED)) $(ARGS)

up: env-run ## start the system and show what it writes; Ctrl-C stops it
	@$(BIN)/crosspih up $(ARGS)

results: env ## every table and figure of docs/results.md; hours, and a stopped run goes on where it was
	@$(BIN)/crosspih results $(ARGS)

test: env ## run the tests in three workers; ARGS='-n 0 tests/bus' runs one folder in this process
	@$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile $(ARGS)

docs: env ## the site of docs/ into build/site, without a network; open build/site/index.html
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict && echo build/site/index.html

lint: env ## style and common errors
	@$(BIN)/ruff check . && $(BIN)/ruff format --check .

format: env ## bring the source into the house's form
	@$(BIN)/ruff check --fix . && $(BIN)/ruff format .

typecheck: env ## mypy, strict
	@$(BIN)/mypy

clean: ## remove what tests and runs left, but not recordings
	@rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info
	@find . -name __pycache__ -type d -not -path './$(VENV)/*' -prune -exec rm -rf {} +

distclean: clean ## remove the environment too
	@if [ -f '$(VENV)/pyvenv.cfg' ]; then rm -rf '$(VENV)'; fi
