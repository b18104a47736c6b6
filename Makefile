# Every target sets up what it needs: a virtual environment in .venv, from the pinned constraints.
PYTHON ?= python3
MISSION ?= missions/pennovation/mission.yaml
SPEED ?= 10
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

# What pip says, as one line a package; a pipe fails with pip.
SHELL := bash
.SHELLFLAGS := -o pipefail -c
PINNED = $(BIN)/python -m pip install --disable-pip-version-check --no-input --no-deps --require-hashes --requirement $(1) \
	| awk -v all="$$(grep -c '==' $(1))" '/^(Collecting|Requirement already)/ { sub(/^Requirement already satisfied:/, "Collecting"); printf "  %d of up to %d: %s\n", ++n, all, $$2; fflush() } \
		/^Installing/ { print "  installing " n " packages: the longest step"; fflush() }' >&2

# A flight is several processes: each would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup sim test dist-test lowest explore coverage rehearse rehearse-slice sabotage sabotage-slice stpa tolerances experiments experiments-verify experiments-remade leaderboard lint film bench-goals bench-link bench-route dist dist-demo release docs docs-test constraints clean

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml packaging/mocha-link/pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("air-router needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try make PYTHON=python3.12") if sys.version_info < (3, 11) else 0'
	@echo "setting up $(VENV), once: 1 GB; what there is to fetch and to install takes one to five minutes" >&2
	@$(PYTHON) -m venv $(VENV) || { echo "no virtual environment: on Debian/Ubuntu run 'sudo apt-get install python3-venv' and try again" >&2; exit 1; }
	@$(call PINNED,constraints.txt)
	@$(PIP) --no-deps --no-build-isolation --editable packaging/mocha-link --editable .
	@touch $@

# Options: make sim SIM="--web --seed 3"
sim: setup
	$(BIN)/air-router sim $(MISSION) --speed $(SPEED) --log-dir logs $(SIM)

# Looked through before, once: five workers that start cold would all rewrite the same assertions.
test: export PYTHONDONTWRITEBYTECODE =
test: setup
	@[ -d tests/__pycache__ ] || $(BIN)/python -m pytest --collect-only -qq > /dev/null || true
	$(BIN)/python -m pytest -n 5 --dist loadgroup --no-loadscope-reorder

# Every snippet of README and docs; the tutorial as it stands there and what else flies or serves: 4 minutes
docs-test: setup
	$(BIN)/python -m pytest -o 'python_files=test_*.py walk_*.py' tests/docs tests/test_readme.py tests/mocha_link/test_docs_embedding.py tests/mocha_link/bridges/test_docs.py tests/air_router/test_docs_routes.py tests/air_router/control/test_control.py

# Flights in which something goes wrong, one of each kind and seed; options: make rehearse REHEARSE="--fault GUSTS"
rehearse: setup
	$(BIN)/python -m sitl rehearse $(MISSION) $(REHEARSE)

# One flight of each fault class
rehearse-slice: setup
	$(BIN)/python -m sitl rehearse $(MISSION) --share 0.001

# The flight code broken on purpose, one place at a time: the judge has to notice. make sabotage SABOTAGE="--share 0.2"
sabotage: setup
	$(BIN)/python -m benchmarks.sabotage $(SABOTAGE)

# One of each class, each caught in its first scene
SLICE = "every leg is clear" "no clearance" "straight lines" "the loader drops a zone" "it lands where it is" \
	"a go-to flies at 3 m" "the pilot's mode is ignored" "an order of another sender goes unnoticed" \
	"breaches are never seen" "satellites are ignored" "the battery is ignored" \
	"braking takes no way" \
	"a leg is not checked again when it leaves"
sabotage-slice: setup
	$(BIN)/python -m benchmarks.sabotage $(SLICE)

# Each number of the rehearsal's judge moved up and down: a test must notice
tolerances: setup
	$(BIN)/python -m benchmarks.tolerances $(TOLERANCES)

# The code behind each cell of the table in docs/evidence/safety.md broken: the test that it names must fail. make stpa STPA="test_a test_b"
stpa: setup
	$(BIN)/python -m benchmarks.stpa $(STPA)

# Half an hour on two cores: every experiment, and docs/evidence/experiments.md with their tables and figures
EXPERIMENTS ?= table1 field passive policies protocols readings crowd scale
experiments: setup
	for name in $(EXPERIMENTS); do $(BIN)/python -m sitl experiment $$name --docs docs/evidence/experiments.md \
		--archive docs/evidence/$$name-runs.jsonl.xz || exit 1; done

# Ten archived runs at random, made again from today's sources: fails if a digest differs. REMADE="--seed 7 --runs 20"
experiments-remade: setup
	$(BIN)/python -m benchmarks.archives $(REMADE)

# That, and tables and verdicts of docs/evidence/experiments.md from all archived runs: fails if a number differs
experiments-verify: setup experiments-remade
	for file in docs/evidence/*-runs.jsonl.xz; do $(BIN)/python -m sitl experiment $$file --verify docs/evidence/experiments.md || exit 1; done
	$(BIN)/python -m benchmarks.archives --claims verify

# Seek policies on the frozen test set; commit first, as the table names the commit. make leaderboard POLICIES="tour my_policy:Nearest"
POLICIES ?= never freshest rendezvous tour oracle
leaderboard: setup
	$(BIN)/python -m sitl leaderboard $(POLICIES) --out build/leaderboard --table docs/evidence/leaderboard.csv

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

# The README's animation, and the timeline of the map page, from a record of the shipped mission: make film RECORD=logs/X.mcap
film: setup
	$(BIN)/python -m benchmarks.film $(RECORD) docs/images

# Every figure with a goal, beside an anchor; options: make bench-goals BENCH="--busy --json FILE --only NAME"
bench-goals: $(VENV)/.tools
	$(BIN)/python -m benchmarks.goals $(BENCH)

# Options: make bench-link BENCH="--quick --json FILE"
bench-link: $(VENV)/.tools
	$(BIN)/python -m benchmarks.link $(BENCH)

# Options: make bench-route BENCH="--quick --json FILE"
bench-route: $(VENV)/.tools
	$(BIN)/python -m benchmarks.route $(BENCH)

# What only benchmarks, `make dist` and `make docs` need
$(VENV)/.tools: $(VENV)/.ready constraints-tools.txt
	@$(call PINNED,constraints-tools.txt)
	@$(PIP) --no-deps 'extremitypathfinder==2.7.2'  # asks for numpy<2, runs with 2
	@touch $@

# Wheels and source archives, what they need in pinned versions (requirements.txt, CycloneDX), and checksums
EXTRAS := $(shell sed -n '/^\[project.optional-dependencies\]/,/^$$/s/^\([a-z0-9]*\) = .*/\1/p' pyproject.toml)
dist: $(VENV)/.tools
	rm -rf dist
	$(BIN)/hadolint packaging/Dockerfile
	$(BIN)/python -m build --no-isolation --outdir dist packaging/mocha-link
	$(BIN)/python -m build --no-isolation --outdir dist
	$(PINS) | $(COMPILE) --quiet $(EXTRAS:%=--extra %) --constraint - --output-file dist/requirements.txt
	$(BIN)/cyclonedx-py requirements --pyproject pyproject.toml --output-reproducible --output-file dist/sbom.cdx.json dist/requirements.txt
	cd dist && sha256sum -- * > SHA256SUMS

# What a tag publishes, with its notes; fails unless tag, version and changelog agree: make release TAG=v0.2.0
release: dist
	@mkdir -p build
	$(BIN)/python packaging/release.py "$(TAG)" build/NOTES.md
	cd dist && sha256sum --check --quiet SHA256SUMS

# `air-router sim demo` from the wheels in dist, in an environment with nothing else, in an empty folder
dist-demo: $(VENV)/.tools
	rm -rf build/demo && mkdir -p build/demo
	cd build/demo && $(CURDIR)/$(BIN)/uv tool run --isolated --with $(CURDIR)/dist/mocha_link-*.whl \
		--from "$$(echo $(CURDIR)/dist/air_router-*.whl)[sim]" air-router sim demo --speed 20 --duration 60

# Wheels of ours in empty environments elsewhere, one for each extra, which then does what it is for: 10 minutes
dist-test: $(VENV)/.tools
	$(BIN)/python -m pytest -n 2 -o 'python_files=walk_*.py' --timeout 900 tests/dist

# The suite with the lowest versions that the bounds in pyproject.toml allow, in an environment of its own
LOWEST := build/lowest
lowest: $(VENV)/.tools
	@mkdir -p build
	$(BIN)/uv pip compile --quiet --python-version 3.11 --resolution lowest-direct --no-header --no-annotate --no-emit-package mocha-link pyproject.toml \
		$(EXTRAS:%=--extra %) --group dev --output-file build/lowest.txt
	$(BIN)/uv venv --quiet --clear --python 3.11 $(LOWEST)
	$(BIN)/uv pip install --quiet --python $(LOWEST) --no-deps --requirement build/lowest.txt
	$(BIN)/uv pip install --quiet --python $(LOWEST) --no-deps --no-build-isolation --editable packaging/mocha-link --editable .
	$(LOWEST)/bin/python -m pytest -n 3 --dist loadgroup --no-loadscope-reorder -W "ignore:Conversion of an array:DeprecationWarning" $(TESTS)  # of pyproj

# Properties with new examples, a thousand each, where the suite has fixed ones
explore: setup
	HYPOTHESIS_PROFILE=explore $(BIN)/python -m pytest -n 3 -m hypothesis --timeout 7200 $(TESTS)

# Which share of the code the suite runs, programs that it starts included
coverage: setup
	$(BIN)/coverage erase
	COVERAGE_PROCESS_START=$(CURDIR)/pyproject.toml $(BIN)/coverage run -m pytest -n 3 --dist loadgroup --no-loadscope-reorder $(TESTS)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --sort=cover | tail -n 40

# The documentation as a site, in build/site; a broken link is an error
docs: $(VENV)/.tools
	PYTHONPATH=. NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --clean

# Newer versions of everything, with the checksums of their files for every platform
PINS = sed -n 's/^\([^ ]*==[^ ;]*\).*/\1/p' constraints.txt
COMPILE = $(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-annotate --no-emit-package mocha-link pyproject.toml
constraints: $(VENV)/.tools
	$(COMPILE) --upgrade --extra fly --extra plot --group dev --output-file constraints.txt
	$(PINS) | $(COMPILE) --upgrade --group bench --group dist --group docs --constraint - --output-file constraints-tools.txt

clean:
	rm -rf $(VENV)
