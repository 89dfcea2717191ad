"""Sheets: rows of labelled pictures in one PNG."""

import json

import numpy
from PIL import Image, ImageDraw, ImageFont

from .. import pictures

LABEL = 18  # pixels of the strip above a picture
COLOURS = 256


def thumbnail(rgba, background, size):
    """Returns the displayed picture, its longer side about `size`, by means of pixels in linear light."""
    height, width = rgba.shape[:2]
    step = max(1, max(height, width) // size)
    height, width = height // step, width // step
    small = rgba[: height * step, : width * step].reshape(height, step, width, step, 4).mean(axis=(1, 3))
    return Image.fromarray(numpy.rint(255 * pictures.displayed(small, background)).astype(numpy.uint8))


def write_sheet(path, rows, size):
    """Writes a sheet of 256 colours. `rows`: lists of (label, PIL image), all of one size, at most `size`."""
    width, height = rows[0][0][1].size
    if max(width, height) > size:
        raise ValueError("pictures are too large for their areas")
    sheet = Image.new("RGB", (max(map(len, rows)) * (width + 2) - 2, len(rows) * (height + LABEL)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for r, cells in enumerate(rows):
        for c, (label, picture) in enumerate(cells):
            x, y = c * (width + 2), r * (height + LABEL)
            draw.text((x + 2, y + 2), label, "black", font)
            sheet.paste(picture, (x, y + LABEL))
    save(sheet, path)


def save(picture, path):
    """Saves a PIL image or an array with 256 colours of its own."""
    if isinstance(picture, numpy.ndarray):
        picture = Image.fromarray(picture)
    path.parent.mkdir(parents=True, exist_ok=True)
    palette = picture.quantize(COLOURS)
    picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


class Sheet:
    """Pictures of svrender and svtruth, with the background of their scene."""

    def __init__(self, size=256):
        self.rows, self.size = [], size

    def new_row(self):
        self.rows.append([])

    def add(self, label, exr, scene):
        background = json.loads(scene.read_text()).get("background", [0, 0, 0])
        self.rows[-1].append((label, thumbnail(pictures.read_exr(exr), background, self.size)))

    def write(self, path):
        write_sheet(path, self.rows, self.size)
