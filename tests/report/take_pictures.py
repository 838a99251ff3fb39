"""An output folder with its reports in, small pictures of every page out: ``python -m tests.report.take_pictures OUT TO``."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from deform.report import write_screening
from tests.report.browser import Browser

_PARTS = {"findings": "#verdict", "zones": "#zones", "line": "#line", "dents": "#dents", "welds": "#welds", "quality": "#quality"}
_TALLEST = 1500


def take(folder: Path, target: Path) -> None:
    """Take pictures of the parts of the page, of it in the dark and at 390 px, of the screening and of the print."""
    target.mkdir(parents=True, exist_ok=True)
    page = folder / "report" / "index.html"
    with tempfile.TemporaryDirectory() as place, Browser(Path(place)) as browser:
        browser.open(page, 1280, 900)
        browser.wait(2)
        browser.run("(e => e && (e.open = true))(document.querySelector('#zone-details details'))")
        browser.run("(e => e && e.click())(document.querySelector('button.three'))")
        browser.wait(4)
        for name, selector in _PARTS.items():
            box = f"(r => [0, r.y + scrollY, 1280, Math.min(r.height, {_TALLEST})])"
            clip = browser.run(f"{box}(document.querySelector('{selector}').getBoundingClientRect())")
            small(browser.picture(target / f"page-{name}.png", clip=tuple(clip)))
        browser.open(page, 1280, 900, dark=True)
        browser.wait(2)
        clip = browser.run("(r => [0, r.y + scrollY, 1280, 1300])(document.querySelector('#line').getBoundingClientRect())")
        small(browser.picture(target / "page-dark.png", clip=tuple(clip)))
        browser.open(page, 390, 844)
        browser.wait(2)
        small(browser.picture(target / "page-narrow.png", clip=(0, 0, 390, _TALLEST)))
        screening = write_screening([folder], Path(place) / "screening.html")
        browser.open(screening, 1280, 900)
        small(browser.picture(target / "screening.png", clip=(0, 0, 1280, 700)))
    if shutil.which("pdftoppm"):
        _print(folder / "report" / "report.pdf", target / "print.png")


def small(path: Path) -> None:
    """Reduce a picture to a palette, at two thirds of its size when it is wide."""
    picture = Image.open(path).convert("RGB")
    if picture.width > 1000:
        picture = picture.resize((picture.width * 2 // 3, picture.height * 2 // 3), Image.Resampling.LANCZOS)
    picture.quantize(200, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


def _print(pdf: Path, target: Path) -> None:
    """Put the first eight pages of a PDF into one picture."""
    with tempfile.TemporaryDirectory() as place:
        subprocess.run(["pdftoppm", "-r", "45", "-l", "8", "-png", str(pdf), f"{place}/page"], check=True)
        pages = [Image.open(path) for path in sorted(Path(place).glob("page*.png"))]
        width, height = pages[0].size
        sheet = Image.new("RGB", (4 * width + 50, 2 * height + 30), "#888888")
        for i, page in enumerate(pages):
            sheet.paste(page, (10 + (i % 4) * (width + 10), 10 + (i // 4) * (height + 10)))
        sheet.quantize(200, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    take(Path(sys.argv[1]), Path(sys.argv[2]))
