#!/usr/bin/env python3
"""Puts EXR pictures side by side with labels: panels.py OUT.png EXPOSURE LABEL=A.exr[,B.exr ...] ...

Several files of one panel are averaged.  The picture has a palette of 256 colors, which keeps noise small on disk."""
import sys
import numpy as np, OpenEXR
from PIL import Image, ImageDraw, ImageFont


def load(path):
    with OpenEXR.File(path) as f:
        channels = f.channels()
        for name in ("RGB", "RGBA"):
            if name in channels:
                return np.asarray(channels[name].pixels)[..., :3].astype(np.float64)
        return np.stack([np.asarray(channels[c].pixels) for c in "RGB"], -1).astype(np.float64)


def tonemap(x):
    # Hable's curve on each channel, then sRGB.
    def curve(x):
        a, b, c, d, e, f = 0.22, 0.30, 0.10, 0.20, 0.01, 0.30
        return (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f

    y = np.clip(curve(x) / curve(8.0), 0, 1)
    return np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055)


if len(sys.argv) < 4:
    sys.exit(__doc__)
out, exposure, *panels = sys.argv[1:]
font = ImageFont.load_default(15)
pictures = []
for panel in panels:
    label, files = panel.split("=", 1)
    mean = np.mean([load(f) for f in files.split(",")], axis=0) * float(exposure)
    picture = Image.fromarray((tonemap(mean) * 255 + 0.5).astype(np.uint8))
    draw = ImageDraw.Draw(picture, "RGBA")
    draw.rectangle((0, picture.height - 26, picture.width, picture.height), fill=(0, 0, 0, 190))
    draw.text((8, picture.height - 22), label, font=font, fill=(255, 255, 255, 255))
    pictures.append(picture)
gap = 4
sheet = Image.new("RGB", (sum(p.width for p in pictures) + gap * (len(pictures) - 1), pictures[0].height), "white")
x = 0
for p in pictures:
    sheet.paste(p, (x, 0))
    x += p.width + gap
sheet.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.FLOYDSTEINBERG).save(out, optimize=True)
