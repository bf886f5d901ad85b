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

# Each page names the command that draws its picture, and whether the shading count is part of it.
for page in docs/passes/*.md; do
  pass=$(basename "$page" .md)
  [ $# -eq 0 ] || [[ " $* " == *" $pass "* ]] || continue
  arguments=$(sed -n 's/^`preshade \(verify [^`]*\)`: .*/\1/p' "$page")
  # shellcheck disable=SC2086
  "$preshade" $arguments --time no --out "$out/$pass" </dev/null
  sheet=$(ls "$out/$pass"/*.sheet.png)
  rows=1
  ! grep -q '^!\[.*how often each pixel is shaded' "$page" || rows=2
  python3 - "$sheet" "$rows" "docs/images/passes/$pass.png" <<'EOF'
import sys
from PIL import Image
sheet = Image.open(sys.argv[1]).convert("RGB")
height = sheet.height * int(sys.argv[2]) // 2
sheet.crop((0, 0, sheet.width, height)).quantize(64).save(sys.argv[3], optimize=True)
EOF
done
ls -l docs/images/passes
