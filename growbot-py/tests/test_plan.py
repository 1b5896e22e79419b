"""Poses, robots, plans, and their parts."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import growbot
from conftest import START, goals

coordinate = st.floats(-900, 900).filter(lambda number: number == 0 or abs(number) > 1e-9)
poses = st.builds(growbot.Pose, coordinate, coordinate, coordinate, st.floats(-180, 180), st.floats(-90, 90))


@given(poses)
def test_a_pose_survives_its_forms(pose: growbot.Pose) -> None:
    assert pickle.loads(pickle.dumps(pose)) == pose
    assert hash(pickle.loads(pickle.dumps(pose))) == hash(pose)
    assert growbot.Pose(pose.x_mm, pose.y_mm, pose.z_mm, pose.heading_deg, pose.pitch_deg) == pose
    assert eval(repr(pose), {"Pose": growbot.Pose}) == pose
    for again in (growbot.Pose.from_matrix(pose.matrix), growbot.Pose.from_direction(pose.position_mm, pose.direction)):
        assert np.array_equal(again.position_mm, pose.position_mm)
        assert np.abs(again.direction - pose.direction).max() < 1e-12
    assert np.array_equal(pose.matrix[:3, 2], pose.direction)


@settings(max_examples=60, deadline=None)
@given(poses, poses, st.sampled_from(["shortest", "two-plane"]))
def test_a_plan_arrives_and_survives_pickle(start: growbot.Pose, goal: growbot.Pose, planner: str) -> None:
    plan = growbot.plan(start, goal, planner=planner)  # type: ignore[arg-type]
    again = pickle.loads(pickle.dumps(plan))
    assert again == plan and hash(again) == hash(plan) and again.to_json() == plan.to_json()
    assert (plan.start, plan.goal, plan.planner) == (start, goal, planner)
    if plan.length_mm == 0:
        return
    near = 1e-6 * max(plan.length_mm, 1)
    end = plan.frames(plan.length_mm)[0]
    assert np.abs(end[:3, 3] - goal.position_mm).max() < near
    assert np.abs(end[:3, 2] - goal.direction).max() < 1e-6
    positions, directions = plan.sample(50)
    assert positions.shape == directions.shape == (50, 3)
    assert np.array_equal(positions[0], start.position_mm)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-9)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert (steps <= plan.length_mm / 49 * (1 + 1e-9)).all()
    layers = plan.layers()
    assert len(layers) == plan.layer_count
    # The layers of a helicoidal arc are arcs with the same end, so their length differs a little.
    near_layers = 1e-4 * plan.length_mm if "H" in plan.path_type else near
    assert abs(layers["height_mm"].sum() - plan.length_mm) < near_layers
    assert abs(sum(segment.length_mm for segment in plan.segments) - plan.length_mm) < near


def test_places_do_not_depend_on_those_before() -> None:
    for plan in growbot.plan_many(START, goals(200, seed=3)):
        places = np.linspace(0, plan.length_mm, 23)
        shuffled = np.random.default_rng(1).permutation(23)
        assert np.allclose(plan.frames(places)[shuffled], plan.frames(places[shuffled]), atol=1e-7)
        frame = plan.frames(places)[7]
        assert np.allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-9)


def test_forms_of_poses_are_one() -> None:
    first = growbot.plan(START, (200, 100, 600, 0, 45))
    for start, goal in [
        (growbot.Pose(*START), growbot.Pose(200, 100, 600, 0, 45)),
        (list(START), np.array([200.0, 100, 600, 0, 45])),
        (np.array(START, dtype=np.float32), (np.int64(200), 100, 600, 360, 45)),
    ]:
        assert growbot.plan(start, goal) == first
    many = growbot.plan_many([START] * 2, [[200, 100, 600, 0, 45]] * 2, threads=2)
    assert many == [first, first]
    free = growbot.plan(START, (200, 100, 600))
    assert growbot.plan_many(growbot.Pose(*START), [(200, 100, 600)]) == [free]
    assert free.length_mm < first.length_mm


def test_radius_robot_via_and_self() -> None:
    wide = growbot.plan(START, (200, 100, 600, 0, 45), radius_mm=150, robot="growbot-a")
    assert wide.radius_mm == 150 and wide.robot == growbot.Robot()
    assert growbot.plan(START, (900, 0, 3000), robot=growbot.Robot("growbot-b")).robot.name == "growbot-b"
    legs = growbot.plan(START, (800, 0, 0, 0, -90), via=[(200, 0, 400, 0, 0), (600, 0, 300)])
    assert [pose.x_mm for pose in legs.via] == [200, 600]
    crossing = growbot.plan(START, (20, 10, 60, 0, 80))
    assert [warning.code for warning in crossing.warnings] == ["self-collision"]
    near = goals(50, seed=4) * [0.2, 0.2, 0.2, 1, 1]
    clear = growbot.plan_many(START, near, avoid_self_collision=True)
    assert clear == [growbot.plan(START, goal, avoid_self_collision=True) for goal in near]
    pairs = zip(clear, growbot.plan_many(START, near), strict=True)
    assert all(one.length_mm >= shortest.length_mm for one, shortest in pairs)
    assert pickle.loads(pickle.dumps(crossing.warnings)) == crossing.warnings
    assert pickle.loads(pickle.dumps(crossing.segments)) == crossing.segments


def test_a_robot_survives(tmp_path: Path) -> None:
    for name in growbot.Robot.builtin_names():
        robot = growbot.Robot(name)
        assert pickle.loads(pickle.dumps(robot)) == robot and hash(robot) == hash(growbot.Robot(name))
        assert robot.name in repr(robot) and robot.description["name"] == name
        assert robot.min_radius_mm <= robot.planning_radius_mm
    assert growbot.Robot("growbot-a") != growbot.Robot("growbot-b")


def test_layers_are_a_table(plan: growbot.Plan) -> None:
    frame = pandas.DataFrame(plan.layers())
    assert list(frame.columns) == ["layer", "segment", "alpha_deg", "height_mm", "tilt_deg"]
    assert (frame.groupby("segment")["height_mm"].sum() - [s.length_mm for s in plan.segments]).abs().max() < 1e-9


def test_files_and_pages(plan: growbot.Plan, tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    plan.save(file)
    plan.save(file)
    again = growbot.Plan.load(file)
    assert again.to_json() == plan.to_json() == growbot.Plan.from_json(plan.to_json()).to_json()
    again.save(file)
    page = plan.view(tmp_path / "plan.html", browser=False)
    text = Path(page).read_text()
    assert text == plan.html() and "connect-src 'none'" in text
    assert plan._repr_html_().startswith("<iframe") and "srcdoc" in plan._repr_html_()
    grown = plan.simulate(seed=2, conditions=growbot.Conditions(noise_percent=5))
    assert "simulated" in grown.html() and grown._repr_html_().startswith("<iframe")
    assert pickle.loads(pickle.dumps(grown)) == grown != plan.simulate(seed=3)
    assert len(grown.layers()) == grown.layer_count


def test_a_scene(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    file.write_text(
        'format = "growbot-scene/1"\nmargin_mm = 5\n[[ball]]\ncenter_mm = [0, 0, 400]\nradius_mm = 100\n'
    )
    scene = growbot.Scene(file)
    assert pickle.loads(pickle.dumps(scene)) == scene and scene.margin_mm == 5
    assert np.allclose(scene.distances([[0, 0, 0], [0, 0, 400]]), [300, -100])
    plan = growbot.plan(START, (0, 0, 800), scene=scene)
    assert plan.clearance_mm is not None and 5 <= plan.clearance_mm < 100
    positions, _ = plan.sample(500)
    assert (scene.distances(positions) > 5 + plan.robot.outer_diameter_mm / 2 - 1e-3).all()
    assert pickle.loads(pickle.dumps(plan)) == plan
    with pytest.raises(growbot.NoPathError) as refused:
        growbot.plan(START, (0, 0, 400), scene=scene)
    assert refused.value.value == pytest.approx(-100) and refused.value.limit is not None


def end_of(start: tuple[float, ...], layers: Any) -> Any:
    """Returns the position of the tip after these layers, by Eq 4."""
    frame = growbot.Pose(*start).matrix
    for layer in layers:
        bend, alpha, length = np.radians(layer["tilt_deg"]), np.radians(layer["alpha_deg"]) + np.pi, layer["height_mm"]
        c, s = np.cos(alpha), np.sin(alpha)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        about_y = np.array([[np.cos(bend), 0, np.sin(bend)], [0, 1, 0], [-np.sin(bend), 0, np.cos(bend)]])
        step = np.eye(4)
        step[:3, :3] = turn @ about_y @ turn.T
        radius = length / bend if bend > 1e-12 else 0.0
        along = [radius * (1 - np.cos(bend)), 0, radius * np.sin(bend)] if bend > 1e-12 else [0, 0, length]
        step[:3, 3] = turn @ along
        frame = frame @ step
    return frame[:3, 3]


def test_a_twisted_body_is_shown_as_it_was_laid() -> None:
    plan = growbot.plan(START, (200, 100, 600, 0, 45))
    grown = plan.simulate(conditions=growbot.Conditions(twist_bias_deg=0.1))
    assert grown.position_error_mm > 20
    assert np.allclose(end_of(START, grown.layers()), grown.final_pose.position_mm, atol=1e-6)
    assert f"{grown.position_error_mm:.3f} mm" in grown.html()
    # The tip lies a little nearer to another part of the path than to its end.
    assert 0.9 * grown.position_error_mm < grown.plan_deviation_mm <= grown.position_error_mm


def test_a_sagging_body_is_shown_with_its_sag() -> None:
    start = (0.0, 0.0, 0.0, 0.0, 0.0)
    plan = growbot.plan(start, (1500, 0, 0, 0, 0))
    grown = plan.simulate(conditions=growbot.Conditions(sag=True))
    assert grown.sag_mm is not None and grown.sag_mm == pytest.approx(grown.position_error_mm) and grown.sag_mm > 20
    assert f"{grown.position_error_mm:.3f} mm" in grown.html()
    off = np.linalg.norm(end_of(start, grown.layers()) - grown.final_pose.position_mm)
    assert off < 0.05 * grown.sag_mm
    assert grown.plan_deviation_mm == pytest.approx(grown.sag_mm, rel=0.05)


def test_a_series_is_read_by_position() -> None:
    frame = pandas.DataFrame({"x": [1, 200], "y": [2, 100], "z": [3, 600], "heading": [4, 0], "pitch": [5, 45]})
    goal = frame.iloc[1]
    wanted = growbot.plan(START, tuple(goal))
    assert growbot.plan(START, goal) == wanted
    labelled = pandas.Series([200, 100, 600, 0, 45], index=[4, 3, 2, 1, 0])
    assert growbot.plan(START, labelled) == wanted
    assert growbot.plan(pandas.Series(START, index=[3, 1, 4, 0, 2]), np.array(goal)) == wanted
    assert growbot.plan(START, wanted.goal, via=[pandas.Series([0, 0, 100], index=[2, 1, 0])]).via[0].z_mm == 100
    for bad in ("12345", {0: 1}, pandas.Series(list("abcde")), pandas.Series([1, 2, 3, 4]), [[1, 2, 3]]):
        with pytest.raises((growbot.InputError, growbot.InputTypeError)):
            growbot.plan(START, bad)  # type: ignore[arg-type]


def test_a_pickled_scene_refuses_another_file(tmp_path: Path) -> None:
    file = tmp_path / "room.toml"
    ball = 'format = "growbot-scene/1"\n[[ball]]\ncenter_mm = [0, 0, {}]\nradius_mm = 100\n'
    file.write_text(ball.format(400))
    scene = growbot.Scene(file, margin_mm=2)
    kept = pickle.dumps(scene)
    assert pickle.loads(kept) == scene and pickle.loads(kept).margin_mm == 2
    assert scene.box_mm == ([-100, -100, 300], [100, 100, 500])
    file.write_text(ball.format(900))
    with pytest.raises(growbot.FileError, match="not the scene that was pickled"):
        pickle.loads(kept)


def test_the_margin_of_a_scene(tmp_path: Path) -> None:
    file = tmp_path / "wall.toml"
    file.write_text('format = "growbot-scene/1"\n[[halfspace]]\npoint_mm = [0, 0, 322.85]\nnormal = [0, 0, -1]\n')
    goal = (400, 0, 300, 0, 0)
    assert growbot.Scene(file).margin_mm is None
    with pytest.raises(growbot.NoPathError):
        growbot.plan(START, goal, scene=growbot.Scene(file))
    near = growbot.plan(START, goal, scene=growbot.Scene(file, margin_mm=0.01))
    assert [warning.code for warning in near.warnings] == ["near-obstacle"]
    assert "of 100 simulated growths" in near.warnings[0].message
    assert pickle.loads(pickle.dumps(near)) == near and near.warnings[0].limit == 4.82
    for bad in (-1, float("nan"), 1e9):
        with pytest.raises(growbot.InputError):
            growbot.Scene(file, margin_mm=bad)


def test_a_path_of_200_m_is_simulated_or_refused() -> None:
    plan = growbot.plan(START, (0, 0, 200_000, 0, 90))
    conditions = growbot.Conditions(feedback=True)
    assert plan.simulate(conditions=conditions).position_error_mm < 200
    with pytest.raises(growbot.InputError):
        plan.html()
