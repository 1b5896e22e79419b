"""Imports growbot in a fresh environment, and uses it; prints how much of a processor the import takes."""

import subprocess
import sys

LIMIT_S = 0.2
code = "import time; begun = time.process_time(); import growbot; print(time.process_time() - begun)"
times = [float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(7)]
assert min(times) < LIMIT_S, f"import growbot takes {min(times)} s of a processor, above {LIMIT_S}"

import growbot

plan = growbot.plan((0, 0, 0, 0, 90), (200, 100, 600, 0, 45))
assert plan.layer_count == len(plan.layers()) == 832
assert plan.simulate(seed=1).position_error_mm < 1e-6
print(f"Python {sys.version.split()[0]}: import {1e3 * min(times):.0f} ms of a processor")
