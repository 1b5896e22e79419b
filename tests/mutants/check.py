#!/usr/bin/env python3
"""Compares the mutants that survived with the list of equivalent mutants.

    check.py EQUIVALENT.TOML REPOSITORY OUTPUT...
    check.py EQUIVALENT.TOML REPOSITORY            without a report: each entry names a function and a line that exist

Each OUTPUT is the directory that tests/mutants/run wrote for a group: all.json, and the reports own/ and all/ of
cargo-mutants. An entry of the list is

    [[mutant]]
    file = "growbot-firmware/src/heater/supervision.rs"
    mutation = "replace > with >= in Supervision::drops"
    line = "the line of the code, without the blanks around it"
    column = 3      # the number of the mutant among those in that line, counted from 1, by default 1
    reason = "..."

An entry therefore still identifies its mutant after lines above it were added or removed. The exit code is 0 if every
survivor is listed, and if every listed mutant of the groups that were run exists and has survived. Otherwise it is 1.
"""

import json
import re
import sys
import tomllib
from pathlib import Path


class Mutants:
    """Identifies mutants by file, mutation, line of code and occurrence in that line."""

    def __init__(self, repository, listed):
        self.lines = {}
        self.repository = repository
        columns = {}
        for mutant in listed:
            columns.setdefault(self.place(mutant), []).append(mutant["span"]["start"]["column"])
        self.columns = {place: sorted(set(found)) for place, found in columns.items()}
        self.listed = {self.key(mutant) for mutant in listed}

    def place(self, mutant):
        file, span = mutant["file"], mutant["span"]["start"]
        if file not in self.lines:
            self.lines[file] = (self.repository / file).read_text().splitlines()
        mutation = mutant["name"].split(": ", 1)[1]
        return file, mutation, self.lines[file][span["line"] - 1].strip(), span["line"]

    def key(self, mutant):
        place = self.place(mutant)
        occurrence = self.columns[place].index(mutant["span"]["start"]["column"]) + 1
        return place[:3] + (occurrence,)


def outcomes(report):
    """Yields the mutants of a report with their outcomes."""
    path = report / "outcomes.json"
    if not path.exists():
        return
    for outcome in json.loads(path.read_text())["outcomes"]:
        if isinstance(outcome["scenario"], dict):
            yield outcome["scenario"]["Mutant"], outcome["summary"]


def missing(entry, repository):
    """Returns what an entry names and the source does not have, or None."""
    path = repository / entry["file"]
    if not path.is_file():
        return "no such file"
    text = path.read_text()
    if entry["line"] not in (line.strip() for line in text.splitlines()):
        return "no such line"
    function = re.search(r" in (.*)$", entry["mutation"])
    names = re.sub(r"<.*?>", "", function[1]).split("::") if function else []
    # A type that only a comment or a `use` names may have another name by now.
    owners = " ".join(re.findall(r"^ *(?:pub )?(?:impl|trait|mod)\b.*", text, re.M))
    absent = [name for name in names[:-1] if not re.search(rf"\b{name}\b", owners)]
    if absent or (names and not re.search(rf"\bfn {names[-1]}\b", text)):
        return f"no {'::'.join(names)}"
    return None


def main():
    listed_in, repository, outputs = Path(sys.argv[1]), Path(sys.argv[2]), [Path(output) for output in sys.argv[3:]]
    equivalent, problems = {}, []
    for entry in tomllib.loads(listed_in.read_text()).get("mutant", []):
        key = (entry["file"], entry["mutation"], entry["line"], entry.get("column", 1))
        if key in equivalent:
            problems.append(f"listed twice: {key}")
        if not entry["reason"].strip():
            problems.append(f"listed without a reason: {key}")
        if what := missing(entry, repository):
            problems.append(f"listed as equivalent, but there is {what}: {key}")
        equivalent[key] = entry["reason"]
    if not outputs:
        print("\n".join(problems) or f"{len(equivalent)} equivalent mutants, each in a line that exists")
        return 1 if problems else 0

    counts = {"CaughtMutant": 0, "MissedMutant": 0, "Timeout": 0, "Unviable": 0}
    existing, files, by_own = set(), set(), 0
    for output in outputs:
        listed = json.loads((output / "all.json").read_text())
        mutants = Mutants(repository, listed)
        existing |= mutants.listed
        files |= {mutant["file"] for mutant in listed}
        final = {}
        for report in ("own", "all"):
            for mutant, summary in outcomes(output / report):
                by_own += report == "own" and summary == "CaughtMutant"
                final[mutant["name"]] = (mutant, summary)
        for mutant, summary in final.values():
            counts[summary] = counts.get(summary, 0) + 1
            key = mutants.key(mutant)
            if summary in ("MissedMutant", "Timeout") and key not in equivalent:
                problems.append(f"unexplained survivor: {mutant['name']}\n    {key[2]}")
            if summary == "CaughtMutant" and key in equivalent:
                problems.append(f"listed as equivalent, and a test notices it: {mutant['name']}")
    for key in equivalent:
        if key[0] in files and key not in existing:
            problems.append(f"listed as equivalent, and there is no such mutant: {key}")

    tested = sum(counts.values())
    print(
        f"{tested} mutants of {len(existing)}: {counts['CaughtMutant']} caught "
        f"({by_own} by the tests of their own module), "
        f"{counts['MissedMutant'] + counts['Timeout']} survived, {counts['Unviable']} do not compile"
    )
    for problem in problems:
        print(problem, file=sys.stderr)
    if problems:
        print(
            f"{len(problems)} problems: kill each with a test, or list it in {listed_in.name} with the reason",
            file=sys.stderr,
        )
        return 1
    print("every survivor is listed as equivalent, with a reason")
    return 0


if __name__ == "__main__":
    sys.exit(main())
