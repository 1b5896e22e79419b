"""Campaigns: robots x goals x conditions x seeds, in chunks that any number of processes compute.

A chunk is a pure function of (spec, number), so every worker computes the same bytes, however often. Sums are exact, so
chunks can be merged in any order. A lost worker costs the time of its chunk, but changes no result.
"""

from __future__ import annotations

import hashlib
import json
import operator
import os
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import astuple, dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Iterable, Iterator, Literal, Optional, Union

from growbot import _growbot
from growbot._conditions import Conditions
from growbot._errors import BoardError, InputError, InputTypeError, NoPathError
from growbot._growbot import Pose, Robot, SimulationSummary

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

#: Number of chunks in progress for each thread or worker. It limits the chunk results that wait.
_AHEAD = 4
#: Names of the planners.
_PLANNERS = ("shortest", "two-plane")
#: Number of times a chunk is given to another worker after its worker was lost.
_LOSSES = 20


@dataclass(frozen=True)
class CampaignSpec:
    """The growths of a campaign: every robot to every goal under all conditions, growths_per_cell times each.

    A goal is (x_mm, y_mm, z_mm, heading_deg, pitch_deg), or (x_mm, y_mm, z_mm) for any direction. A cell is a robot, a
    goal and conditions. Its growths have the seeds first_seed, first_seed + 1, ..., like those of
    ``growbot simulate --repeat``.
    """

    robots: tuple[Robot, ...]
    goals: tuple[tuple[float, ...], ...]
    conditions: tuple[Conditions, ...]
    #: Number of growths of each cell.
    growths_per_cell: int
    #: Start of the tip.
    start: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 90.0)
    #: Seed of the first growth of each cell.
    first_seed: int = 1
    #: Radius of the bends, mm. The default is each robot's planning_radius_mm.
    radius_mm: Optional[float] = None
    planner: Literal["shortest", "two-plane"] = "shortest"
    #: Number of growths of a chunk.
    growths_per_chunk: int = 4096
    #: Hash of all of the above, 64 hexadecimal digits. A chunk carries it.
    hash: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, kind in (("robots", Robot), ("conditions", Conditions)):
            items = _listed(name, getattr(self, name))
            for item in items:
                if not isinstance(item, kind):
                    given = type(item).__name__
                    raise InputTypeError(f"{name} holds a {given}: give growbot.{kind.__name__}", given, kind.__name__)
            object.__setattr__(self, name, items)
        goals = tuple(
            _numbers(f"goals[{index}]", goal, (3, 5)) for index, goal in enumerate(_listed("goals", self.goals))
        )
        object.__setattr__(self, "goals", goals)
        object.__setattr__(self, "start", _numbers("start", self.start, (5,)))
        _whole("growths_per_cell", self.growths_per_cell, 1, 1 << 53)
        _whole("first_seed", self.first_seed, 0, 2**64 - 1)
        _whole("growths_per_chunk", self.growths_per_chunk, 1, 1_000_000)
        if self.planner not in _PLANNERS:
            given = str(self.planner)[:100]
            message = f"planner is {given!r}: give \"shortest\" or \"two-plane\""
            raise InputError(message, given, ", ".join(_PLANNERS))
        if self.radius_mm is not None:
            object.__setattr__(self, "radius_mm", _positive("radius_mm", self.radius_mm))
        counts = [int(number) for number in (self.growths_per_cell, self.first_seed, self.growths_per_chunk)]
        conditions = [[_plain(value) for value in astuple(each)] for each in self.conditions]
        robots = [robot.hash for robot in self.robots]
        content = repr((robots, self.goals, conditions, self.start, self.radius_mm, self.planner, counts))
        object.__setattr__(self, "hash", hashlib.sha256(content.encode()).hexdigest())

    @property
    def cell_count(self) -> int:
        """Number of cells: robots x goals x conditions."""
        return len(self.robots) * len(self.goals) * len(self.conditions)

    @property
    def growth_count(self) -> int:
        """Number of growths."""
        return self.cell_count * self.growths_per_cell

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return -(-self.growth_count // self.growths_per_chunk)

    def cell(self, index: int) -> tuple[Robot, tuple[float, ...], Conditions]:
        """Returns robot, goal and conditions of a cell. Conditions change fastest, robots slowest."""
        _whole("index", index, 0, self.cell_count - 1)
        rest, condition = divmod(index, len(self.conditions))
        robot, goal = divmod(rest, len(self.goals))
        return self.robots[robot], self.goals[goal], self.conditions[condition]


@dataclass(frozen=True)
class ChunkResult:
    """Result of a chunk: the summaries of its cells, and the errors of cells that have no plan."""

    #: Number of the chunk.
    chunk: int
    #: CampaignSpec.hash of its campaign.
    spec_hash: str
    summaries: dict[int, SimulationSummary]
    errors: dict[int, str]


@dataclass
class CampaignResult:
    """Result of a campaign: a summary for each cell, in the order of CampaignSpec.cell."""

    spec: CampaignSpec
    summaries: list[SimulationSummary] = field(default_factory=list)
    #: Errors of cells that have no plan, by the index of the cell.
    errors: dict[int, str] = field(default_factory=dict)
    _added: set[int] = field(default_factory=set, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.summaries = [SimulationSummary() for _ in range(self.spec.cell_count)]

    def add(self, chunk: ChunkResult) -> None:
        """Adds a chunk of the same campaign, once. The order does not matter."""
        if not isinstance(chunk, ChunkResult):
            given = type(chunk).__name__
            raise InputTypeError(f"chunk is of type {given}: give a growbot.ChunkResult", given, "ChunkResult")
        if chunk.spec_hash != self.spec.hash:
            message = (
                f"chunk {chunk.chunk} is of another campaign, {chunk.spec_hash[:16]}..., not of "
                f"{self.spec.hash[:16]}...: robots, goals, conditions and all numbers of the two specs must be the same"
            )
            raise InputError(message, chunk.spec_hash, self.spec.hash)
        if chunk.chunk in self._added:
            raise InputError(f"chunk {chunk.chunk} was already added: add each chunk once", chunk.chunk, "once")
        self._added.add(chunk.chunk)
        for cell, summary in chunk.summaries.items():
            self.summaries[cell] = self.summaries[cell].merged(summary)
        self.errors.update(chunk.errors)

    @property
    def growth_count(self) -> int:
        """Number of growths. Cells without a plan have none."""
        return sum(summary.growth_count for summary in self.summaries)

    def to_json(self) -> str:
        """Returns all sums as JSON. Equal campaigns give equal bytes."""
        errors = {str(cell): self.errors[cell] for cell in sorted(self.errors)}
        return json.dumps({"cells": [json.loads(summary.to_json()) for summary in self.summaries], "errors": errors})

    @property
    def hash(self) -> str:
        """SHA-256 of to_json()."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()

    def table(self) -> npt.NDArray[np.void]:
        """Returns a structured array with a row for each cell: cell, robot, goal, conditions (indices) and growth_count.

        The distance from the goal has mean_mm, sd_mm, p50_mm, p95_mm and max_mm. mean_direction_error_deg comes last.
        """
        import numpy as np

        names = ("mean", "sd", "p50", "p95", "max")
        indices = [(name, "<i8") for name in ("cell", "robot", "goal", "conditions", "growth_count")]
        numbers = [(f"{name}_mm", "<f8") for name in names] + [("mean_direction_error_deg", "<f8")]
        table = np.zeros(len(self.summaries), dtype=indices + numbers)
        for cell, summary in enumerate(self.summaries):
            rest, condition = divmod(cell, len(self.spec.conditions))
            robot, goal = divmod(rest, len(self.spec.goals))
            error = summary.position_error_mm
            known = summary.growth_count > 0
            values = [error[name] if known else np.nan for name in names]
            direction = summary.direction_error_deg["mean"] if known else np.nan
            table[cell] = (cell, robot, goal, condition, summary.growth_count, *values, direction)
        return table


def run_chunk(spec: CampaignSpec, chunk: int, samples: Optional[Union[str, os.PathLike[str]]] = None) -> ChunkResult:
    """Grows a chunk of a campaign, in one thread. This is a pure function of (spec, chunk).

    With samples, every growth of the chunk also becomes a row of chunk-000000.parquet in that directory: the columns of
    simulate_many, and cell. The file is written completely or not at all.
    """
    _whole("chunk", chunk, 0, spec.chunk_count - 1)
    first = chunk * spec.growths_per_chunk
    end = min(first + spec.growths_per_chunk, spec.growth_count)
    summaries: dict[int, SimulationSummary] = {}
    errors: dict[int, str] = {}
    tables = []
    while first < end:
        cell, run = divmod(first, spec.growths_per_cell)
        count = min(end - first, spec.growths_per_cell - run)
        first += count
        robot, goal, conditions = spec.cell(cell)
        try:
            plan = _growbot.plan(spec.start, goal, robot=robot, radius_mm=spec.radius_mm, planner=spec.planner)
        except (NoPathError, InputError) as error:
            errors[cell] = str(error)
            continue
        seed = (spec.first_seed + run) % 2**64
        if samples is None:
            summaries[cell] = _growbot.simulate_repeated(plan, count, seed=seed, conditions=conditions, threads=1)
        else:
            summary, rows = _growbot._simulate_repeated_rows(plan, count, seed=seed, conditions=conditions, threads=1)
            summaries[cell] = summary
            tables.append((cell, rows))
    if samples is not None:
        _write_samples(Path(samples), chunk, tables)
    return ChunkResult(chunk, spec.hash, summaries, errors)


def merge_chunks(spec: CampaignSpec, chunks: Iterable[ChunkResult]) -> CampaignResult:
    """Merges chunks, in any order. Each of range(spec.chunk_count) must be there once, otherwise InputError is raised."""
    result = CampaignResult(spec)
    for chunk in chunks:
        result.add(chunk)
    missing = spec.chunk_count - len(result._added)
    if missing:
        first = next(chunk for chunk in range(spec.chunk_count) if chunk not in result._added)
        message = f"{missing} of {spec.chunk_count} chunks are missing, the first is {first}: run and add all chunks"
        raise InputError(message, spec.chunk_count - missing, spec.chunk_count)
    return result


def run_campaign(
    spec: CampaignSpec,
    scheduler: Optional[Any] = None,
    *,
    samples: Optional[Union[str, os.PathLike[str]]] = None,
    threads: Optional[int] = None,
    progress: Optional[Callable[[int, int], None]] = None,
) -> CampaignResult:
    """Grows a campaign on threads of this process, or on the workers of a dask.distributed.Client.

    samples is a directory for Parquet files, which all workers must be able to access (needs pyarrow). progress is
    called with the number of finished chunks and the number of all chunks. The result depends only on spec.
    """
    if not isinstance(spec, CampaignSpec):
        given = type(spec).__name__
        raise InputTypeError(f"spec is of type {given}: give a growbot.CampaignSpec", given, "CampaignSpec")
    if samples is not None:
        _needs_pyarrow()
        Path(samples).mkdir(parents=True, exist_ok=True)
    if scheduler is None:
        chunks = _by_threads(spec, samples, threads)
    elif hasattr(scheduler, "submit") and hasattr(scheduler, "nthreads"):
        chunks = _by_dask(scheduler, spec, samples)
    else:
        given = type(scheduler).__name__
        message = f"scheduler is of type {given}: give a dask.distributed.Client, or None for threads"
        raise InputTypeError(message, given, "dask.distributed.Client")
    result = CampaignResult(spec)
    for done, chunk in enumerate(chunks, start=1):
        result.add(chunk)
        if progress is not None:
            progress(done, spec.chunk_count)
    return result


def _by_threads(spec: CampaignSpec, samples: Optional[Any], threads: Optional[int]) -> Iterator[ChunkResult]:
    count = os.cpu_count() or 1 if threads is None else _whole("threads", threads, 1, 1024)
    pool = ThreadPoolExecutor(count)
    chunks = iter(range(spec.chunk_count))
    try:
        running: set[Future[ChunkResult]] = set()
        while True:
            for chunk in islice(chunks, _AHEAD * count - len(running)):
                running.add(pool.submit(run_chunk, spec, chunk, samples))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _by_dask(client: Any, spec: CampaignSpec, samples: Optional[Any]) -> Iterator[ChunkResult]:
    from distributed import KilledWorker, as_completed

    losses: dict[int, int] = {}
    chunk_of: dict[str, int] = {}

    def submit(chunk: int) -> Any:
        future = client.submit(run_chunk, spec, chunk, samples, pure=False)
        chunk_of[future.key] = chunk
        return future

    chunks = iter(range(spec.chunk_count))
    ahead = _AHEAD * max(1, sum(client.nthreads().values()))
    running = as_completed([submit(chunk) for chunk in islice(chunks, ahead)])
    for future in running:
        chunk = chunk_of.pop(future.key)
        try:
            result = future.result()
        except KilledWorker as error:
            # Dask blames a task if three of its workers were lost. A chunk is not to blame.
            losses[chunk] = losses.get(chunk, 0) + 1
            if losses[chunk] > _LOSSES:
                message = f"chunk {chunk} was lost with {_LOSSES} workers: check the memory and the logs of the workers"
                raise BoardError(message, losses[chunk], _LOSSES) from error
            running.add(submit(chunk))
            continue
        yield result
        for chunk in islice(chunks, 1):
            running.add(submit(chunk))


def _needs_pyarrow() -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise InputError("samples need pyarrow, which is not installed: run `pip install pyarrow`") from error


def _write_samples(directory: Path, chunk: int, tables: list[tuple[int, Any]]) -> None:
    import numpy as np
    import pyarrow
    import pyarrow.parquet

    columns: dict[str, Any] = {}
    if tables:
        columns["cell"] = np.concatenate([np.full(len(rows), cell, dtype="<i8") for cell, rows in tables])
        rows = np.concatenate([rows for _, rows in tables])
        names = [name for name in rows.dtype.names or () if name != "plan"]
        columns.update({name: np.ascontiguousarray(rows[name]) for name in names})
    place = directory / f"chunk-{chunk:06}.parquet"
    partial = place.with_suffix(f".{os.getpid()}-{os.urandom(4).hex()}.partial")
    try:
        pyarrow.parquet.write_table(pyarrow.table(columns), partial)
        os.replace(partial, place)
    finally:
        partial.unlink(missing_ok=True)


def _listed(name: str, value: Any) -> tuple[Any, ...]:
    try:
        items = tuple(islice(iter(value), 1_000_001))
    except TypeError:
        given = type(value).__name__
        raise InputTypeError(f"{name} is of type {given}: give a list or a tuple", given, "list, tuple") from None
    if len(items) > 1_000_000:
        raise InputError(f"{name} has more than 1000000 entries: split the campaign", len(items), 1_000_000)
    if not items:
        raise InputError(f"{name} is empty: give at least one entry", 0, 1)
    return items


def _numbers(name: str, value: Any, counts: tuple[int, ...]) -> tuple[Any, ...]:
    items = _listed(name, value)
    if len(items) not in counts:
        wanted = " or ".join(str(count) for count in counts)
        raise InputTypeError(f"{name} has {len(items)} numbers: give {wanted}", len(items), wanted)
    # Pose checks the numbers.
    x, y, z, heading, pitch = items if len(items) == 5 else (*items, 0, 0)
    Pose(x, y, z, heading, pitch)
    return tuple(float(number) for number in items)


def _plain(value: Any) -> Any:
    """Returns a value of conditions, so that equal numbers of any type have the same repr."""
    return value if value is None or isinstance(value, (bool, str)) else float(value)


def _positive(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        given = type(value).__name__
        raise InputTypeError(f"{name} is of type {given}: give a number", given, "float") from None
    if not 0.0 < number < float("inf"):
        raise InputError(f"{name} is {number}: give a number above 0", number, 0.0)
    return number


def _whole(name: str, value: Any, least: int, most: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        given = type(value).__name__
        raise InputTypeError(f"{name} is of type {given}: give a whole number", given, "int") from None
    if not least <= number <= most:
        value = number if abs(number) < 2**64 else float("inf") if number > 0 else -float("inf")
        message = f"{name} is {value}: give {least} to {most}"
        raise InputError(message, value, least if number < least else most)
    return number
