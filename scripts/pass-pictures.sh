#!/usr/bin/env bash
# Draws the pictures of docs/passes: for each pass the sheet that `verify --out` writes, in few colours so that
# the file stays small. Needs Python with Pillow.
# Usage: scripts/pass-pictures.sh [PASS..]
set -euo pipefail
cd "$(dirname "$0")/.."
python3 -c 'import PIL' || { echo "error: Pillow is not installed: pip install pillow" >&2; exit 2; }
preshade=${PRESHADE:-target/release/preshade}
[ -x "$preshade" ] || cargo build --release -p preshade-cli
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# What is drawn of a pass, as its page says it.
awk -F'"' '/" => \($/ { pass = $2 }
  $2 ~ /^preshade verify / { sub(/^preshade /, "", $2); print pass, $2 }' tests/it/pass_pages.rs |
while read -r pass arguments; do
  [ $# -eq 0 ] || [[ " $* " == *" $pass "* ]] || continue
  # shellcheck disable=SC2086
  "$preshade" $arguments --time no --out "$out/$pass" </dev/null
  sheet=$(ls "$out/$pass"/*.sheet.png)
  # Where no shading is saved the row of pictures tells all.
  case $pass in depth-prepass | early-discard | visibility-buffer) rows=2 ;; *) rows=1 ;; esac
  python3 - "$sheet" "$rows" "docs/images/passes/$pass.png" <<'EOF'
import sys
from PIL import Image
sheet = Image.open(sys.argv[1]).convert("RGB")
height = sheet.height * int(sys.argv[2]) // 2
sheet.crop((0, 0, sheet.width, height)).quantize(64).save(sys.argv[3], optimize=True)
EOF
done
ls -l docs/images/passes
