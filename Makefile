# `make demo` and `make test` do everything on a machine with Python 3.11 or newer, git and make; `make help` lists the rest.
# Without make (Windows): python -m venv .venv, then pip install -e .[all,docs,test] in it, then python -m eightpost demo.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

# Many targets start hundreds of Python processes, each of which would otherwise compile the sources again.
unexport PYTHONDONTWRITEBYTECODE

# Measured records are not shipped: the tests use those that lie beside the checkout, or those that EIGHTPOST_DATA names.
RECORDS := $(wildcard ../shared/data)
ifneq ($(RECORDS),)
export EIGHTPOST_DATA ?= $(abspath $(RECORDS))
endif

.PHONY: help demo test quick area lint types contracts loops unit nightly pythons bounds release fuzz hosts mutants docs \
  licences clean

help: ## List the targets.
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{ printf "%-17s%s\n", $$1, $$2 }'

demo: $(INSTALLED) ## Install, and run the whole workflow on the included data (first time: minutes).
	$(BIN)/python -m eightpost demo -o demo

# While one core checks the types, another compiles loops that both workers would otherwise compile.
test: lint ## Install, check style, types and imports, and run the tests: about five minutes.
	$(MAKE) -j 2 types contracts loops
	$(MAKE) unit

quick: $(INSTALLED) ## Run a few fast tests of every area, the C core included: under a minute.
	$(BIN)/python -m benchmarks.mutants.area_tests --quick

area: $(INSTALLED) ## Run the tests of a source or folder: make area FILE=eightpost/signals/filters.py (SLOW=1: all).
	$(BIN)/python -m benchmarks.mutants.area_tests $(if $(SLOW),--slow) $(FILE)

lint: $(INSTALLED) ## Check style and format.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED) ## Check types.
	$(BIN)/pyrefly check --python-interpreter-path $(BIN)/python --min-severity error

contracts: $(INSTALLED) ## Check which module imports which.
	$(BIN)/lint-imports

loops: $(INSTALLED)
	$(BIN)/python -m eightpost virtual rig --car quarter_car --test random --set duration='2 s' -o out/loops/quarter_car.parquet

unit: $(INSTALLED)
	$(BIN)/pytest -n 2 --dist loadscope --max-worker-restart 0

nightly: $(INSTALLED) ## Run tests that take minutes: a million random FMI calls, intervals, installations, Wine.
	EIGHTPOST_CALLS=1000000 $(BIN)/pytest -m 'slow or nightly' -k call_sequences tests/native
	$(BIN)/pytest -n 2 -m 'nightly or hypothesis' --hypothesis-profile nightly

pythons: $(INSTALLED) ## Install the wheel with every Python that uv finds, and run eightpost doctor and fast tests.
	$(BIN)/python -m release.pythons

bounds: $(INSTALLED) ## Install the oldest allowed version of every dependency, and run the fast tests.
	$(BIN)/python -m release.pythons --lowest

release: $(INSTALLED) ## Check that this checkout can be released: tree, versions, changelog, distributions, tests.
	$(BIN)/python -m release.check

fuzz: $(INSTALLED) ## Read thousands of damaged files with every reader: about ten minutes.
	$(BIN)/python -m benchmarks.fuzz $(FUZZ)

hosts: $(INSTALLED) ## Run the programs of examples/hosts, and write the tables of hosts: minutes.
	$(BIN)/python docs/make/make_hosts.py --run $(HOSTS)

mutants: $(INSTALLED) ## Change the sources in one place at a time and run the tests: about half an hour.
	$(BIN)/python -m benchmarks.mutants $(MUTANTS)

docs: $(INSTALLED) ## Write the documentation site to out/site, without network: half a minute.
	$(BIN)/python docs/make/make_tables.py
	$(BIN)/python docs/make/make_commands.py
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -c docs . out/site
	@echo "open out/site/index.html"

licences: $(INSTALLED) ## Write the page with the licences of all dependencies.
	$(BIN)/python docs/make/make_licences.py

# All cores make the byte code, of which pip makes one file after the other. Some packages contain files of other Pythons.
$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile --editable '.[all,docs,test]'
	$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true
	touch $@

clean: ## Remove everything that the targets made.
	rm -rf $(VENV) demo dist out build
