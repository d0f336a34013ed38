# make demo   install on first use and write the demonstration report to demo-report/
# make test   run the tests
# make bench  measure speed and error beside ngspice, solve_ivp and NumPy: reports/speed/, table in README.md (10 minutes)
# make paper  simulate and audit the reference paper's tables: reports/paper/index.html, findings.json (5 minutes)
# make recovery  diagnose random campaigns and count the right answers: reports/diagnosis/ (hours; goes on where it was stopped)
# make actuators  hysteresis and frequency responses of two real data sets: reports/actuators (2 minutes; needs ../shared)
# make coverage   do standard errors hold? 200 random specimens: reports/identification (resumes where it was)
# make check  lint and type check
# make clean  remove the environment, caches, builds and the report

PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test bench paper actuators recovery coverage check clean

demo: .venv/.installed
	$(BIN)/piezoharvest demo --out demo-report

test: .venv/.installed
	$(BIN)/python -m pytest -n 2 -q

bench: .venv/.installed
	$(BIN)/python -m reports.speed

paper: .venv/.installed
	$(BIN)/python -m reports.paper

recovery: .venv/.installed
	$(BIN)/python -m reports.diagnosis

actuators: .venv/.installed
	$(BIN)/python -m reports.actuators

coverage: .venv/.installed
	$(BIN)/python -m reports.identification

check: .venv/.installed
	$(BIN)/ruff check .
	$(BIN)/pyright

.venv/.installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,dev]'
	touch $@

clean:
	rm -rf .venv build dist *.egg-info demo-report .pytest_cache .hypothesis .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
