# Every target does its own set-up in .venv; all it needs is Python 3.11+ with venv and pip, and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SUDO := $(if $(filter 0,$(shell id -u)),,sudo)
READY := $(VENV)/.ready

# one thread for linear algebra: the tests run on all cores already
test test-all bench: export OMP_NUM_THREADS = 1
# compiled modules are kept, also where the machine says otherwise: the tests start some hundred commands
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all bench lint types docs gallery picture examples dist browser robots lock clean

demo: $(READY)
	$(BIN)/nlpgrasp demo

test: $(READY)
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow"

test-all: $(READY)
	$(BIN)/python -m pytest -n auto --dist worksteal

bench: $(READY)
	$(BIN)/python -m benchmarks

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

# the site, in build/site; warnings are errors
docs: $(READY)
	NO_MKDOCS_2_WARNING=true $(BIN)/mkdocs build --strict --quiet

# docs/gallery.md, by solving all of problems/
gallery: $(READY)
	$(BIN)/python docs/make_gallery.py

# README's picture, by Debian's chromium
picture: $(READY)
	$(BIN)/python docs/make_picture.py

# pictures of the worked examples in docs/hands.md, tasks.md and choosing_contacts.md; some minutes
examples: $(READY)
	$(BIN)/python -m docs.make_worked_examples

# wheel and sdist, in dist, checked as an index would
dist: $(READY)
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist .
	$(BIN)/twine check --strict dist/*

# the browser that the report's tests use (Debian; as root, or with sudo)
browser:
	$(SUDO) apt-get update -qq
	$(SUDO) apt-get install -y -qq chromium chromium-driver >/dev/null

# files of robots for tests/hands: URDFs (130 MB to download, 415 MB on disk) and MJCFs (180 MB, 570 MB); without them
# these tests skip
robots: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile example-robot-data==6.0.0 \
	  gymnasium-robotics==1.4.2 robosuite==1.5.2

# writes requirements.lock from pyproject.toml
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet pip-tools
	$(VENV)-lock/bin/pip-compile --quiet --strip-extras --no-emit-index-url --no-emit-find-links --no-emit-trusted-host \
	  --no-header --extra hands --extra docs --extra dev --output-file requirements.lock pyproject.toml
	rm -rf $(VENV)-lock

$(READY): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "nlpgrasp needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $(READY)

clean:
	rm -rf $(VENV) build dist
