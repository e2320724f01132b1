# Needs Python 3.11 or newer and a package registry; everything goes to .venv.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
RUN := runs/demo
REFERENCE := build/docs
# One process a core with one thread each: most tests are too small to share among threads.
PYTEST := OMP_NUM_THREADS=1 $(PY) -m pytest --numprocesses auto --dist worksteal
DEPENDENCIES := setup.cfg pyproject.toml constraints.txt

.PHONY: help demo test test-slow lint docs clean
.DELETE_ON_ERROR:

help:
	@echo "make demo       fit the bundled sample with the default configuration into $(RUN)"
	@echo "make test       run the fast tests"
	@echo "make test-slow  run the slow tests"
	@echo "make lint       check style and formatting"
	@echo "make docs       write the reference of all modules into $(REFERENCE)"
	@echo "make clean      remove what the other targets made, $(VENV) included"

$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is \
	needed, this is %s; name another with make PYTHON=..." % sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/installed: $(VENV)/created $(DEPENDENCIES)
	$(PY) -m pip install --quiet --editable . --constraint constraints.txt
	@touch $@

$(VENV)/installed-test: $(VENV)/created $(DEPENDENCIES)
	$(PY) -m pip install --quiet --editable ".[test,mitsuba,eval,parquet,viz,docs]" --constraint constraints.txt
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: $(VENV)/created $(DEPENDENCIES)
	$(PY) -m pip install --quiet --editable ".[docs]" --constraint constraints.txt
	@touch $@ $(VENV)/installed

demo: $(VENV)/installed
	rm -rf $(RUN)
	@mkdir -p $(dir $(RUN))
	$(PY) -m spmm_torch.fit \
	"$$($(PY) -c 'from spmm_torch.data import sample_path; print(sample_path())')" -o $(RUN)
	@echo "The report lies in $(RUN)/report.html, the command spmm in $(VENV)/bin;"
	@echo "source $(VENV)/bin/activate puts it on the PATH"

test: $(VENV)/installed-test
	$(PYTEST) -m "not slow"

test-slow: $(VENV)/installed-test
	$(PYTEST) -m slow

lint: $(VENV)/installed-test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	@# Types are checked in the tree that is installed, in which cli, configs and viz lie inside.
	rm -rf build/types
	mkdir -p build/types
	cp -r spmm_torch build/types
	cp -r cli configs viz build/types/spmm_torch
	$(VENV)/bin/basedpyright

docs: $(VENV)/installed-docs
	rm -rf $(REFERENCE)
	$(PY) docs/reference/build.py $(REFERENCE)

clean:
	rm -rf $(VENV) $(RUN) build dist *.egg-info .hypothesis .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
