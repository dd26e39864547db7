# `make bench` and `make test` are all that a fresh machine needs: both make the virtual environment first.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: bench test test-kernel test-kernel-short lint types rules check clean

bench: $(VENV)/installed
	$(BIN)/positioner bench --out out/bench

# one worker more than processors: many tests wait for processes of their own
WORKERS ?= $(shell expr $$(nproc) + 1)

# without the tests marked `slow`, which `make test-slow` plays
test: $(VENV)/installed
	$(BIN)/pytest --numprocesses $(WORKERS) --dist worksteal -m 'not slow'

# the tests that take many seconds each; some take a minute of one core, and a busy machine ten of them
.PHONY: test-slow
test-slow: $(VENV)/installed
	$(BIN)/pytest --numprocesses $(WORKERS) --dist worksteal -m slow --override-ini faulthandler_timeout=3600

# SocketCAN, systemd and CAN controllers in kernels of its own, fetched as packages; nothing is installed on the host.
test-kernel: $(VENV)/installed
	$(BIN)/pytest tests/kernel

# the report of a valve in a headless browser (apt-get install chromium): requests, load time, print, pictures of it
.PHONY: test-browser
test-browser: $(VENV)/installed
	$(BIN)/pytest --capture=no tests/browser

# examples/fmu_plant.py plays an FMU that it builds with cc; FMPy is an extra
.PHONY: test-fmu
test-fmu: $(VENV)/installed
	@$(BIN)/python -m pip install --quiet --editable '.[fmu]'
	$(BIN)/pytest tests/fmu

# all documents as a site in out/site, which asks the network for nothing; its tests look at it in a headless browser
.PHONY: site notebooks
site: notebooks
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build
	$(BIN)/pytest tests/site

# the notebooks of examples/ with their results, in out/notebooks
notebooks: $(VENV)/installed
	$(BIN)/python -m documents.notebooks out/notebooks

# the man pages of both programs in out/man, which `make install` installs
.PHONY: man
man: $(VENV)/installed
	$(BIN)/python -m documents.manual out/man

# without the tests that take long in such kernels
test-kernel-short: $(VENV)/installed
	$(BIN)/pytest tests/kernel -m 'not slow'

# everything that CI leaves out, about an hour on two cores; ONLY="soak crash" plays these parts, RESUME=1 what is left
.PHONY: test-all publish-test-all
test-all: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m everything $(if $(ONLY),--only $(ONLY)) $(if $(RESUME),--resume)

# what of it CI does not play, and what stands for it there
.PHONY: left-out
left-out: $(VENV)/installed
	@PYTHONPATH=tests $(BIN)/python -m everything --left-out

# puts the last table of it into docs/tests.md
publish-test-all: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m everything --publish

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed
	$(BIN)/mypy

rules: $(VENV)/installed
	$(BIN)/lint-imports

check: lint types rules test

# everything that tests and the site need, in the versions and with the hashes of the lock: the same on another day
$(VENV)/installed: pyproject.toml requirements/dev.txt
	@echo "Installing $$(grep -c '^[a-z].*==' requirements/dev.txt) packages into $(VENV): a minute or three, without further lines."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip --disable-pip-version-check install --quiet --require-hashes --requirement requirements/dev.txt
	$(BIN)/python -m pip --disable-pip-version-check install --quiet --no-deps --no-build-isolation --editable .
	touch $@

clean:
	rm -rf $(VENV) out build dist

# What `make install` installs, and what tests need: newest versions with the hashes of their files, for every Python and
# processor at once.
# An extra stays in the pin (coverage[toml]==...): pip refuses a requirement with an extra whose own pin has none as soon
# as a newer release is out.
LOCK = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate --no-strip-extras \
	--upgrade --custom-compile-command 'make lock'

.PHONY: lock
lock: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[lock]'
	$(LOCK) pyproject.toml --output-file requirements/run.txt
	$(BIN)/python -c "import tomllib; table = tomllib.load(open('pyproject.toml', 'rb')); \
	    hook = table['tool']['hatch']['build']['targets']['wheel']['hooks']['custom']; \
	    print(*table['build-system']['requires'], *hook['compiler'], sep='\n')" | \
	    $(LOCK) - --output-file requirements/build.txt
	$(LOCK) pyproject.toml requirements/build.txt --constraint requirements/run.txt --extra dev --extra site \
	    --output-file requirements/dev.txt

# The compiled build: as a wheel for $(PYTHON), and in a folder of its own, where the tests of the compiled rooms run.
# Then a bench must give the same frames to the bit as interpreted.
COMPILED = build/compiled
RUN_COMPILED = PYTHONSAFEPATH=1 PYTHONPATH=$(COMPILED) $(BIN)
COMPILED_TESTS = tests/replay tests/cycle tests/setpoint tests/guard tests/laws tests/valve tests/wire tests/optimization \
	tests/plant_emulator tests/config tests/machine tests/store
SHORT_COMPILED_TESTS = tests/replay/test_replay_logs.py tests/cycle tests/guard tests/valve tests/optimization

.PHONY: wheel test-compiled test-compiled-short
wheel:
	POSITIONER_BUILD=compiled $(PYTHON) -m pip --quiet --disable-pip-version-check wheel --no-deps --wheel-dir dist .
	@ls dist/*.whl

test-compiled-short: $(COMPILED)/installed
	$(RUN_COMPILED)/positioner --version | grep compiled
	$(RUN_COMPILED)/pytest --numprocesses $(WORKERS) --dist worksteal -m 'not interpreted and not slow' $(SHORT_COMPILED_TESTS)

test-compiled: $(COMPILED)/installed
	$(RUN_COMPILED)/positioner --version | grep compiled
	$(RUN_COMPILED)/pytest --numprocesses $(WORKERS) --dist worksteal -m 'not interpreted' $(COMPILED_TESTS)
	$(RUN_COMPILED)/positioner bench --out out/compiled
	$(BIN)/positioner bench --out out/interpreted
	cmp out/compiled/bus.log out/interpreted/bus.log

$(COMPILED)/installed: $(VENV)/installed $(shell find building positioner plant_emulator dbc -name '*.py' -o -name '*.dbc')
	rm -rf $(COMPILED)
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --target $(COMPILED) .
	touch $@

# What a package index would get: the interpreted wheel, which is one for every machine, built from the source archive.
DIST = dist

.PHONY: dist
dist: $(VENV)/installed
	rm -f $(DIST)/sticking_valve_positioner-*.tar.gz $(DIST)/sticking_valve_positioner-*-none-any.whl
	POSITIONER_BUILD=pure $(BIN)/python -m build --no-isolation --outdir $(DIST)
	$(BIN)/twine --no-color check --strict $(DIST)/*.tar.gz $(DIST)/*-none-any.whl

# `make install` as root: a virtual environment with the positioner, its units, and examples of network files. Nothing is
# installed but what the lock files name, with its hash.
PREFIX ?= /opt/positioner
DESTDIR ?=
# the system's own: a service has no way into anybody's home directory, where a version manager keeps its interpreters
INSTALL_PYTHON ?= $(or $(wildcard /usr/bin/python3),$(PYTHON))
INSTALLED = $(DESTDIR)$(PREFIX)
INSTALL = '$(INSTALLED)/bin/python' -m pip --quiet --disable-pip-version-check install
BUILD_TOOLS = $(INSTALLED)/build-tools
SHARE = $(INSTALLED)/share/positioner
UNIT_DIRECTORY = $(DESTDIR)/etc/systemd/system
COMMANDS = $(DESTDIR)/usr/local/bin
LOCAL_SHARE = $(DESTDIR)/usr/local/share
MAN = $(LOCAL_SHARE)/man/man1
UNITS = positioner@.service plant-emulator@.service vcan0.service
PROGRAMS = positioner plant-emulator
# for each program what bash, zsh and fish need to complete its command lines
COMPLETIONS = $(foreach program,$(PROGRAMS),bash-completion/completions/$(program) zsh/site-functions/_$(program) \
	fish/vendor_completions.d/$(program).fish)

.PHONY: install
install:
	@if [ -e '$(INSTALLED)' ] && [ ! -e '$(INSTALLED)/pyvenv.cfg' ]; then \
	    echo 'make install: $(INSTALLED) is there and was not made by it; choose another PREFIX' >&2; exit 1; fi
	@case "$$('$(INSTALL_PYTHON)' -c 'import sys; print(sys.base_prefix)')" in /home/*|/root/*) \
	    echo 'make install: no service can run a Python in a home directory; give INSTALL_PYTHON=/usr/bin/python3' >&2; \
	    exit 1;; esac
	umask 022; '$(INSTALL_PYTHON)' -m venv --clear '$(INSTALLED)'
	umask 022; $(INSTALL) --target '$(BUILD_TOOLS)' --require-hashes --requirement requirements/build.txt
	umask 022; $(INSTALL) --require-hashes --requirement requirements/run.txt
	umask 022; PYTHONPATH='$(BUILD_TOOLS)' $(INSTALL) --no-deps --no-index --no-build-isolation .
	rm -rf '$(BUILD_TOOLS)'
	'$(INSTALLED)/bin/python' -m pip check
	[ -z '$(DESTDIR)' ] || grep -rlI '$(INSTALLED)' '$(INSTALLED)/bin' '$(INSTALLED)/pyvenv.cfg' | \
	    xargs --no-run-if-empty sed -i 's|$(INSTALLED)|$(PREFIX)|g'
	install -d '$(SHARE)' '$(UNIT_DIRECTORY)' '$(COMMANDS)' '$(DESTDIR)/etc/positioner'
	install -m 644 systemd/bus.conf systemd/realtime.conf systemd/serial.conf systemd/network/* '$(SHARE)'
	for unit in $(UNITS); do \
	    sed 's|/opt/positioner/|$(PREFIX)/|' "systemd/$$unit" > '$(UNIT_DIRECTORY)'/"$$unit"; \
	    chmod 644 '$(UNIT_DIRECTORY)'/"$$unit"; done
	for program in $(PROGRAMS); do ln -sfn "$(PREFIX)/bin/$$program" '$(COMMANDS)'/"$$program"; done
	umask 022; '$(INSTALLED)/bin/python' -B -m documents.manual '$(MAN)'
	umask 022; '$(INSTALLED)/bin/python' -P building/completions.py '$(LOCAL_SHARE)'
	[ -n '$(DESTDIR)' ] || [ ! -d /run/systemd/system ] || systemctl daemon-reload
	@echo 'installed in $(INSTALLED); units in $(UNIT_DIRECTORY); configurations go to $(DESTDIR)/etc/positioner'

.PHONY: uninstall
uninstall:
	@if [ -e '$(INSTALLED)' ] && [ ! -e '$(INSTALLED)/pyvenv.cfg' ]; then \
	    echo 'make uninstall: $(INSTALLED) was not made by make install' >&2; exit 1; fi
	@if [ -z '$(DESTDIR)' ] && [ -d /run/systemd/system ]; then \
	    running=$$(systemctl list-units --plain --no-legend --state=active,activating \
	        'positioner@*' 'plant-emulator@*' vcan0.service | cut -d' ' -f1 | xargs); \
	    if [ -n "$$running" ]; then \
	        echo "make uninstall: still running; first: sudo systemctl disable --now $$running" >&2; exit 1; fi; fi
	for program in $(PROGRAMS); do \
	    [ "$$(readlink '$(COMMANDS)'/"$$program")" != "$(PREFIX)/bin/$$program" ] || rm '$(COMMANDS)'/"$$program"; done
	for unit in $(UNITS); do rm -f '$(UNIT_DIRECTORY)'/"$$unit"; done
	for program in $(PROGRAMS); do rm -f '$(MAN)'/"$$program".1 '$(MAN)'/"$$program"-*.1; done
	for completion in $(COMPLETIONS); do rm -f '$(LOCAL_SHARE)'/"$$completion"; done
	rm -rf '$(INSTALLED)'
	[ -n '$(DESTDIR)' ] || [ ! -d /run/systemd/system ] || systemctl daemon-reload
	@echo 'removed; kept: $(DESTDIR)/etc/positioner (configurations) and $(DESTDIR)/var/lib/positioner (what was learned)'


# A Debian package of the same installation, for machines with the Python of this one. The same clone gives the same bits.
DEB_ROOT = $(abspath build/deb)
DEB = $(DIST)/sticking-valve-positioner.deb
DEB_DIRECTORIES = COMMANDS='$(DEB_ROOT)/usr/bin' UNIT_DIRECTORY='$(DEB_ROOT)/usr/lib/systemd/system' \
	LOCAL_SHARE='$(DEB_ROOT)/usr/share'

.PHONY: deb
deb image: export SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || date +%s)
deb: export PIP_NO_COMPILE = 1
deb:
	rm -rf '$(DEB_ROOT)'
	$(MAKE) install DESTDIR='$(DEB_ROOT)' PREFIX=/opt/positioner $(DEB_DIRECTORIES)
	building/debian/build '$(DEB_ROOT)' $(DEB)

# The package in a small Debian, as an OCI image: no image is fetched, and no daemon runs.
.PHONY: image
image: deb
	building/image $(DEB) $(DIST)/positioner.oci.tar

# Both, in a root of their own: minutes, as root. The short form checks the layout of an image without a Debian.
.PHONY: test-packages test-packages-short
test-packages: $(VENV)/installed image
	$(BIN)/pytest tests/debian

test-packages-short: $(VENV)/installed
	$(BIN)/pytest tests/debian/test_image_layout.py

# 1.3 million hostile frames, then the decoder under a fuzzer that follows its branches.
.PHONY: fuzz
fuzz: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m endurance.fuzz
	@$(BIN)/python -m pip install --quiet --editable '.[fuzz]' \
		|| { echo "fuzz: atheris has no wheel for $$($(BIN)/python --version); use Python 3.11 or 3.12" >&2; exit 1; }
	PYTHONPATH=tests $(BIN)/python -m endurance.fuzz_decoder -runs=3000000

# 2.1 million damaged files for everything that reads one: an hour on two cores.
.PHONY: fuzz-files
fuzz-files: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m endurance.fuzz_files --keep out/fuzz-files

# What must never fail: every branch of it is run by its own tests, and no change of it escapes them.
GUARDED = positioner/guard/supervisor.py positioner/guard/settings.py positioner/guard/state.py positioner/guard/arming.py \
	positioner/guard/manual.py positioner/cycle/handover.py positioner/guard/stall.py positioner/bus/arrivals.py positioner/cycle/frame_period.py \
	positioner/cycle/inbox.py positioner/cycle/link.py positioner/cycle/command_effect.py positioner/cycle/second_daemon.py positioner/cycle/plausibility.py positioner/cycle/frozen.py \
	positioner/cycle/deviation.py positioner/cycle/full_push.py positioner/cycle/hunting.py positioner/cycle/vain_pushes.py positioner/cycle/counters.py \
	positioner/wire/e2e.py positioner/wire/window.py positioner/wire/loop_current.py plant_emulator/device.py
GUARDING = tests/guard/test_guard.py tests/guard/test_guard_tables.py tests/cycle/test_inbox.py tests/cycle/test_plausibility.py \
	tests/cycle/test_counters.py tests/wire/test_loop_current.py tests/wire/test_wire_e2e.py tests/plant_emulator/test_device.py tests/cycle/test_cycle.py tests/cycle/test_sent.py \
	tests/cycle/test_handover.py tests/wire/test_wire_window.py tests/cycle/test_frozen.py tests/cycle/test_deviation.py tests/cycle/test_full_push.py tests/cycle/test_hunting.py tests/cycle/test_vain_pushes.py tests/cycle/test_command_effect.py tests/setpoint/test_setpoint_loop.py \
	tests/guard/test_stall.py tests/guard/test_ages.py tests/guard/test_arming.py tests/cycle/test_second_daemon.py tests/cycle/test_frame_period.py tests/cycle/test_sample_period.py tests/runtime/test_double_arming.py tests/bus/test_arrivals.py

empty :=
space := $(empty) $(empty)
comma := ,

CYCLE = positioner/cycle/step.py positioner/cycle/state.py positioner/cycle/sent.py positioner/cycle/control.py positioner/cycle/outbox.py

.PHONY: coverage
coverage: $(VENV)/installed
	$(BIN)/pytest -q --numprocesses $(WORKERS) --dist worksteal --cov --cov-report= $(GUARDING)
	$(BIN)/coverage report --show-missing --fail-under=100 \
		--include=$(subst $(space),$(comma),$(strip $(GUARDED) $(CYCLE)))

# takes every reaction of SAFETY.md's table away, one at a time, and sees the named test fail
.PHONY: reactions
reactions: $(VENV)/installed
	PYTHONPATH=.:tests $(BIN)/python -m endurance.reactions

# The limits of the stiction table and of the daemon, at full length; `make test` and `make test-slow` run short forms.
ENDURANCE = PYTHONPATH=tests $(BIN)/python -m endurance
SOAK_SECONDS ?= 3600

.PHONY: crash-test
crash-test: $(VENV)/installed
	$(ENDURANCE).crash

# sensors that freeze, dither and come double, actuators that die, turn round and stick: each is told within 2 s
.PHONY: fault-test
fault-test: $(VENV)/installed
	$(ENDURANCE).faults

# How exactly `positioner identify` finds out what emulated valves are, and how often its intervals contain the truth
.PHONY: identify-acceptance
identify-acceptance: $(VENV)/installed
	$(BIN)/python tests/commissioning/acceptance_identify.py $(ARGS)

# Every goal of commissioning and diagnostics on emulated valves, with its figure: docs/commissioning-results.md
.PHONY: diagnostics-test
diagnostics-test: $(VENV)/installed
	$(BIN)/python tests/diagnostics/results_page.py $(ARGS)

# Stalls of the process: 10,000 on a virtual clock, 200 by SIGSTOP.
.PHONY: stall-test
stall-test: $(VENV)/installed
	$(ENDURANCE).stalls

.PHONY: soak
soak: $(VENV)/installed
	SOAK_SECONDS=$(SOAK_SECONDS) $(ENDURANCE).soak

# A daemon whose bus goes away and comes back for two thirds of a day of its own time: nothing piles up.
.PHONY: leak-test
leak-test: $(VENV)/installed
	$(ENDURANCE).leak

# A thousand restarts of a daemon after faults, under held requests, with its last commands still in the transmit queue.
.PHONY: restart-test
restart-test: $(VENV)/installed
	$(ENDURANCE).restarts

# Every kind of system call of a daemon fails or waits, one occasion a run.
.PHONY: syscall-test
syscall-test: $(VENV)/installed
	PYTHONPATH=tests:tests/kernel $(BIN)/python -m endurance.syscall_faults

# How long a cycle takes, and a plan beside other programs' plans of the same move; tables and picture in out/benchmark.
.PHONY: benchmark
benchmark: $(VENV)/installed $(COMPILED)/installed
	@$(BIN)/python -m pip install --quiet --editable '.[benchmark]'
	PYTHONPATH=tests $(BIN)/python -m benchmarks --out out/benchmark

# puts the picture and the tables of the last `make benchmark` into docs/
.PHONY: publish-benchmark
publish-benchmark: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m benchmarks --out out/benchmark --publish

# The instructions of a cycle, counted by valgrind: they may change by 5 % at most, or are accepted again.
.PHONY: instructions accept-instructions
instructions: $(VENV)/installed $(COMPILED)/installed
	PYTHONPATH=tests $(BIN)/python -m benchmarks.instructions

accept-instructions: $(VENV)/installed $(COMPILED)/installed
	PYTHONPATH=tests $(BIN)/python -m benchmarks.instructions --accept

# Thousands of dwells of valves drawn at random, judged by their tails: docs/robustness.md. The short form is CI's.
ROBUSTNESS = $(RUN_COMPILED)/positioner robustness
ACCEPTED = tests/robustness/accepted.json

.PHONY: robustness robustness-short accept-robustness
robustness: $(COMPILED)/installed
	$(ROBUSTNESS) --out out/robustness $(ARGS)

robustness-short: $(COMPILED)/installed
	$(ROBUSTNESS) --short --laws nmpc --accepted $(ACCEPTED) --out out/robustness-short

accept-robustness: $(COMPILED)/installed
	$(ROBUSTNESS) --short --laws nmpc --accept $(ACCEPTED) --out out/robustness-short

# The memory that a replay takes, for a log of 100,000 and one of a million frames.
.PHONY: long-replay
long-replay: $(VENV)/installed
	$(ENDURANCE).long_replay

# How much faster two workers play a campaign than one; on a machine that nobody else uses.
.PHONY: campaign-speed
campaign-speed: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m benchmarks.campaign_speed

.PHONY: accept-logs
accept-logs: $(VENV)/installed
	$(BIN)/pytest --accept-logs tests/replay/test_replay_logs.py

# Changes the guarded modules in every way that mutmut knows; their tests find each change.
.PHONY: mutants
mutants: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[mutants]'
	rm -rf mutants
	PYTHONPATH=tests $(BIN)/python -m endurance.mutants
