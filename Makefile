# `make demo` and `make test` do all the set-up they need; nothing else has to be installed by hand.
PYTHON ?= python3
VENV := .venv
# two test workers on two cores: each computes on one
export OPENBLAS_NUM_THREADS ?= 1
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: setup demo test acceptance lint docs lock clean
setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "accelbench needs Python 3.11 or newer; say make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

demo: $(STAMP)
	$(BIN)/accelbench demo

test: $(STAMP)
	$(BIN)/pytest -m "not slow and not hardware" -n 2 --dist worksteal

# the long acceptance runs: kills at random moments, fault campaigns, many seeds
acceptance: $(STAMP)
	$(BIN)/pytest -m slow

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright

# the documents as a site in build/site; a warning or a broken link is an error
docs: $(STAMP)
	$(BIN)/python docs/architecture.py docs/pictures/architecture.svg
	$(BIN)/sphinx-build -W --keep-going -q docs build/site
	@echo "build/site/README.html"

lock: $(STAMP)
	$(BIN)/uv pip compile --quiet --generate-hashes --strip-extras --universal --python-version 3.11 --extra dev --no-emit-index-url --no-header -o requirements.lock pyproject.toml

clean:
	rm -rf $(VENV) build *.egg-info
