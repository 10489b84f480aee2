# make demo: install, build, run the main job on the phantom patient.   make test: install, build, test.
SHELL := /bin/bash
BUILD := build/release
JOBS ?= $(shell nproc)
BIN := $(BUILD)/bin

.PHONY: all deps build demo test bench bench-recording bench-viewer screenshots accuracy fuzz asan tsan tidy campaign campaign-cases campaign-chain campaign-check campaign-daemon campaign-splints package check-package format clean

all: build

deps:
	@bash packaging/install-deps.sh

$(BUILD)/build.ninja: CMakeLists.txt CMakePresets.json
	@cmake --preset release

build: deps
	@cmake --preset release > /dev/null
	@cmake --build $(BUILD) -j $(JOBS)

demo: deps
	@cmake --preset release > /dev/null
	@cmake --build $(BUILD) -j $(JOBS) --target gnathion gnathion-viewer
	@$(BIN)/gnathion demo --out demo --force

test: build
	@ctest --test-dir $(BUILD) --output-on-failure -j $(JOBS)

bench: build
	@$(BIN)/gnathion_bench --benchmark_counters_tabular=true

# Two cameras for a minute without loss, replay of that, and a hundred kills.
bench-recording: build
	@$(BIN)/recording_campaign $(BUILD)/recording_campaign.mcap; rm -f $(BUILD)/recording_campaign.mcap
	@$(BIN)/recording_kill_test 100

# The viewer on the demo case: pictures of the handbook; opening, frame rate and pauses (docs/viewer.md).
VIEWER_TOUR := xvfb-run -a -s "-screen 0 1920x1080x24" $(BIN)/viewer_tour
screenshots: deps
	@cmake --preset release > /dev/null
	@cmake --build $(BUILD) -j $(JOBS) --target gnathion viewer_tour
	@$(BIN)/gnathion demo --cbct --out $(BUILD)/pictured --force && $(VIEWER_TOUR) $(BUILD)/pictured --pictures docs/pictures

bench-viewer: demo
	@cmake --build $(BUILD) -j $(JOBS) --target viewer_tour && $(VIEWER_TOUR) demo --bench

# Corners, poses, speed and latency beside libapriltag, ArUco and solvePnP: the tables of docs/accuracy.md.
accuracy: build
	@$(BIN)/accuracy

FUZZERS := $(patsubst tests/fuzz/%_fuzz.cc,%,$(wildcard tests/fuzz/*_fuzz.cc))
fuzz: deps
	@cmake --preset fuzz > /dev/null && cmake --build build/fuzz -j $(JOBS) --target $(FUZZERS:%=%_fuzz)
	@for t in $(FUZZERS); do mkdir -p build/fuzz/corpus/$$t; \
	  build/fuzz/bin/$${t}_fuzz -max_total_time=60 -rss_limit_mb=2048 build/fuzz/corpus/$$t tests/fuzz/corpus/$$t || exit 1; done

# The long form of the tests: every real jaw pair with every transformation, at 0.1 and 0.2 mm.
campaign: build
	@$(BIN)/e2e_design_real_test --gtest_also_run_disabled_tests
	@GNATHION_CAMPAIGN=1 $(BIN)/e2e_virtual_print_phantom_test --gtest_also_run_disabled_tests
	@GNATHION_CAMPAIGN=1 $(BIN)/e2e_splint_gates_test
	@GNATHION_CAMPAIGN=1 xvfb-run -a -s "-screen 0 1280x800x24" $(BIN)/viewer_live_test

# Splints for fresh virtual patients and random T_th, to 5 mm and 8°, on either arch.
campaign-splints: build
	@$(BIN)/splint_campaign --cases $(SEEDS) && $(BIN)/splint_campaign --cases 40 --arch mandible

# The chain on fresh virtual patients, at TP, at 25° and with repeated scans; two intraoral scans on the real jaws.
SEEDS ?= 200
campaign-chain: build
	@$(BIN)/chain_campaign --seeds $(SEEDS) --anatomies 10 --film && $(BIN)/chain_campaign --seeds 50 --anatomies 5 --open
	@$(BIN)/chain_campaign --seeds 50 --anatomies 5 --repeats 2
	@$(BIN)/scans_campaign --cases 500 && $(BIN)/scans_campaign --cases 60 --tissue 0.3 --missing 2 --coarse 1.0

# Runs of a case killed 200 times.
campaign-cases: build
	@GNATHION_KILL_ROUNDS=40 $(BIN)/pipeline_test --gtest_filter='Steps.Killed*' && GNATHION_KILLS=200 $(BIN)/e2e_case_run_test

# The daemon's long forms: latency, 10,000 calls, 200 kills, a day of poses.
campaign-daemon: build
	@$(BIN)/daemon_campaign all

# A Debian package: build/release/gnathion_*.deb
package: build
	@cd $(BUILD) && cpack -G DEB

# The package under a systemd of its own: install, work, crash, upgrade, remove (root; tests/packaging).
check-package: package
	@$(BIN)/gnathion demo --out $(BUILD)/packaged --force --quiet
	@bash tests/packaging/service_check.sh $$(ls -t $(BUILD)/gnathion_*.deb | head -1) $(BUILD)/packaged

# The constraints on fresh virtual patients, half of the transformations made to violate one.
campaign-check: build
	@$(BIN)/check_campaign --seeds $(SEEDS)

asan tsan: deps
	@cmake --preset $@ > /dev/null && cmake --build build/$@ -j $(JOBS) && ctest --test-dir build/$@ --output-on-failure

tidy: deps
	@cmake --preset tidy > /dev/null && cmake --build build/tidy -j $(JOBS)

format:
	@git ls-files '*.h' '*.cc' | xargs clang-format-14 -i

clean:
	@rm -rf build
