#!/usr/bin/env python3
"""Composes docs/images/shrine-wall.png, the README's picture, of the pictures that `preshade verify` writes and of
the times in docs/results/h200-shrine.json. Needs Pillow.

    preshade verify fixtures/scenes/shrine.toml --camera wall --size 960x540 --frames 1 --order front-to-back \\
        --time no --variant depth-prepass --out out/shrine
    scripts/readme-picture.py out/shrine
"""
import json
import sys
from pathlib import Path

from PIL import Image, ImageChops, ImageDraw, ImageFont

root = Path(__file__).resolve().parent.parent
folder = Path(sys.argv[1])
report = json.loads((root / "docs/results/h200-shrine.json").read_text())
variants = report if isinstance(report, list) else report["variants"]


def record(name):
    """The variant's record: its headline view is the wall, front to back."""
    return next(v for v in variants if v["name"] == name)


def picture(name):
    return Image.open(folder / name).convert("RGB")


original, variant = record("original"), record("depth-prepass")
differing = ImageChops.difference(picture("original.png"), picture("depth-prepass.png")).convert("L")
changed = sum(differing.histogram()[1:])
panels = [
    ("original.png", "the picture", f"{changed} pixels changed"),
    ("original.overdraw.png", f"as written: shaded {original['shaded_per_pixel']:.1f} times a pixel",
     f"{original['time_ms']['median']:.2f} ms"),
    ("depth-prepass.overdraw.png", f"depth-prepass: {variant['shaded_per_pixel']:.1f} times",
     f"{variant['time_ms']['median']:.2f} ms"),
]
width, height, bar = 480, 270, 62
sheet = Image.new("RGB", (3 * width + 20, height + bar), "#16242c")
draw = ImageDraw.Draw(sheet)
for i, (name, caption, figure) in enumerate(panels):
    left = i * (width + 10)
    sheet.paste(picture(name).resize((width, height), Image.LANCZOS), (left, 0))
    draw.text((left + 12, height + 6), figure, fill="#8fe8a4", font=ImageFont.load_default(26))
    draw.text((left + 12, height + 38), caption, fill="#d8e2e8", font=ImageFont.load_default(16))
sheet.quantize(96).save(root / "docs/images/shrine-wall.png", optimize=True)
