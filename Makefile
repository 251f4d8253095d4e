# make demo   from a fresh clone to a report on the sample campaign
# make test   everything a change has to pass
# make docs   the documentation, in site/index.html
# Needs Python 3.11 or newer and nothing else; another interpreter: make test PYTHON=python3.12

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

.PHONY: demo test docs clean
.DELETE_ON_ERROR:

demo: $(VENV)/.installed
	@$(BIN)/ringmodal demo

# Modules stay compiled whatever the environment says: tests start many programs.
test: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal

# Warnings are errors; nothing is fetched while building, nor while reading.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W --keep-going -E -q -d build/doctrees docs site
	@echo "Documentation: site/index.html"

clean:
	rm -rf $(VENV) demo site docs/api/generated build dist *.egg-info

# An editable install follows the sources by itself: only pyproject.toml calls for a new one.
$(VENV)/.installed-test: pyproject.toml $(VENV)/pyvenv.cfg
	@$(PIP) install --quiet --editable '.[test]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml $(VENV)/pyvenv.cfg
	@$(PIP) install --quiet --editable '.[docs]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed: pyproject.toml $(VENV)/pyvenv.cfg
	@$(PIP) install --quiet --editable .
	@touch $@

# The version is checked first, so that an old Python is named and not met halfway.
$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; v = "%d.%d" % sys.version_info[:2]; sys.exit(None if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed, this is %s; use make PYTHON=python3.12" % v)'
	@$(PYTHON) -m venv $(VENV)
