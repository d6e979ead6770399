# Two commands do everything on a machine with Python 3.11, git and make:
#   make demo     installs the package and runs the main workflow on the included data
#   make test     installs the package, checks style, types and imports, and runs the tests
#   make nightly  runs tests that take minutes: a million random FMI call sequences on each FMU under sanitizers (needs a
#                 C compiler), coverage of confidence intervals, all twelve configurations of the virtual dynamometer
#   make fuzz     reads thousands of damaged files with every reader: about ten minutes on 2 cores
#   make hosts    runs the programs of examples/hosts and the tools of benchmarks/interface_matrix that are installed, and
#                 writes docs/how_to/hosts.md and docs/evidence/hosts_tools.md: minutes
#   make docs     writes the documentation site to out/site, without network: half a minute
#   make mutants  changes the sources in one place at a time and runs the tests of that area: about half an hour
# Without make (Windows): python -m venv .venv, then pip install -e .[build,test] in it, then python -m eightpost demo.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test lint types contracts loops unit nightly fuzz hosts mutants docs clean

demo: $(INSTALLED)
	$(BIN)/python -m eightpost demo -o demo

# While one core checks the types, another compiles loops that both workers of the tests would otherwise compile.
test: lint
	$(MAKE) -j 2 types contracts loops
	$(MAKE) unit

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/mypy

contracts: $(INSTALLED)
	$(BIN)/lint-imports

loops: $(INSTALLED)
	$(BIN)/python -m eightpost rig --car quarter_car --test random --duration '2 s' -o out/loops/quarter_car.parquet
	$(BIN)/python -m eightpost rig --car flexible --test random --duration '2 s' -o out/loops/flexible.parquet

unit: $(INSTALLED)
	$(BIN)/pytest -n 2 --dist loadscope --max-worker-restart 0

nightly: $(INSTALLED)
	EIGHTPOST_CALLS=1000000 $(BIN)/pytest -k call_sequences tests/native
	$(BIN)/pytest -n 2 -m nightly

fuzz: $(INSTALLED)
	$(BIN)/python -m benchmarks.fuzz $(FUZZ)

hosts: $(INSTALLED)
	$(BIN)/python docs/make/make_hosts.py --run $(HOSTS)

mutants: $(INSTALLED)
	$(BIN)/python -m benchmarks.mutants $(MUTANTS)

docs: $(INSTALLED)
	$(BIN)/python docs/make/make_tables.py
	$(BIN)/python docs/make/make_commands.py
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -c docs . out/site
	@echo "open out/site/index.html"

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[build,docs,test]'
	touch $@

clean:
	rm -rf $(VENV) demo dist out build
