"""Writes the fonts here from those of the npm package @fontsource/inter. The argument is the package's files directory.

The fonts keep the letters of western European languages, the characters of numbers and units, kerning, and figures of
one width. They drop the hints for screens of few pixels.
"""

import sys
from pathlib import Path

from fontTools.subset import Options, Subsetter, parse_unicodes
from fontTools.ttLib import TTFont

KEPT = parse_unicodes("20-7E,A0-FF,2013,2014,2018,2019,201C,201D,2026,2032,2212")

for weight, style in (400, "Regular"), (600, "SemiBold"):
    font = TTFont(Path(sys.argv[1]) / f"inter-latin-{weight}-normal.woff2")
    options = Options(hinting=False, layout_features=["kern", "tnum"], name_IDs=[0, 1, 2, 6, 13, 14])
    subsetter = Subsetter(options)
    subsetter.populate(unicodes=KEPT)
    subsetter.subset(font)
    # All fonts are one family and differ in weight.
    for identifier, text in (1, "Inter"), (2, style), (6, f"Inter-{style}"):
        font["name"].setName(text, identifier, 3, 1, 0x409)
    font.flavor = None
    font["head"].modified = font["head"].created
    font.recalcTimestamp = False
    font.save(Path(__file__).parent / f"inter-{style.lower()}.ttf")
