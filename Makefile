# Two commands on a fresh machine: `make demo` and `make test`. Python 3.11+ and nothing else.
# The commands behind them, for machines without make, are in README.md.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO ?= demo

.PHONY: demo test test-fast check package format bench clean

demo: $(VENV)/.installed
	mkdir -p $(DEMO)
	$(BIN)/civil-rgbd simulate $(DEMO)/demo.mcap --overwrite
	$(BIN)/civil-rgbd build --recipe 250k --overwrite --licence CC0-1.0 --out $(DEMO)/dataset $(DEMO)/demo.mcap
	$(BIN)/civil-rgbd validate $(DEMO)/dataset
	$(BIN)/civil-rgbd info $(DEMO)/dataset
	$(BIN)/python docs/make_picture.py $(DEMO)/dataset $(DEMO)/frame_and_depth.png
	@echo "Look at $(DEMO)/frame_and_depth.png, and at the bridge folder $(DEMO)/dataset/bridges/demo"

test: check package
	$(BIN)/pytest -n 2

test-fast: $(VENV)/.installed-dev
	$(BIN)/pytest -n 2 -m "not slow"

# mypy looks at the package as it is installed: three of its folders lie elsewhere in the repository.
check: $(VENV)/.installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	rm -rf $(VENV)/typed
	$(BIN)/pip install --quiet --no-deps --target $(VENV)/typed .
	cd $(VENV)/typed && ../bin/mypy --config-file ../../pyproject.toml -p civil_rgbd
	$(BIN)/codespell

# The wheel, in a bare environment, from another folder: what a user of PyPI gets.
package: $(VENV)/.installed-dev
	rm -rf build dist
	$(BIN)/python -m build --quiet
	rm -rf $(VENV)/bare
	$(PYTHON) -m venv $(VENV)/bare
	$(VENV)/bare/bin/pip install --quiet dist/*.whl
	wheel_out=$$(mktemp -d) && bare=$$(pwd)/$(VENV)/bare/bin && cd / \
		&& $$bare/civil-rgbd build --recipe demo --out $$wheel_out \
		&& $$bare/civil-rgbd validate $$wheel_out \
		&& rm -rf $$wheel_out

format: $(VENV)/.installed-dev
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# By hand: ratios against named peers. `pip install -e '.[bench]'` for Open3D.
bench: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/render.py
	$(BIN)/python benchmarks/build.py
	$(BIN)/python benchmarks/load.py
	$(BIN)/python benchmarks/containers.py

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -e .
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints-test.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -e '.[dev]' -c constraints-test.txt
	touch $@ $(VENV)/.installed

clean:
	rm -rf build dist $(VENV) $(DEMO)
