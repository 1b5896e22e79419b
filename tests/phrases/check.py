#!/usr/bin/env python3
"""Counts phrases that a reader stumbles over, in comments and documents.

    tests/phrases/check.py            fails if a file has more of them, or fewer, than allowed.txt lists
    tests/phrases/check.py --lower    writes allowed.txt, if no count rises
    tests/phrases/check.py --test     shows that the check refuses examples

A line of allowed.txt is a file, a rule and a count. Counts may only fall.
"""
import collections
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
TABLE = ROOT / "tests/phrases/allowed.txt"

# name, where ("opener" of a doc comment, "comment" or "document"), pattern, what to write instead
RULES = [
    (
        "clause",
        {"opener"},
        r"^(What|Why|How|Whether|Where|Which|When|Who|Whose|Whoever|Of|As|Its?|Those|That|These|This of|They|So|And|and"
        r"|The same|By how|In some)\b",
        'describe a field or type by a noun phrase, a function by a verb ("Returns ...")',
    ),
    ("tell", {"comment", "document"}, r"\b(told|tells?|telling|said|says|heard)\b", "report, print, show, receive"),
    ("ask", {"comment", "document"}, r"\b(asks?|asked|asking)\b", "request, query, poll, prompt"),
    ("anew", {"comment", "document"}, r"\b(anew|midst|lest)\b", "again, middle, so that not"),
    (
        "nobody",
        {"comment", "document"},
        r"\b(nobody|somebody|whoever)\b",
        "the actor: the board, the service, the caller",
    ),
    ("lend", {"comment", "document"}, r"\b(lent|lends?|borrow(s|ed)?)\b", "lease"),
    ("reckon", {"comment", "document"}, r"\breckon(s|ed)?\b", "compute, estimate"),
    ("go on", {"comment", "document"}, r"\b(gone|goes) on with\b", "continue, resume"),
    (
        "is no",
        {"comment", "document"},
        r"\bis no [a-z]+|\bare none\b|\bnone (where|if)\b",
        'is not a ..., "`None` if ..."',
    ),
    ("so long", {"comment", "document"}, r"\bso (long|often|many)\b", "the number or the bound"),
    (
        "idiom",
        {"comment", "document"},
        r"\bkeeps? off\b|\bcame to\b|\bin words\b|\blet be\b",
        "avoid, result, text, keep",
    ),
]
RULES = [(name, places, re.compile(pattern, 0 if name == "clause" else re.I), instead)
         for name, places, pattern, instead in RULES]


def pieces(path, text):
    """Yields (place, line number, text) of the comments of a source file, or of the lines of a document."""
    if path.endswith(".md"):
        fenced = False
        for number, line in enumerate(text.splitlines(), 1):
            if line.lstrip().startswith("```"):
                fenced = not fenced
            elif not fenced:
                yield "document", number, line
        return
    in_doc = False
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        doc = re.match(r"(///|//!)\s?(.*)", line)
        if doc and not in_doc:
            yield "opener", number, doc[2]
        in_doc = bool(re.match(r"(///|//!)\s*\S", line))
        comment = re.search(r"(//[/!]?|#)\s(.*)", line)
        if comment and not line.startswith("#["):
            yield "comment", number, comment[2]


def find(path, text):
    """Lists (rule, line number, phrase, what to write instead) of one file."""
    return [(name, number, match[0], instead)
            for place, number, line in pieces(path, text)
            for name, places, pattern, instead in RULES if place in places
            for match in pattern.finditer(line)]


def tree():
    """Lists the files that are checked."""
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [f for f in files.split("\0")
            if f.endswith((".rs", ".py", ".pyi", ".js", ".ts", ".tsx", ".md")) and "/dist/" not in f
            # They quote what is not to be written.
            and f not in ("CONTRIBUTING.md", "tests/phrases/check.py") and (ROOT / f).is_file()]


def allowed():
    """Reads the table."""
    rows = (line.rsplit("\t", 2) for line in TABLE.read_text().splitlines() if line and not line.startswith("#"))
    return {(path, rule): int(count) for path, rule, count in rows}


def compare(found, limits):
    """Lists what is wrong: (file, rule, count, limit)."""
    keys = sorted(set(found) | set(limits))
    return [(*key, len(found.get(key, [])), limits.get(key, 0)) for key in keys
            if len(found.get(key, [])) != limits.get(key, 0)]


def self_test():
    """Shows that each rule refuses an example, and that a count may neither rise nor stay in the table too high."""
    examples = {"clause": "/// What a robot does.", "tell": "// The board tells its state.", "ask": "# asks the board",
                "anew": "// It begins anew.", "nobody": "// Nobody stops it.", "lend": "// The port is lent.",
                "reckon": "// It reckons the path.", "go on": "// It goes on with the layer.",
                "is no": "// This is no layer.", "so long": "// It waits so long.", "idiom": "// the result in words"}
    assert set(examples) == {rule[0] for rule in RULES}
    for name, line in examples.items():
        rules = [rule for rule, *_ in find("example.rs", f"fn f() {{}}\n{line}\n")]
        assert rules == [name], f"{line!r} is found by {rules}, not by {name!r}"
    assert find("example.rs", "/// Returns the state of the board.\nlet told = 1;\n") == []
    assert find("page.md", "The board tells it.\n\n```\nWho says so\n```\n")[0][:3] == ("tell", 1, "tells")
    one = {("a.rs", "ask"): ["asked"]}
    assert compare(one, {}) and compare({}, {("a.rs", "ask"): 1}) and not compare(one, {("a.rs", "ask"): 1})


def main(arguments):
    self_test()
    if arguments == ["--test"]:
        return 0
    found = collections.defaultdict(list)
    for path in tree():
        for name, *rest in find(path, (ROOT / path).read_text(errors="replace")):
            found[path, name].append(rest)
    limits = allowed() if TABLE.exists() else None
    if arguments == ["--lower"]:
        rises = [row for row in compare(found, limits) if row[2] > row[3]] if limits is not None else []
        if not rises:
            rows = [f"{path}\t{rule}\t{len(places)}" for (path, rule), places in sorted(found.items())]
            TABLE.write_text(
                "# Phrases that are still there: file, rule, count. tests/phrases/check.py --lower writes it.\n"
                + "".join(row + "\n" for row in rows)
            )
            return 0
        wrong = rises
    elif arguments:
        sys.exit(__doc__)
    else:
        wrong = compare(found, limits or {})
    for path, rule, count, limit in wrong:
        if count < limit:
            print(f"{path}: {count} of rule '{rule}', and the table allows {limit}: run tests/phrases/check.py --lower")
            continue
        for number, phrase, instead in found[path, rule]:
            print(f"{path}:{number}: '{phrase}': write {instead} ({count} in this file, at most {limit})")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
