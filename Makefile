# Everything from nothing: each goal makes its own environment in .venv and needs Python 3.11 or newer, pip and gcc.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# The lock is complete, so that nothing is left to resolve; modules are compiled when they are first imported, most never are.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
export MPLBACKEND := Agg

.PHONY: demo test test-slow check bench lock clean system

demo: $(STAMP)
	$(BIN)/deform demo demo-out

test: $(STAMP) system
	$(BIN)/python -m pytest -m "not slow" -n auto --dist loadfile --no-loadscope-reorder --durations=15

test-slow: $(STAMP) system
	sh tools/system-packages.sh chromium poppler-utils
	$(BIN)/python -m pytest -m slow -n auto --dist loadfile --no-loadscope-reorder --durations=15

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(STAMP)
	$(BIN)/python -m benchmarks

# System libraries for the PDF and the 3-D surfaces; without root the features that want them say so.
system: $(VENV)/.system

$(VENV)/.system: tools/system-packages.sh | $(STAMP)
	sh tools/system-packages.sh
	@touch $@

$(STAMP): pyproject.toml requirements.lock
	$(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps --no-compile -r requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

# The lock names versions only, no addresses.
lock:
	rm -rf $(VENV)/lock && $(PYTHON) -m venv $(VENV)/lock
	$(VENV)/lock/bin/python -m pip install --quiet ".[dev]"
	$(VENV)/lock/bin/python -m pip freeze --exclude deform-ili --exclude-editable | grep -v '@' > requirements.lock
	rm -rf $(VENV)/lock

clean:
	rm -rf $(VENV) demo-out out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
