"""Make the pictures of docs/plots.md anew, by the commands that stand there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
DOCUMENT = ROOT / "docs" / "plots.md"
IMAGES = ROOT / "docs" / "images"
WIDTH, COLORS = 760, 256
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def commands(text: str) -> list[str]:
    """Return the lines of the document's bash blocks."""
    return [line for block in re.findall(r"^```bash\n(.*?)^```$", text, re.M | re.S) for line in block.splitlines()]


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


def main() -> int:
    """Run the commands in a folder of their own and put the pictures that the document shows beside it."""
    text = DOCUMENT.read_text(encoding="utf-8")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "cases").symlink_to(ROOT / "cases")
        for command in commands(text):
            print(command, flush=True)
            subprocess.run(command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, check=True,
                           stdout=subprocess.DEVNULL)
        if not screenshot(folder / "crank.html", folder / "view.png"):
            print("no browser is installed: images/view.png stays as it is")
        for shown in re.findall(r"\]\(images/([\w.]+)\)", text):
            made = folder / shown
            if made.suffix == ".png" and made.exists():
                shrunk(made, IMAGES / shown)
            elif made.exists():
                shutil.copy(made, IMAGES / shown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
