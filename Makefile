.PHONY: demo test bench setup

# Renders the shrine with the original and its variants, and prints what each costs and gains.
demo:
	scripts/setup.sh vulkan
	cargo build --release -p preshade-cli
	target/release/preshade verify fixtures/scenes/shrine.toml --camera wall --pass depth-prepass --pass depth-prepass:form=equal --pass early-discard --out out/demo

# Everything CI checks: format, lints, docs, tests.
test:
	scripts/setup.sh vulkan gl accept three
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --all-features --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --all-features --no-deps --quiet
	cargo test --workspace --all-features

# The frozen hand-written shaders beside what preshade makes of the same forward entry points, in one process.
bench:
	scripts/setup.sh vulkan
	cargo run --release -p preshade-cli -- bench
