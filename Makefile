# make demo   install on first use and write the demonstration to demo-report/: designed, measured, diagnosed, designed again
# make test   run the quick tests (5 to 10 minutes on two cores)
# make recovery_long  run the long searches for what is missing, which `make test` leaves out and .ci/run runs (a minute)
# make slow   run the tests that take long, which `make test` leaves out (17 minutes on two cores)
# make lowest run a part of the tests with the lowest versions of all dependencies (Python 3.11; 3 to 6 minutes)
# make bench  measure speed and error beside ngspice, solve_ivp and NumPy: reports/speed/, table in docs/validation.md (10 minutes)
# make paper  simulate and audit the reference paper's tables: reports/paper/index.html, findings.json (5 minutes)
# make recovery  diagnose random campaigns and count the right answers: reports/diagnosis/ (hours; goes on where it was stopped)
# make discovery  hide laws that are in no library in random campaigns, count how often they are found: reports/discovery/
#             (days; goes on where it was stopped; `.venv/bin/python -m reports.discovery --first N` for a part of it)
# make actuators  hysteresis and frequency responses of two real data sets: reports/actuators (2 minutes; needs ../shared)
# make coverage   do standard errors hold? 200 random specimens: reports/identification (resumes where it was)
# make torture  simulate random studies of every shunt and effect: reports/reliability (hours; goes on where it was stopped)
# make docs   build the documentation: build/site/index.html (a minute; strict, with its links checked)
# make check  lint and type check
# make clean  remove the environment, caches, builds and the report

PYTHON ?= python3
BIN := .venv/bin

# Tests through which the package meets its dependencies, without those that take long.
MEETING := tests/test_cli.py tests/test_study.py tests/test_linear.py tests/test_packaging.py \
	tests/records/test_readers.py tests/records/test_campaign.py tests/records/test_instrument_formats.py \
	tests/report/test_every_report.py tests/report/test_report_records.py \
	tests/exchange/test_exchange.py tests/explore/test_study_page.py \
	tests/sweep/test_sweep_results.py tests/sweep/test_sweep_dask.py tests/identify/test_identify_cli.py \
	tests/identify/test_loops.py tests/engine/test_vector.py

.PHONY: demo docs test recovery_long slow lowest bench paper actuators recovery discovery torture coverage check clean

demo: .venv/.installed
	$(BIN)/piezoharvest demo --out demo-report

# Where it is set, each of the hundreds of processes that tests start would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE

# One process runs all tests of a file, so that what they share is made once.
test: .venv/.tested
	$(BIN)/python -m pytest -n 2 --dist loadfile -q -m 'not slow and not recovery_long'

recovery_long: .venv/.tested
	$(BIN)/python -m pytest -n 2 -q -m 'recovery_long and not slow' tests/diagnose tests/identify

slow: .venv/.tested
	$(BIN)/python -m pytest -n 2 --dist loadfile -q -m slow

lowest: build/lowest/.installed
	NUMBA_CACHE_DIR=$(CURDIR)/build/lowest/numba build/lowest/bin/python -m pytest -n 2 -q --disable-warnings \
		-m 'not slow and not browser and not spice' $(MEETING)

bench: .venv/.tested
	$(BIN)/python -m reports.speed

paper: .venv/.tested
	$(BIN)/python -m reports.paper

recovery: .venv/.tested
	$(BIN)/python -m reports.diagnosis

discovery: .venv/.discovery
	$(BIN)/python -m reports.discovery

torture: .venv/.tested
	$(BIN)/python -m reports.reliability

actuators: .venv/.tested
	$(BIN)/python -m reports.actuators

coverage: .venv/.tested
	$(BIN)/python -m reports.identification

docs: .venv/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

check: .venv/.checked
	$(BIN)/ruff check .
	$(BIN)/pyright

# What a user needs, with all extras; tests and tools of developers come when they are asked for.
.venv/.installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[all]'
	touch $@

.venv/.tested: .venv/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	touch $@

.venv/.checked: .venv/.tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,dev]'
	touch $@

.venv/.discovery: .venv/.tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[discovery]'
	touch $@

.venv/.docs: .venv/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	touch $@

build/lowest/.installed: pyproject.toml .ci/lowest.txt
	$(PYTHON) -m venv build/lowest
	build/lowest/bin/python -m pip install --quiet --disable-pip-version-check -e '.[test]' -c .ci/lowest.txt
	touch $@

clean:
	rm -rf .venv build dist *.egg-info demo-report .pytest_cache .hypothesis .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
