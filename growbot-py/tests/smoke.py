"""Imports growbot in a fresh environment and uses it. Prints the number of modules that it loads besides numpy's."""

import sys

import numpy

before = set(sys.modules)
import growbot

modules = sorted(set(sys.modules) - before)
others = {name.split(".")[0] for name in modules} - {"growbot"} - sys.stdlib_module_names
LIMIT = 150
assert not others, f"import growbot loads {others}, which only those who use them should pay for"
assert len(modules) <= LIMIT, f"import growbot loads {len(modules)} modules beside numpy's, above {LIMIT}: {modules}"

plan = growbot.plan((0, 0, 0, 0, 90), (200, 100, 600, 0, 45))
assert plan.layer_count == len(plan.layers()) == 832
assert plan.simulate(seed=1).position_error_mm < 1e-6
print(f"Python {sys.version.split()[0]}: import of {len(modules)} modules beside numpy's {numpy.__version__}")
