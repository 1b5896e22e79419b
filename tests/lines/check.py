#!/usr/bin/env python3
"""Counts the lines of product code of each crate: without blank lines, comments, tests and generated files.

    tests/lines/check.py

Exits with 1 if there are more lines than allowed. Checks first that it counts an example as it should.
"""

import collections
import pathlib
import re
import subprocess
import sys

# This number may only fall, except by the lines of what a user can newly do.
ALLOWED = 77_253

SUFFIXES = ("rs", "py", "js", "ts", "tsx", "css", "html")
# Folders and files of tests, examples, tools and what others have written.
APART = re.compile(
    r"(^|/)(tests?|benches|examples|notebooks|testing|three|vendor)(/|\.rs$|\.js$)|_test\.|/tests\.rs$|package-lock"
    r"|^(book|fuzz)/|/dist/|/costs/|viewer/.*(\.min\.|bundle|three\.)"
)


def code_lines(text: str, is_python: bool) -> int:
    """The number of lines that are neither blank nor comments, without items behind `#[cfg(test)]`."""
    text = re.sub(r"/\*.*?\*/", lambda found: "\n" * found[0].count("\n"), text, flags=re.S)
    count, depth, in_test, test_begins = 0, 0, False, False
    for line in (line.strip() for line in text.split("\n")):
        if in_test:
            depth += line.count("{") - line.count("}")
            in_test = depth > 0
        elif line.startswith("#[cfg(test)]"):
            test_begins = True
        elif test_begins:
            if not line.startswith("#["):
                test_begins = False
                depth = line.count("{") - line.count("}")
                in_test = not line.endswith(";") and depth > 0
        elif line and not line.startswith("//") and not (is_python and line.startswith("# ")):
            count += 1
    return count


def main() -> int:
    example = "// words\nfn a() {\n    b();\n}\n\n#[cfg(test)]\nmod tests {\n    fn c() {}\n}\n#[cfg(test)]\nmod d;\n"
    assert code_lines(example, False) == 3, code_lines(example, False)
    patterns = [f"*.{suffix}" for suffix in SUFFIXES]
    files = subprocess.run(["git", "ls-files", *patterns], capture_output=True, text=True, check=True).stdout.split()
    lines: collections.Counter[str] = collections.Counter()
    for file in files:
        if not APART.search(file):
            text = pathlib.Path(file).read_text(errors="replace")
            lines[file.split("/")[0]] += code_lines(text, file.endswith(".py"))
    for crate, number in lines.most_common():
        print(f"{number:7} {crate}")
    print(f"{lines.total():7} lines of product code, {ALLOWED} allowed")
    return 1 if lines.total() > ALLOWED else 0


if __name__ == "__main__":
    sys.exit(main())
