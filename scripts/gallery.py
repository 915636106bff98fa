"""Make the pictures of documents anew, by the commands that stand there; without names, those of all."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from scripts.pages import DOCS, ROOT

IMAGES = DOCS / "images"
# documents all of whose pictures are made by their own commands, and pages of which one is a picture in motion
DOCUMENTS = ("tutorial", "gallery", "plots")
PAGES = {"plots": ("crank.html", "view.png")}
WIDTH, COLORS = 760, 256
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def commands(text: str) -> list[str]:
    """Return the lines of a document's bash blocks and those of its console blocks that are typed, in their order."""
    out: list[str] = []
    for language, body in re.findall(r"^```(bash|console)\n(.*?)^```$", text, re.M | re.S):
        lines = body.splitlines()
        out += lines if language == "bash" else [line[2:] for line in lines if line.startswith("$ ")]
    return out


def files(text: str) -> dict[str, str]:
    """Return the files that a document asks to save, with what is in them."""
    return dict(re.findall(r"[Ss]ave this as `([\w.-]+)`:\n\n```\w+\n(.*?)^```$", text, re.M | re.S))


def shrunk(source: Path, target: Path) -> None:
    """Write a picture with fewer points and colours: a tenth of the bytes."""
    with Image.open(source) as image:
        size = (WIDTH, round(image.height * WIDTH / image.width))
        small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        small.quantize(COLORS, dither=Image.Dither.NONE).save(target, optimize=True)


def screenshot(page: Path, target: Path) -> bool:
    """Take a picture of a page in motion; return whether there is a browser that can."""
    browser = next((b for b in map(shutil.which, BROWSERS) if b), None)
    if browser is None:
        return False
    moved = page.with_name("moved.html")
    start = "<script>go(0.3 * axis[frames - 1]); theme(false);</script></body>"
    moved.write_text(page.read_text(encoding="utf-8").replace("</body>", start), encoding="utf-8")
    subprocess.run([browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                    f"--user-data-dir={page.parent / 'profile'}", "--window-size=1200,720",
                    "--virtual-time-budget=1000", f"--screenshot={target}", moved.as_uri()],
                   check=True, capture_output=True, timeout=120)
    return True


def make(document: str) -> None:
    """Run the commands of a document in a folder of their own and put the pictures that it shows beside it."""
    text = (DOCS / f"{document}.md").read_text(encoding="utf-8")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "cases").symlink_to(ROOT / "cases")
        for file, content in files(text).items():
            (folder / file).write_text(content, encoding="utf-8")
        for command in commands(text):
            print(command, flush=True)
            subprocess.run(command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, check=True,
                           stdout=subprocess.DEVNULL)
        page, picture = PAGES.get(document, ("", ""))
        if page and not screenshot(folder / page, folder / picture):
            print(f"no browser is installed: images/{picture} stays as it is")
        for shown in re.findall(r"\]\(images/([\w.-]+)\)", text):
            made = folder / shown
            if made.suffix == ".png" and made.exists():
                shrunk(made, IMAGES / shown)
            elif made.exists():
                shutil.copy(made, IMAGES / shown)


def main() -> int:
    """Make the pictures of the documents that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("documents", nargs="*", metavar="NAME", help=f"among {', '.join(DOCUMENTS)}")
    for document in parser.parse_args().documents or DOCUMENTS:
        make(document)
    return 0


if __name__ == "__main__":
    sys.exit(main())
