# All set-up lives in .venv; `make demo` and `make test` make it when it is missing or stale.

PYTHON ?= python3.11
PY := .venv/bin/python

.PHONY: help setup demo test lint pytest format benchmark site lock release clean

help:
	@echo "make demo       train the mass-spring-damper example and export every target"
	@echo "make test       every check and the whole test suite"
	@echo "make setup      the environment in .venv, from requirements.lock"
	@echo "make lint       ruff, pyright, the import rules and the words of new prose"
	@echo "make format     rewrite the code in the project's format"
	@echo "make benchmark  measure, side by side with a peer"
	@echo "make site       the documentation as a site, in build/site"
	@echo "make lock       write requirements.lock again from pyproject.toml"
	@echo "make release    wheel, sdist, bill of materials and hashes of the tagged commit, in dist"
	@echo "make clean      remove everything that these commands made"

setup:
	@command -v $(PYTHON) >/dev/null || { echo "msnn needs Python 3.11: apt-get install python3.11, or name one with make PYTHON=..." >&2; exit 2; }
	@$(PYTHON) .ci/set_up.py

demo: setup
	@$(PY) examples/mass_spring_damper/demo.py

test: setup
	@$(MAKE) --no-print-directory -j 2 lint pytest  # one core checks types while the other tests

pytest: setup tests/__pycache__
	$(PY) -m pytest -n 3 --dist worksteal  # on two cores: some tests wait for others

# In a fresh clone one process compiles what each of three would, while another checks types.
tests/__pycache__: | setup
	@$(PY) -m pytest --collect-only -q >/dev/null || true  # what is wrong the run tells

lint: setup
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/pyright --pythonpath $(PY)
	.venv/bin/lint-imports
	$(PY) .ci/prose.py

format: setup
	.venv/bin/ruff check --fix
	.venv/bin/ruff format

benchmark: setup
	@for script in $(sort $(wildcard benchmarks/*/run.py)); do echo "== $$script"; $(PY) "$$script" || exit 1; done

site: setup
	$(PY) .ci/site.py

lock: setup
	.venv/bin/uv pip compile pyproject.toml --all-extras --group dev --generate-hashes --upgrade \
		--python-version 3.11 --python-platform x86_64-manylinux_2_28 --prerelease disallow \
		--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" \
		--output-file requirements.lock --quiet

release: setup
	$(PY) .ci/release.py --tagged

clean:
	rm -rf .venv build dist .hypothesis .import_linter_cache .pytest_cache .ruff_cache
	rm -rf examples/*/build examples/*/data examples/*/runs
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
