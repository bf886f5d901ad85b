"""Draws docs/images/gains.jpg: the ten frames that gain most, and three that gain nothing, with their gains.

    sheet.py RESULTS PICTURES OUT     RESULTS is docs/results/workload/h200.json; PICTURES has FRAME.png of each frame

Needs Pillow.
"""

import json
import sys

from PIL import Image, ImageDraw, ImageFont

SIZE = (304, 171)
LINE = 38
ACROSS = 5


def main():
    results, pictures, out = sys.argv[1:4]
    with open(results) as file:
        rows = [json.loads(line) for line in file]
    best = lambda row: max(row["same"]["median"], row["within"]["median"])
    rows.sort(key=best, reverse=True)
    shown = rows[:10] + rows[-3:]
    down = -(-len(shown) // ACROSS)
    sheet = Image.new("RGB", (SIZE[0] * ACROSS, (SIZE[1] + LINE) * down), "#181818")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(12)
    for place, row in enumerate(shown):
        left, top = place % ACROSS * SIZE[0], place // ACROSS * (SIZE[1] + LINE)
        picture = Image.open(f"{pictures}/{row['frame']}.png").convert("RGB")
        picture.thumbnail(SIZE, Image.LANCZOS)
        sheet.paste(picture, (left + (SIZE[0] - picture.width) // 2, top))
        draw.text((left + 6, top + SIZE[1] + 3), caption(row), font=font, fill="#ffffff")
    sheet.save(out, quality=82, optimize=True)


def caption(row):
    """The frame, its largest render pass, and what the frame gains."""
    largest = max(row["passes"], key=lambda p: p["part"] if "ms" in p else 0)
    return f"{row['frame']}, pass {largest['pass']}: {largest['ms']:.3f} ms\n{gain(row)}"


def gain(row):
    same, within = row["same"]["median"], row["within"]["median"]
    if max(same, within) < 1.005:
        return "frame 1.00x, as written"
    if f"{within:.2f}" > f"{same:.2f}":
        flip = max(p["within"]["flip"] for p in row["passes"] if p.get("within"))
        changed = f"FLIP {flip:.3f}" if flip >= 0.0005 else "FLIP below 0.001"
        exact = f"; {same:.2f}x unchanged" if same >= 1.05 else ""
        return f"frame {within:.2f}x, {changed}{exact}"
    return f"frame {same:.2f}x, no pixel changes"


main()
