#!/usr/bin/env python3
"""Draws the animation of README.md: a simulated robot grows, seen by `growbot view` after every few layers.

    book/animation.py GROWBOT [FILE]

FILE is book/src/pictures/growing.webp unless given. Needs Pillow.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

GOAL = "300,200,250,-45,-30"
FRAMES = 48
WIDTH = 760
LAST_FRAME_MS = 2500


def run(*arguments: object) -> None:
    subprocess.run([str(argument) for argument in arguments], check=True, capture_output=True)


def main() -> None:
    growbot = Path(sys.argv[1]).resolve()
    file = Path(sys.argv[2] if len(sys.argv) > 2 else "book/src/pictures/growing.webp")
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        log = directory / "run.jsonl"
        run(growbot, "grow", "--to", GOAL, "--log", log, "--quiet")
        lines = log.read_text().splitlines(keepends=True)
        laid = [index for index, line in enumerate(lines) if '"event":"laid"' in line]
        pictures = []
        for frame in range(1, FRAMES + 1):
            end = laid[len(laid) * frame // FRAMES - 1] + 1
            part, drawn = directory / "part.jsonl", directory / "part.png"
            part.write_text("".join(lines[:end]))
            run(growbot, "view", part, "-o", drawn, "--width", WIDTH, "--no-title", "--range", "0.6,0.94", "--quiet")
            pictures.append(Image.open(drawn).convert("RGB"))
        durations = [90] * (FRAMES - 1) + [LAST_FRAME_MS]
        pictures[0].save(
            file, save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=60, method=6
        )
    print(f"{file}: {file.stat().st_size} bytes, {FRAMES} pictures of {pictures[0].width} x {pictures[0].height}")


if __name__ == "__main__":
    main()
