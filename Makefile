# Shortcuts, see docs/development.md.
.PHONY: setup quick test fuzz fuzz-hours soak coverage lint format types ci samples

setup:
	python3 -m venv .venv && .venv/bin/pip install -e '.[all,test]'

quick:
	.venv/bin/pytest -q -m "not slow" -n 2

test:
	.venv/bin/pytest -n 2

fuzz:
	HRCLOG_FUZZ=1 .venv/bin/pytest -n 2

HOURS ?= 1
SEED ?= 0

fuzz-hours:
	.venv/bin/python benchmarks/fuzz.py --minutes $$(( $(HOURS) * 60 )) --seed $(SEED)

soak:
	.venv/bin/python benchmarks/soak.py

coverage:
	.venv/bin/pytest -n 2 --dist worksteal --cov --cov-report=term

lint:
	.venv/bin/ruff check . && .venv/bin/ruff format --check .

format:
	.venv/bin/ruff format . && .venv/bin/ruff check --fix .

types:
	.venv/bin/mypy

ci:
	.ci/run

samples:
	sample_logs/make.sh
