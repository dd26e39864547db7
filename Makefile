# `make bench` and `make test` are all that a fresh machine needs: both make the virtual environment first.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: bench test lint types rules check clean

bench: $(VENV)/installed
	$(BIN)/positioner bench --out out/bench

test: $(VENV)/installed
	$(BIN)/pytest

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed
	$(BIN)/mypy

rules: $(VENV)/installed
	$(BIN)/lint-imports

check: lint types rules test

$(VENV)/installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) out build dist
