#!/usr/bin/env python3
"""Breaks promises of mended.toml one at a time, and requires that the test named there notices.

    mended.py                   all of them
    mended.py NAME...           these; the beginning of a name is enough
    mended.py --check           builds nothing: each text to replace occurs exactly once in its file

A mutant counts as noticed only if it compiles and its test fails, or still runs after LIMIT_S. The exit code is 0 if
each mutant is noticed. The script works in a copy of the repository below target/mutants. The copy stays there, so that
the next run builds less. It needs cargo-nextest.
"""

import os
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
WORK = ROOT / "target/mutants/mended"
COPY = WORK / "copy"
# Time limit of a test, s. A mutant may run forever.
LIMIT_S = 300
# nextest exits with this code if a test has failed, and with others if the build has failed or no test was found.
TEST_FAILED = 100
# Quick to build again after a small change.
QUICK = ["--config", "profile.dev.package.growbot-firmware.codegen-units=256"]
SETTINGS = {"CARGO_TARGET_DIR": str(WORK / "target"), "CARGO_INCREMENTAL": "1", "CARGO_PROFILE_DEV_OPT_LEVEL": "1",
            "GROWBOT_PORT": "", "PROPTEST_MAX_SHRINK_ITERS": "0", "PROPTEST_DISABLE_FAILURE_PERSISTENCE": "true"}


def update_copy():
    """Makes the copy agree with the repository. Unchanged files keep their times, and are not built again."""
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                            check=True, capture_output=True, text=True).stdout
    files = {name for name in listed.split("\0") if name and (ROOT / name).is_file()}
    for name in files:
        source, target = ROOT / name, COPY / name
        if not target.exists() or source.read_bytes() != target.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    for path in [path for path in COPY.rglob("*") if path.is_file()]:
        if str(path.relative_to(COPY)) not in files:
            path.unlink()


def run(test):
    """Builds and runs a test. Returns "passed", "failed", "hung" or "not built"."""
    *where, name = test.split()
    call = ["cargo", "nextest", "run", *QUICK, "-p", *where, "-E", f"test(/{name}$/)"]
    silent = {"cwd": COPY, "env": os.environ | SETTINGS, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    built = subprocess.run([*call, "--no-run"], check=False, text=True, **silent)
    if built.returncode != 0:
        print(built.stdout)
        return "not built"
    with subprocess.Popen(call, **silent | {"stdout": subprocess.DEVNULL}) as process:
        try:
            code = process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            process.terminate()
            return "hung"
    return {0: "passed", TEST_FAILED: "failed"}.get(code, "not built")


def main():
    mutants = tomllib.loads((HERE / "mended.toml").read_text())["mutant"]
    wrong = [f"{mutant['name']}: its text occurs {count} times in {mutant['file']}" for mutant in mutants
             if (count := (ROOT / mutant["file"]).read_text().count(mutant["from"])) != 1]
    names = [mutant["name"] for mutant in mutants]
    wrong += [f"{name} is listed twice" for name in sorted(set(names)) if names.count(name) > 1]
    if wrong or sys.argv[1:] == ["--check"]:
        print("\n".join(wrong) or f"{len(mutants)} mutants of mended lines, each in a text that exists")
        return 1 if wrong else 0
    wanted = [mutant for mutant in mutants if mutant["name"].startswith(tuple(sys.argv[1:]) or "")]
    if not wanted:
        sys.exit(f"no name of a mutant begins with {' or '.join(sys.argv[1:])}")

    update_copy()
    for test in dict.fromkeys(mutant["test"] for mutant in wanted):
        if (result := run(test)) != "passed":
            sys.exit(f"without a mutant: {result}: {test}")
        print(f"without a mutant: passed: {test}", flush=True)
    survived = 0
    for mutant in wanted:
        path, began = COPY / mutant["file"], time.monotonic()
        text = path.read_text()
        path.write_text(text.replace(mutant["from"], mutant["to"]))
        try:
            result = run(mutant["test"])
        finally:
            path.write_text(text)
        noticed = result in ("failed", "hung")
        survived += not noticed
        verdict = f"noticed ({result})" if noticed else f"NOT NOTICED ({result})"
        print(f"{verdict} after {time.monotonic() - began:.0f} s: {mutant['name']}", flush=True)
    print(f"{len(wanted) - survived} of {len(wanted)} mutants were noticed")
    return 1 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
