# Every target but help sets up .venv first; a set-up that is current costs nothing.
.PHONY: help setup clients readers compiler browser fly test test-quick check mutate mutate-tenth bench schemas console stability figures laws
.DEFAULT_GOAL := setup

# Bytecode is kept, whatever the shell says: without it every worker rewrites every assertion at
# every run, which is half of the time that it takes to collect the tests.
test test-quick: export PYTHONDONTWRITEBYTECODE =

# the first of these that is 3.11 to 3.13; or make setup PYTHON=/path/to/python
PYTHON ?= $(firstword $(foreach python,python3 python3.13 python3.12 python3.11,\
	$(shell $(python) -c 'import sys; 0x30b <= sys.hexversion >> 16 <= 0x30d and print("$(python)")' 2>/dev/null)))

# an index that answers late is asked again
PIP_OPTIONS := --quiet --disable-pip-version-check --no-input --retries 10 --timeout 60 \
	--constraint constraints.txt

help:  ## what there is to make
	@sed -n 's/^\([a-z-]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 16

setup: .venv/.installed  ## a virtual environment with what is needed, in .venv
	@:

.venv/.installed: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "m-mrac needs Python 3.11, 3.12 or 3.13; found: $$(python3 --version 2>&1)" >&2; exit 1; }
	@echo "installing into .venv (once; about a minute, from the network) ..."
	@test ! -L .venv || { echo ".venv is a link: make it anew where it points to, or remove the link" >&2; exit 1; }
	@$(PYTHON) -m venv --clear .venv  # of one Python, whatever was there
	@.venv/bin/python -m pip install $(PIP_OPTIONS) --editable '.[dev]'
	@touch $@

# the real clients that tests fly the vehicle with: MAVProxy alone brings half a gigabyte
clients: .venv/.clients  ## the same, with MAVSDK and MAVProxy for the tests
	@:

.venv/.clients: .venv/.installed
	@echo "installing MAVSDK and MAVProxy into .venv (once; about a minute, from the network) ..."
	@.venv/bin/python -m pip install $(PIP_OPTIONS) --editable '.[dev,clients]'
	@touch $@

readers: tests/readers/node_modules/.installed  ## other readers of recordings, for the tests
	@:

tests/readers/node_modules/.installed: tests/readers/package.json tests/readers/package-lock.json
	@command -v npm >/dev/null || { echo "the tests need Node.js 18 or later with npm (apt install nodejs npm)" >&2; exit 1; }
	@echo "installing a reader of MCAP files into tests/readers (once; from the network) ..."
	@npm ci --silent --prefix tests/readers
	@touch $@

compiler:  ## is there a C compiler for the simulator in C of the tests?
	@command -v $(CC) >/dev/null || { echo "the tests need a C compiler, '$(CC)' is not there (apt install gcc libc6-dev)" >&2; exit 1; }

browser:  ## Chromium from the system's packages, for the tests, where that can be done
	@for name in chromium chromium-browser google-chrome google-chrome-stable; do \
		command -v $$name >/dev/null && exit 0; \
	done; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		echo "installing Chromium from the system's packages (once; about a minute) ..."; \
		apt-get update -qq && apt-get install -y -qq chromium >/dev/null; \
	else \
		echo "the tests of gcs view need Chromium: install the system's package of it" >&2; \
	fi

fly: setup  ## the paper's flight
	@.venv/bin/gcs fly paper_nominal

# three workers on two cores: many tests wait for a flight or for somebody's patience to end. Tests of
# what happens by the wall's clock come last, with the machine to themselves.
test: clients readers compiler browser  ## all tests
	@.venv/bin/pytest -q -n 3 --dist worksteal -m "not alone"
	@.venv/bin/pytest -q -m alone

test-quick: setup  ## those that start no processes and need no browser, Node.js or clients
	@.venv/bin/pytest -q --quick -n 2 --dist worksteal

check: setup  ## linters, types, import contracts, wording of docstrings
	@.venv/bin/ruff check -q .
	@.venv/bin/ruff format -q --check .
	@.venv/bin/mypy
	@.venv/bin/lint-imports
	@.venv/bin/python -m tests.rooms.words

mutate: setup  ## changes the source in 200 places: does a quick test fail for each?
	@.venv/bin/python -m tests.mutation

mutate-tenth: setup  ## a tenth of them again, another with every commit
	@.venv/bin/python -m tests.mutation --tenth

schemas: setup  ## written again: the schemas of recordings and missions, the page of parameters
	@.venv/bin/python -m gcs_tools.recording.schema docs/schemas
	@.venv/bin/python -m gcs_tools.missions.schema
	@.venv/bin/python -m fcu.parameters_page docs/parameters.md
	@.venv/bin/python -m fcu.messages_page docs/mavlink.md
	@.venv/bin/python -m gcs_tools.library.page docs/python.md
	@.venv/bin/python -m tests.rooms.readme_imports
	@.venv/bin/python -m tests.parameters.defaults
	@.venv/bin/python -m tests.rooms.words --write

bench: setup  ## the measurements of docs/bench.md
	@.venv/bin/python -m gcs_tools.studies.bench

console: clients  ## flown again: docs/mavproxy.txt
	@.venv/bin/python -m gcs_tools.studies.console docs/mavproxy.txt

stability: setup  ## flown again: docs/stability_map.png
	@.venv/bin/python -m gcs_tools.studies.stability_map

laws: setup  ## tuned and flown again: the table and figure of docs/laws.md (hours)
	@.venv/bin/python -m gcs_tools.studies.laws

figures: setup  ## flown again: the paper's figures, docs/figures
	@.venv/bin/python -m gcs_tools.studies.figures
