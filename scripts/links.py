#!/usr/bin/env python3
"""Checks that every relative link in the Markdown files leads to a file, and to a heading there if it names one.
Pages under docs/ may link only to files under docs/, because the book contains nothing else. Conflicts of a
merge are reported too."""
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"


def anchors(path):
    """The anchors of a page, as GitHub and mdBook make them."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf8"), flags=re.S)
    found = set(re.findall(r'(?:id|name)="([^"]+)"', text))
    for heading in re.findall(r"^#+ (.+)$", text, flags=re.M):
        heading = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
        found.add(kept.replace(" ", "-"))
    return found


def wrong(path):
    text = re.sub(r"```.*?```|`[^`\n]*`", "", path.read_text(encoding="utf8"), flags=re.S)
    if re.search(r"^(<{7}|>{7}) ", text, flags=re.M):
        yield "the conflict of a merge"
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        to = (path.parent / name).resolve() if name else path
        if not to.exists():
            yield f"{target}: no such file"
        elif DOCS in path.parents and DOCS not in to.parents:
            yield f"{target}: outside of docs/"
        elif anchor and to.suffix == ".md" and anchor not in anchors(to):
            yield f"{target}: no such heading"


def main():
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "*.md"],
        cwd=ROOT, text=True, capture_output=True, check=True,
    )
    pages = [ROOT / line for line in listed.stdout.splitlines() if "/tests/cmd/" not in line]
    found = [f"{p.relative_to(ROOT)}: {w}" for p in pages if p.exists() for w in wrong(p)]
    print("\n".join(found) or f"{len(pages)} pages, every link leads somewhere")
    sys.exit(bool(found))


main()
