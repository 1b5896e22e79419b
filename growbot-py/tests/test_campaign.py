"""Campaigns give the same bytes with threads, Dask and joblib, in any order, and with lost workers."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pyarrow.parquet
import pytest

import growbot
from conftest import START

COMPLETE = os.environ.get("GROWBOT_PYTHON") == "complete"


def spec(growths_per_cell: int = 700, growths_per_chunk: int = 300) -> growbot.CampaignSpec:
    return growbot.CampaignSpec(
        robots=[growbot.Robot(), growbot.Robot("growbot-a3")],  # type: ignore[arg-type]
        goals=[(0, 0, 150), (60, 0, 300, 0, 45)],  # type: ignore[arg-type]
        conditions=[  # type: ignore[arg-type]
            growbot.Conditions(noise_percent=10),
            growbot.Conditions(bias_percent=2, sag=True),
        ],
        growths_per_cell=growths_per_cell,
        first_seed=5,
        growths_per_chunk=growths_per_chunk,
    )


def test_order_chunks_and_threads_do_not_show() -> None:
    whole = growbot.run_campaign(spec(), threads=1)
    assert growbot.run_campaign(spec(), threads=3).to_json() == whole.to_json()
    assert growbot.run_campaign(spec(growths_per_chunk=5600)).hash == whole.hash
    chunks = list(range(spec().chunk_count))
    random.Random(1).shuffle(chunks)
    assert (
        growbot.merge_chunks(spec(), (growbot.run_chunk(spec(), chunk) for chunk in chunks)).to_json()
        == whole.to_json()
    )
    robot, goal, conditions = spec().cell(5)
    alone = growbot.simulate_repeated(growbot.plan(START, goal, robot=robot), 700, seed=5, conditions=conditions)
    assert alone == whole.summaries[5]
    table = whole.table()
    assert len(table) == 8 and table["mean_mm"][5] == alone.position_error_mm["mean"] and whole.growth_count == 5600


def test_joblib() -> None:
    partials = joblib.Parallel(n_jobs=2)(
        joblib.delayed(growbot.run_chunk)(spec(), chunk) for chunk in range(spec().chunk_count)
    )
    assert growbot.merge_chunks(spec(), partials).hash == growbot.run_campaign(spec()).hash


def test_samples_are_those_of_simulate_many(tmp_path: Path) -> None:
    result = growbot.run_campaign(spec(), samples=tmp_path)
    assert result.hash == growbot.run_campaign(spec()).hash
    files = sorted(tmp_path.iterdir())
    assert len(files) == spec().chunk_count
    rows = pyarrow.parquet.read_table(tmp_path).to_pandas()
    assert len(rows) == 5600
    robot, goal, conditions = spec().cell(3)
    plan = growbot.plan(START, goal, robot=robot)
    wanted = growbot.simulate_many(plan, np.arange(5, 705), conditions=conditions)
    found = rows[rows["cell"] == 3].sort_values("seed")
    assert np.array_equal(found["position_error_mm"], wanted["position_error_mm"])
    first = files[0].read_bytes()
    growbot.run_chunk(spec(), 0, tmp_path)
    assert files[0].read_bytes() == first


def test_a_cell_without_a_plan_is_told() -> None:
    narrow = growbot.CampaignSpec(
        (growbot.Robot("growbot-a6"), growbot.Robot()), ((0, 0, 50),), (growbot.Conditions(),), 3, radius_mm=50
    )
    result = growbot.run_campaign(narrow)
    assert list(result.errors) == [1] and "below R_min" in result.errors[1]
    assert result.growth_count == 3 and np.isnan(result.table()["mean_mm"][1])


def test_chunks_of_another_campaign_twice_or_missing_are_refused() -> None:
    chunks = [growbot.run_chunk(spec(), chunk) for chunk in range(spec().chunk_count)]
    for wrong, words in (
        (chunks[:-1], "1 of 19 chunks are missing, the first is 18"),
        (chunks + chunks[3:4], "chunk 3 was already added"),
    ):
        with pytest.raises(growbot.InputError, match=words):
            growbot.merge_chunks(spec(), wrong)
    other = growbot.CampaignSpec(
        (growbot.Robot("growbot-a6"), growbot.Robot("growbot-a3")), *(spec().goals, spec().conditions), 700,
        first_seed=5, growths_per_chunk=300,
    )
    with pytest.raises(growbot.InputError, match="another campaign"):
        growbot.merge_chunks(other, chunks)
    result = growbot.CampaignResult(spec())
    with pytest.raises(growbot.InputTypeError):
        result.add(chunks[0].summaries[0])  # type: ignore[arg-type]
    # Equal numbers of other types are the same campaign.
    same = growbot.CampaignSpec(spec().robots, spec().goals, spec().conditions, np.int64(700), first_seed=5, growths_per_chunk=300)  # type: ignore[arg-type]
    assert same.hash == spec().hash != other.hash


def test_a_campaign_refuses_what_no_cell_could_plan() -> None:
    for wrong in ({"planner": "fastest"}, {"planner": None}, {"radius_mm": -1}, {"radius_mm": float("nan")}, {"radius_mm": "wide"}):
        with pytest.raises((growbot.InputError, growbot.InputTypeError)):
            growbot.CampaignSpec((growbot.Robot(),), ((0, 0, 150),), (growbot.Conditions(),), 3, **wrong)  # type: ignore[arg-type]


#: Program for a separate process: a cluster of two workers that are processes.
DASK = """
import os, signal, sys, time
import growbot
from distributed import Client, LocalCluster

def main():
    growths, layers, kills = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    robot = growbot.Robot()
    height = robot.description["layer"]["height_mm"]
    spec = growbot.CampaignSpec([robot], [(0, 0, layers * height - 0.1, 0, 90)], [growbot.Conditions(noise_percent=10)],
                                growths, growths_per_chunk=max(1, growths // 100))
    plan = growbot.plan(spec.start, spec.goals[0])
    assert plan.layer_count == layers, plan.layer_count
    begun = time.time()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
        with Client(cluster) as client:
            left = [kills]
            def progress(done, chunks):
                if left[0] and done >= (kills - left[0] + 1) * chunks // (kills + 2):
                    left[0] -= 1
                    pids = sorted(client.run(os.getpid, on_error="ignore").values())
                    os.kill([pid for pid in pids if isinstance(pid, int)][0], signal.SIGKILL)
            result = growbot.run_campaign(spec, client, progress=progress)
            assert left[0] == 0, "no worker was killed"
            memory = client.run(lambda: __import__("resource").getrusage(0).ru_maxrss, on_error="ignore")
            import resource
            own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print(result.hash, own, *memory.values(), time.time() - begun)

if __name__ == "__main__":
    main()
"""


def by_dask(tmp_path: Path, growths: int, layers: int, kills: int) -> list[str]:
    script = tmp_path / "cluster.py"
    script.write_text(DASK)
    arguments = [sys.executable, str(script), str(growths), str(layers), str(kills)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=3600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_dask_and_lost_workers_change_no_byte(tmp_path: Path) -> None:
    """Grows 1e6 bodies of 500 layers. Only with GROWBOT_PYTHON=complete."""
    growths, layers = (1_000_000, 500) if COMPLETE else (20_000, 50)
    robot = growbot.Robot()
    height = robot.description["layer"]["height_mm"]
    one = growbot.CampaignSpec(
        (robot,), ((0, 0, layers * height - 0.1, 0, 90),), (growbot.Conditions(noise_percent=10),), growths
    )
    wanted = growbot.run_campaign(one).hash
    for kills in (0, 2):
        found = by_dask(tmp_path, growths, layers, kills)
        print(
            f"Dask, {growths} growths of {layers} layers, {kills} workers killed: "
            f"memory (kB) {found[1:-1]}, {found[-1]} s"
        )
        assert found[0] == wanted
        assert all(int(memory) < 500_000 for memory in found[1:-1])
