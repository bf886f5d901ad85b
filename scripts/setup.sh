#!/bin/sh
# Installs the tools that preshade needs on a bare Debian or Ubuntu machine. Leaves installed ones alone.
#
#   setup.sh vulkan       a Vulkan loader, and Mesa's software Vulkan (lavapipe) where no adapter is found
#   setup.sh gl           EGL and OpenGL 4: Mesa's, in software where there is no graphics card
#   setup.sh native       a C compiler and Vulkan's headers, for the hosts of tests/native
#   setup.sh accept       spirv-val, glslangValidator, spirv-cross, and Tint (npm package `webgpu`) for the acceptance tests
#   setup.sh three        Chromium, node and npm, for the page of tests/three
#   setup.sh web          node and npm; and, without rustup's component rust-src, Debian's compiler for WebAssembly
#   setup.sh swiftshader  SwiftShader's Vulkan, a second driver for tests: a part of Chromium's package
#   setup.sh fleet        HyperQueue's Python package in tests/fleet/.venv, and GNU parallel, for the tests of `fleet`
set -eu

have() { command -v "$1" >/dev/null 2>&1; }

install() {
    if ! have apt-get; then
        echo "setup: please install: $*" >&2
        exit 1
    fi
    sudo=""
    [ "$(id -u)" = 0 ] || sudo=sudo
    echo "setup: installing $*" >&2
    $sudo apt-get update -qq
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

vulkan() {
    # A loader and any driver description suffice: wgpu prefers a real driver to lavapipe.
    loader=$(ldconfig -p 2>/dev/null | grep -c 'libvulkan\.so\.1' || true)
    drivers=$(ls /usr/share/vulkan/icd.d /etc/vulkan/icd.d 2>/dev/null | grep -c '\.json$' || true)
    named=${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}
    if [ "$loader" = 0 ] || { [ "$drivers" = 0 ] && [ -z "$named" ]; }; then
        install libvulkan1 mesa-vulkan-drivers
    fi
    have cc || install build-essential
    have c++ || install build-essential
}

native() {
    vulkan
    echo '#include <vulkan/vulkan.h>' | cc -E - >/dev/null 2>&1 || install libvulkan-dev
}

gl() {
    # EGL's loader and a driver.
    loader=$(ldconfig -p 2>/dev/null | grep -c 'libEGL\.so\.1' || true)
    drivers=$(ls /usr/share/glvnd/egl_vendor.d /etc/glvnd/egl_vendor.d 2>/dev/null |
        grep -c '\.json$' || true)
    if [ "$loader" = 0 ] || [ "$drivers" = 0 ]; then
        install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri
    fi
}

accept() {
    have spirv-val || install spirv-tools
    have glslangValidator || install glslang-tools
    have spirv-cross || install spirv-cross
    if ! have node || ! have npm; then install nodejs npm; fi
    here=$(dirname "$0")
    (cd "$here/../tests/accept" && { [ -d node_modules/webgpu ] || npm ci --silent --no-audit --no-fund; })
}

three() {
    if ! have node || ! have npm; then install nodejs npm; fi
    # On Ubuntu the package of that name installs a snap: there, name a browser by CHROMIUM.
    [ -n "${CHROMIUM:-}" ] || have chromium || have chromium-browser || have google-chrome || install chromium
}

web() {
    if ! have node || ! have npm; then install nodejs npm; fi
    # The standard library is compiled from its source: rustup's, `rustup component add rust-src`.
    [ ! -d "$(rustc --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library" ] || return 0
    # Debian packs a recent compiler for browsers (`-web`), the source of its library, and a linker apart.
    if [ ! -d "$(/usr/bin/rustc --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library" ]; then
        install rustc-web cargo-web rust-web-src
    fi
    have wasm-ld || ls /usr/bin/wasm-ld-* >/dev/null 2>&1 || install lld-19
}

swiftshader() {
    folders="/usr/lib/chromium /usr/lib/chromium-browser /usr/lib64/chromium-browser /opt/google/chrome"
    [ -z "${CHROMIUM:-}" ] || folders="$(dirname "$CHROMIUM") $folders"
    for folder in $folders; do
        [ ! -f "$folder/vk_swiftshader_icd.json" ] || return 0
    done
    install chromium
}

fleet() {
    native
    have parallel || install parallel
    packages="$(dirname "$0")/../tests/fleet"
    if ! cmp -s "$packages/requirements.txt" "$packages/.venv/installed"; then
        have python3 && python3 -c 'import ensurepip, venv' 2>/dev/null || install python3 python3-venv
        python3 -m venv --clear "$packages/.venv"
        "$packages/.venv/bin/pip" install --quiet --require-hashes --only-binary :all: -r "$packages/requirements.txt"
        cp "$packages/requirements.txt" "$packages/.venv/installed"
    fi
}

for part in "$@"; do
    case "$part" in
        vulkan) vulkan ;;
        native) native ;;
        gl) gl ;;
        accept) accept ;;
        three) three ;;
        web) web ;;
        swiftshader) swiftshader ;;
        fleet) fleet ;;
        *) echo "setup: unknown part $part" >&2; exit 2 ;;
    esac
done
