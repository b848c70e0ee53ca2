# `make demo` and `make test` need Python 3.11 or newer, make and a network to PyPI. Nothing else.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: help environment demo test test-lab test-spark static check house soak accuracy lives learning bench slip-control \
    pose-peers drive-to-empty firmware single-precision docs format clean
.DEFAULT_GOAL := help

help:
	@echo "make demo      a simulated robot: battery test, day, drive home -> demo/report.html"
	@echo "make test      every test but those of the laboratory, of the benchmarks and of Spark"
	@echo "make test-lab  those of the laboratory (simulators, drives on them, publications) and of the benchmarks"
	@echo "make test-spark  those of the Spark stream, which need Java and 0.5 GB more"
	@echo "make static    format and lint, types"
	@echo "make check     static, and the fast tests that the change touches"
	@echo "make soak      the process on the robot for hours, killed and loaded -> benchmarks/on_board.md"
	@echo "make accuracy  estimators against measured data -> benchmarks/accuracy.md"
	@echo "make lives     estimators over lives beyond the test bench -> benchmarks/lives.md"
	@echo "make learning  files that learn from use, without a test -> benchmarks/learning.md"
	@echo "make slip-control  slip control in MuJoCo -> benchmarks/slip_control.md"
	@echo "make pose-peers  pose from wheels and gyro beside robot_localization -> benchmarks/pose_peers.md"
	@echo "make bench     speed beside other packages -> benchmarks/speed.md"
	@echo "make drive-to-empty  range and way home to the metre where robots stopped -> benchmarks/drive_to_empty.md"
	@echo "make firmware  exported filters on an emulated Cortex-M4F -> benchmarks/firmware.md;"
	@echo "               make firmware LIBRARY=DIR LOG=day.csv: a recorded log through an exported library there"
	@echo "make single-precision  the same filters against double precision -> benchmarks/single_precision.md"
	@echo "make house     size of the package by room -> benchmarks/house.md"
	@echo "make docs      the documentation -> docs/_build/html/index.html"

# One stamp for each extra of pyproject.toml (lab, spark), and for each of its groups of packages for those who work on
# ohmward; touched again only when that file changes.
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable

$(VENV)/%.stamp: pyproject.toml | $(VENV)/pip.stamp
	$(INSTALL) '.[$*]'
	@touch $@

$(addprefix $(VENV)/,test.stamp dev.stamp docs.stamp bench.stamp): $(VENV)/%.stamp: pyproject.toml | $(VENV)/pip.stamp
	$(INSTALL) . --group $*
	@touch $@

$(VENV)/pip.stamp:
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "ohmward needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ..."; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade 'pip>=25.1'
	@touch $@

# Small matrices: more threads than one only fight each other, above all when tests run in parallel.
demo test test-lab test-spark check soak accuracy lives learning bench slip-control pose-peers drive-to-empty firmware single-precision docs: export OMP_NUM_THREADS = 1

demo: $(VENV)/lab.stamp
	$(BIN)/ohmward demo --out demo

test: $(VENV)/test.stamp
	$(BIN)/python -m pytest -n auto --dist worksteal --ignore=tests/lab
	@echo "Laboratory (simulators, drives on them, publications) and benchmarks have tests of their own: make test-lab"

test-lab: $(VENV)/test.stamp
	$(BIN)/python -m pytest -n auto --dist worksteal tests/lab

test-spark: $(VENV)/test.stamp $(VENV)/spark.stamp
	$(BIN)/python -m pytest tests/fleet/test_spark.py

environment: $(VENV)/test.stamp $(VENV)/dev.stamp $(VENV)/docs.stamp

static: $(VENV)/dev.stamp
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

check: static
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'not slow' $$($(BIN)/python tests/touched.py)

soak: $(VENV)/test.stamp
	$(BIN)/python benchmarks/on_board.py

format: $(VENV)/dev.stamp
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

accuracy: $(VENV)/test.stamp
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python docs/fill_readme.py

lives: $(VENV)/test.stamp
	$(BIN)/python benchmarks/lives.py

learning: $(VENV)/test.stamp
	$(BIN)/python benchmarks/learning.py

# The packages to compare with are large and pin versions of their own: they get an environment for themselves.
bench:
	@$(MAKE) --no-print-directory VENV=$(VENV)-bench $(VENV)-bench/bench.stamp
	$(VENV)-bench/bin/python benchmarks/speed.py
	$(VENV)-bench/bin/python docs/fill_readme.py

slip-control: $(VENV)/test.stamp
	$(BIN)/python benchmarks/slip_control.py

pose-peers: $(VENV)/test.stamp
	$(BIN)/python benchmarks/pose_peers.py

drive-to-empty: $(VENV)/test.stamp
	$(BIN)/python benchmarks/drive_to_empty.py

firmware: $(VENV)/test.stamp
	$(BIN)/python firmware/measure.py $(LIBRARY) $(LOG) $(OPTIONS)
	$(BIN)/python docs/fill_readme.py

single-precision: $(VENV)/test.stamp
	$(BIN)/python firmware/precision.py

# Needs Python alone.
house:
	@$(PYTHON) benchmarks/house.py

docs: $(VENV)/docs.stamp
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

clean:
	rm -rf $(VENV) $(VENV)-bench demo build dist docs/_build
