.PHONY: demo test bench audit fuzz docs setup

# Renders the shrine with the original and its variants, and prints what each costs and gains.
demo:
	scripts/setup.sh vulkan
	cargo build --release -p preshade-cli
	target/release/preshade verify fixtures/scenes/shrine.toml --camera wall --variant depth-prepass --variant depth-prepass:form=equal --variant early-discard --out out/demo

# Everything CI checks: format, lints, docs, tests.
test:
	scripts/setup.sh vulkan gl accept three
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --all-features --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --all-features --no-deps --quiet
	scripts/test.sh

# The frozen hand-written shaders beside what preshade makes of the same forward entry points, in one process.
bench:
	scripts/setup.sh vulkan
	cargo run --release -p preshade-cli -- bench

# Advisories, licences and sources of all dependencies, the oldest compiler that is promised, and the public API against the last release. The tools take minutes to build, so this is apart from `test`.
audit:
	command -v cargo-deny >/dev/null || cargo install cargo-deny --locked
	command -v cargo-semver-checks >/dev/null || cargo install cargo-semver-checks --locked
	cargo deny --all-features check
	scripts/msrv.sh
	scripts/features.sh
	cargo semver-checks --workspace --exclude preshade-cli || test -z "$$(git tag --list 'v*')"

# Each fuzzing target for SECONDS seconds, from seeds made of the fixtures. Needs `cargo install cargo-fuzz`; what is found is in fuzz/artifacts.
SECONDS ?= 300
fuzz:
	cd fuzz && cargo run --release --features verify --bin seeds
	cd fuzz && for target in wgsl glsl scene plan recipes ir module; do \
		words=dictionaries/$$target.dict; \
		RUSTC_BOOTSTRAP=1 cargo fuzz run --features verify --sanitizer none $$target -- $$(test -f $$words && echo -dict=$$words) \
			-max_total_time=$(SECONDS) -max_len=16384 -timeout=25 -rss_limit_mb=1536 || exit 1; \
	done

# The documentation as a book in target/book. mdBook is installed if it is missing, without its server and search.
docs:
	scripts/links.py
	command -v mdbook >/dev/null || cargo install mdbook --locked --no-default-features
	mdbook build docs
