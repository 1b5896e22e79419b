#!/usr/bin/env python3
"""Finds errors of the libraries that are texts, and texts of the libraries that name options and commands.

    tests/errors/check.py [ROOT]

The command line (growbot-host/src/cli) and Python add remedies with options and commands to the errors of the
libraries, from the types of these errors. So a text below the command line must not be an error, and must not name an
option or a command. Tests and comments do not count. Exits with 1 if there is one of either, and prints what it found.
Checks first that it finds the errors of an example.
"""

import pathlib
import re
import sys
import tempfile

CRATES = ("core", "scene", "plan", "client", "remote", "sim", "pictures", "serve", "paper", "host")
TEXT = r"(?:String|&(?:'static )?str|Box<dyn [\w:]*Error\b[^;{]*?>|anyhow::Error|Cow<'static, str>)"
TEXT_ERRORS = re.compile(
    # A result with a text as its error. The type of its value may contain angle brackets.
    rf"\bResult<(?:[^<>;{{}}]|<(?:[^<>]|<(?:[^<>]|<[^<>]*>)*>)*>)*?,\s*{TEXT}\s*,?>"
    # A type of error, or a variant of one, that only passes on a text.
    rf'|#\[error\((?:transparent|"\{{0\}}")\)\]\s*(?:pub struct )?\w+\((?:#\[\w+\] )?(?:pub )?{TEXT}\)'
    # An error that becomes the text of another one.
    r"|\bmap_err\((?:ToString::to_string|\|([a-z]\w*)\| (?:[\w:]+\([^|;]*)?(?:\1\.to_string\(\)|format!))"
)
STRING = re.compile(r'r(#*)".*?"\1|b?"(?:[^"\\]|\\.)*"', re.S)
COMMENT_OR_STRING = re.compile(rf"//[^\n]*|/\*.*?\*/|{STRING.pattern}|b?'(?:[^'\\\n]|\\[^\n]{{1,8}}?)'", re.S)
OPTION = re.compile(r"[\s(`]--[a-z][a-z-]+|`growbot [a-z]|`(?:cancel|clear|configure|estop|flash|resume|status|tune)`")


def blank(text: str) -> str:
    """Replaces all characters except line breaks by spaces."""
    return re.sub(r"[^\n]", " ", text)


def product_code(code: str) -> str:
    """Blanks comments, and each item behind `#[cfg(test)]`."""
    code = COMMENT_OR_STRING.sub(lambda found: blank(found[0]) if found[0].startswith("/") else found[0], code)
    bare = COMMENT_OR_STRING.sub(lambda found: blank(found[0]), code)
    for start in re.finditer(r"#\[cfg\((?:test|all\(test[^]]*)\)\]", bare):
        at, depth = start.end(), 0
        while at < len(bare):
            depth += (bare[at] in "{([") - (bare[at] in "})]")
            at += 1
            if depth == 0 and bare[at - 1] in "};":
                break
        code = code[: start.start()] + blank(code[start.start() : at]) + code[at:]
    return code


def is_product(path: pathlib.Path) -> bool:
    """Reports whether a file is part of the libraries: not the command line, and not a test."""
    return not re.search(r"/src/cli/|/src/main\.rs|/tests/|tests?\.rs$|testing|/fake_", path.as_posix())


def findings(source: pathlib.Path) -> tuple[list[str], list[str]]:
    """Returns the errors that are texts, and the texts with options, of a folder of sources."""
    texts: list[str] = []
    options: list[str] = []
    for path in sorted(path for path in source.rglob("*.rs") if is_product(path)):
        code = product_code(path.read_text())

        def found(match: re.Match, code: str = code, path: pathlib.Path = path) -> str:
            return f"{path}:{code.count(chr(10), 0, match.start()) + 1}: {' '.join(match[0].split())}"

        texts.extend(map(found, TEXT_ERRORS.finditer(code)))
        options.extend(found(text) for text in STRING.finditer(code) if OPTION.search(re.sub(r"\\\n\s*", "", text[0])))
    return texts, options


def check_example() -> None:
    """Each form of an error that is a text, a text with an option and one with a command; and what is none of these."""
    with tempfile.TemporaryDirectory() as directory:
        source = pathlib.Path(directory)
        (source / "bad.rs").write_text(
            "fn a() -> Result<Vec<(u32, [u8; 2])>, String> { b().map_err(|error| error.to_string()) }\n"
            '#[error(transparent)]\nSimulated(Box<dyn Error + Send>),\n#[error("{0}")]\npub struct Bad(String);\n'
            '#[error("too long: raise \\\n  --max-length")]\nTooLong,\n'
            '#[error("left: `growbot \\\n  resume`")]\nLeft,\n'
        )
        (source / "good.rs").write_text(
            "// `growbot resume` gives Result<(), String>\nfn a() -> Result<String, Bad> { b()? }\n"
            '#[error("a -- b")]\nGood(String),\n#[cfg(test)]\nmod tests { fn a() -> Result<(), String> { "} --a" } }\n'
        )
        texts, options = findings(source)
        assert len(texts) == 4 and len(options) == 2, f"the example's errors are not found: {texts} {options}"
        assert all("bad.rs" in line for line in texts + options), f"the example has fewer errors: {texts} {options}"


def main() -> int:
    check_example()
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parent.parent.parent)
    sources = [findings(root / f"growbot-{name}/src") for name in CRATES]
    failed = False
    for kind, name in enumerate(("errors that are texts", "texts with options or commands")):
        lines = [line for source in sources for line in source[kind]]
        print("\n".join([*lines, f"{len(lines)} {name}"]))
        failed |= bool(lines)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
