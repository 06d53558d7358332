# `make run` on a fresh Debian 12 installs what is missing (apt and PyPI only) and does the first study.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
STUDY := runs/flap-svk
# Runs in time at once, in `make verify`.
JOBS := 2
SYSTEM_PACKAGES := freefem++ libfreefem++ libfreefem++-dev libopenblas0-serial
# What the Python package gmsh loads, with which tests make meshes; a browser that looks at reports.
TEST_PACKAGES := chromium fonts-dejavu-core libglu1-mesa libgl1 libxrender1 libxcursor1 libxft2 libxinerama1 libxext6 libxfixes3 libx11-6 libfontconfig1 libgomp1

.PHONY: help setup system test-system run test verify verify-long verify-hard verify-acid verify-errors bench bench-peers paper report figures lint edp keys docs

help:
	@echo "make setup   install what is missing: FreeFEM (apt) and the Python environment in $(VENV)"
	@echo "make run     the flap study: a sweep over the inflow velocity, and its report"
	@echo "make test    unit tests and small real runs"
	@echo "make verify  published values and flow of blood: results/verification*, results/blood*, docs/results.md, and their tests (hours; a second call goes on)"
	@echo "make verify-long  FSI2 and FSI3 over many periods: results/long*, docs/results.md (an hour; a second call goes on)"
	@echo "make verify-hard  scenes outside of the catalogue, solved rightly or refused with the cause: results/hard.* (hours; a second call goes on)"
	@echo "make verify-acid  tests of the literature with moving walls, following loads, linear solids: results/acid.* (an hour; a second call goes on)"
	@echo "make verify-errors  error bars against errors over all steady cases: results/errors.* (half an hour; a second call goes on)"
	@echo "make bench   cost ratios, error against seconds, mesh motions, time steps: results/bench-*, results/speed.md, results/mesh-motion.*, docs/results.md"
	@echo "make bench-peers  FSI1 beside NGSolve, which goes into .venv-peers: results/speed.md (minutes)"
	@echo "make paper   the study of the paper's section 5: results/paper (minutes)"
	@echo "make report  results/report.html, one page of the documents and pictures in results/"
	@echo "make figures the README's picture, from the last point of 'make run'"
	@echo "make lint    ruff and mypy"
	@echo "make edp     render every case of the catalogue into edp/ again"
	@echo "make keys    write the keys of a scene into docs/scene.md again"
	@echo "make docs    the documentation as a site: build/site/index.html"

setup: system $(STAMP)

run: setup
	@$(BIN)/ffsi sweep flap-svk --vary inflow.mean_velocity=0.012:0.12:0.012 --out $(STUDY)
	@$(BIN)/ffsi report $(STUDY) -o $(STUDY)/report.html

test: setup test-system
	@$(BIN)/python -m pytest -n 2 --dist loadfile tests/unit tests/freefem

verify: setup
	@$(BIN)/python -m studies verify --out results --readme docs/results.md
	@$(BIN)/python -m studies verify --unsteady --jobs $(JOBS) --out results --readme docs/results.md
	@$(BIN)/python -m studies verify --blood --jobs $(JOBS) --out results --readme docs/results.md
	@$(BIN)/python -m pytest tests/verification
	@$(BIN)/python -m pytest -m long tests/unit tests/freefem

verify-long: setup
	@$(BIN)/python -m studies verify --long --jobs $(JOBS) --out results --readme docs/results.md

verify-hard: setup
	@$(BIN)/python -m studies verify --hard --jobs $(JOBS) --out results

verify-acid: setup
	@$(BIN)/python -m studies verify --acid --jobs $(JOBS) --out results

verify-errors: setup
	@$(BIN)/python -m studies verify --errors --jobs $(JOBS) --out results

bench: setup
	@$(BIN)/python -m studies bench --repeat 3 --out results --readme docs/results.md
	@$(BIN)/python -m studies bench --work-precision --repeat 3 --out results --readme results/speed.md
	@$(BIN)/python -m studies bench --factors --repeat 3 --out results --readme results/speed.md
	@$(BIN)/python -m studies bench --scenes --repeat 3 --out results --readme results/bench-scenes.md
	@$(BIN)/python -m studies bench --mesh-motion --out results
	@$(BIN)/python -m studies bench --unsteady --repeat 3 --out results --readme docs/results.md

bench-peers: setup
	@.venv-peers/bin/python -c 'import ngsolve' 2>/dev/null || { $(BIN)/python -m venv --clear .venv-peers && .venv-peers/bin/python -m pip install --quiet --disable-pip-version-check ngsolve==6.2.2608; }
	@$(BIN)/python -m studies bench --peers --repeat 5 --out results --readme results/speed.md

paper: setup
	@$(BIN)/python -m studies paper --jobs 2
	@$(BIN)/python -m studies paper --aneurysm

report: setup
	@$(BIN)/python -m studies report

figures: $(STUDY)/chain-001/velocity-0010.png
	@mkdir -p results
	@cp $< results/flap-velocity.png

$(STUDY)/chain-001/velocity-0010.png:
	@$(MAKE) run

lint: setup
	@$(BIN)/ruff check ffsi studies tests examples docs
	@$(BIN)/ruff format --check ffsi studies tests examples docs
	@$(BIN)/mypy

edp: setup
	@$(BIN)/python -c 'from ffsi.script.render import write_catalogue; write_catalogue("edp")'

keys: setup
	@sed -i '/^<!-- keys:begin -->$$/q' docs/scene.md
	@$(BIN)/ffsi keys --markdown >> docs/scene.md

docs: setup
	@$(INSTALL); install --editable '.[docs]'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict  # --quiet would not count the warnings

# Installs packages only when some are missing. Elsewhere than on Debian, `ffsi doctor` says what FreeFEM lacks.
define APT_INSTALL
apt_install() { \
  local missing=(); \
  for package in "$$@"; do \
    [[ "$$(dpkg-query -W -f='$${Status}' "$$package" 2>/dev/null)" == "install ok installed" ]] || missing+=("$$package"); \
  done; \
  (( $${#missing[@]} )) || return 0; \
  local root=(); \
  if (( EUID != 0 )); then \
    command -v sudo >/dev/null || { echo "As root: apt-get install --no-install-recommends $${missing[*]}" >&2; return 1; }; \
    root=(sudo); \
  fi; \
  echo "Installing $${missing[*]}"; \
  local install=("$${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "$${missing[@]}"); \
  "$${install[@]}" >/dev/null 2>&1 || { "$${root[@]}" apt-get update -qq; "$${install[@]}" >/dev/null; }; \
}
endef

system:
	@command -v apt-get >/dev/null || exit 0; $(APT_INSTALL); apt_install $(SYSTEM_PACKAGES)

test-system:
	@command -v apt-get >/dev/null || exit 0; $(APT_INSTALL); apt_install $(TEST_PACKAGES)

# A python3 (pyenv's too) that is 3.11 or newer and can make virtual environments; else Debian's with its venv package.
define NEW_VENV
usable() { "$$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; }; \
find_python() { \
  for python in python3.11 python3 python3.12 python3.13 /usr/bin/python3; do \
    if usable "$$python"; then echo "$$python"; return 0; fi; \
  done; \
  return 1; \
}; \
if ! python=$$(find_python); then \
  if command -v apt-get >/dev/null; then apt_install python3 python3-venv; fi; \
  python=$$(find_python) || { echo "Python 3.11 or newer with the module venv is needed." >&2; exit 1; }; \
fi; \
echo "Creating $(VENV) with $$("$$python" --version)"; \
"$$python" -m venv --clear $(VENV)
endef

# uv takes a third of pip's time; pip does it where uv is not to be had or does not reach pip's index.
define INSTALL
pip=($(BIN)/python -m pip --disable-pip-version-check); \
install() { \
  local index; index=$$("$${pip[@]}" config list | sed -n "s/.*[.]index-url='\(.*\)'$$/\1/p" | tail -n 1); \
  if [[ -n "$$index" ]]; then export UV_DEFAULT_INDEX="$$index"; fi; \
  "$${pip[@]}" install --quiet uv >/dev/null 2>&1 \
    && $(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python "$$@" 2>/dev/null \
    || "$${pip[@]}" install --quiet "$$@"; \
}
endef

$(STAMP): pyproject.toml | system
	@$(APT_INSTALL); if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then $(NEW_VENV); fi
	@echo "Installing the Python packages into $(VENV)"
	@$(INSTALL); install --editable '.[dev]'
	@$(BIN)/python -m compileall -q ffsi  # where Python may not write bytecode a run would compile all of it, 0.2 s
	@touch $(STAMP)
