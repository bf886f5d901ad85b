.PHONY: demo check test web hosts web-tests three-tests page-tests playground-tests bevy promises captures frames gains bench audit dist fuzz docs

# Draws the shrine with the original and its variants, and prints the cost and gain of each. The features
# left out read other dialects of WGSL, which the shrine does not use.
demo:
	scripts/setup.sh vulkan
	cargo build --profile demo -p preshade-cli --no-default-features
	target/demo/preshade verify fixtures/scenes/shrine.toml --camera wall --variant depth-prepass \
		--variant depth-prepass:form=equal --variant early-discard --out out/demo

# Format, lints and the tests that need no adapter, browser, npm or root, but for those that take seconds each: after
# a change, about a minute.
check:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --all-features --quiet -- -D warnings
	cargo check -p preshade-cli --no-default-features --quiet
	cargo test --workspace --all-features --quiet --lib --bins --test it -- --skip slow::

# Everything that CI checks: format, lints, docs, all tests. Installs missing tools on Debian and Ubuntu. With an
# example the docs need the packages as clippy has checked them; without, 60 are checked again with other features.
test:
	scripts/setup.sh vulkan native gl accept three swiftshader fleet
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --all-features --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --all-features --no-deps --lib --example rewrite --quiet
	scripts/test.sh

# Builds the npm package in hosts/web: the compiler as WebAssembly. From nothing it takes minutes of both cores.
# `npm pack` in hosts/web then makes the tarball.
web:
	scripts/setup.sh web
	cd hosts/web && npm ci --ignore-scripts --no-audit --no-fund --silent
	hosts/web/build.sh

# Builds the hosts, compares them with the command line on every fixture, and tests the package for three.js and the
# playground in Chromium, and the plugin for Bevy. Two at a time: each has minutes in which it uses one core, where a
# linker, a browser or npm works alone. What a command prints comes when it has ended.
hosts:
	scripts/setup.sh web vulkan three
	$(MAKE) --jobs=2 --output-sync=line bevy three-tests web-tests playground-tests page-tests

# The program is what the tests of the command line run, as `make test` has built it: `cargo build` would build naga,
# the parser of GLSL and the compiler again, without the features that only tests ask of their packages.
web-tests: web
	cargo test --workspace --all-features --quiet --no-run --test it
	cd hosts/web && npx prettier --check . && npm test

three-tests: web
	cd hosts/three && npm ci --ignore-scripts --no-audit --no-fund --silent && npm run --silent packages
	cd hosts/three && npx prettier --check . && npm test
	cd hosts/three/tests/fiber && npm ci --ignore-scripts --legacy-peer-deps --no-audit --no-fund --silent && npm test

page-tests: web
	cd tests/three && npm ci --ignore-scripts --no-audit --no-fund --silent
	cd tests/three && npx prettier --check . && node test.mjs ../../out/three

playground-tests: web
	cd hosts/playground && npm ci --ignore-scripts --no-audit --no-fund --silent
	cd hosts/playground && npx prettier --check . && npm run build && npm test

# Builds and tests the plugin for Bevy: from nothing, two cores take five minutes.
bevy:
	scripts/setup.sh vulkan
	cd hosts/bevy && cargo fmt --check && cargo test --quiet --locked

# Draws every fixture through every recipe that a pass declares, on the adapter at hand, and prints broken
# promises. PRESHADE_ADAPTER and VK_DRIVER_FILES select another adapter. 16 cores take minutes, 2 half an hour.
promises:
	scripts/setup.sh vulkan
	cargo run --release -p preshade-cli -- verify fixtures --every-pass --size 160x90

# Records pages of libraries from npm, replays each on SwiftShader and llvmpipe, verifies two variants of its
# materials, and writes the tables of docs/results/captures.md. DEMOS names a folder of checkouts for more
# pages: see tests/capture/survey/demos.mjs. It takes an hour.
captures:
	scripts/setup.sh vulkan three swiftshader
	cargo build --release --all-features -p preshade-cli
	cargo build --release --all-features --example captures
	cd tests/capture && npm ci --ignore-scripts
	cd tests/capture/survey && npm ci --ignore-scripts --legacy-peer-deps
	cd tests/capture/survey && node survey.mjs $(if $(DEMOS),--demos $(abspath $(DEMOS)))
	cd tests/capture/survey && node survey.mjs --cost

# Clones pages that others wrote at pinned commits, records one frame of each into target/frames, and says which differ
# from tests/capture/survey/frames.json. FRAMES names some of them, DEMOS a folder for the clones. It takes half an hour.
frames:
	scripts/setup.sh vulkan three swiftshader
	cargo build --release --all-features -p preshade-cli
	cd tests/capture && npm ci --ignore-scripts
	cd tests/capture/survey && npm ci --ignore-scripts --legacy-peer-deps
	cd tests/capture/survey && node frames.mjs $(if $(DEMOS),--demos $(abspath $(DEMOS))) $(FRAMES)

# Profiles and plans the recorded frames on ADAPTER, and writes the results as NAME into docs/results/workload.
gains:
	cargo build --release --all-features -p preshade-cli
	scripts/gains.sh target/release/preshade target/gains "$(ADAPTER)" target/frames/*/*
	cd tests/capture/survey && node gains.mjs ../../../target/gains $(NAME)

# Times frozen hand-written shaders beside those that preshade generates from the same entry points.
bench:
	scripts/setup.sh vulkan
	cargo run --release -p xtask -- bench

# Checks advisories, licences and sources of all dependencies, the oldest promised compiler, and the public
# API against the last release. `test` leaves this out because the tools take minutes to build.
audit:
	command -v cargo-deny >/dev/null || cargo install cargo-deny --locked
	cargo deny --all-features check
	scripts/msrv.sh
	scripts/features.sh
	scripts/semver.sh

# Builds what a release offers for Linux, into dist/VERSION: the program for glibc 2.31, the list of its dependencies,
# and checksums. From nothing, two cores take a quarter of an hour.
dist:
	scripts/dist.sh

# Fuzzes each target for SECONDS seconds, from seeds made of the fixtures. Needs `cargo install cargo-fuzz`.
# Crashing inputs are written to fuzz/artifacts.
SECONDS ?= 300
fuzz:
	cd fuzz && cargo run --release --features verify --bin seeds
	cd fuzz && for target in wgsl glsl scene plan recipes ir module; do \
		words=dictionaries/$$target.dict; \
		RUSTC_BOOTSTRAP=1 cargo fuzz run --features verify --sanitizer none $$target -- \
			$$(test -f $$words && echo -dict=$$words) -max_total_time=$(SECONDS) -max_len=16384 -timeout=25 -rss_limit_mb=1536 || exit 1; \
	done

# Builds the documentation as a book in target/book. Installs mdBook, without its server and search, if it
# is missing.
docs:
	scripts/links.py
	command -v mdbook >/dev/null || cargo install mdbook --locked --no-default-features
	mdbook build docs
