"""Exports bodies with growbot and reads them back. trimesh reads STL, OBJ and GLB, Python reads 3MF and CSV, and evo
reads TUM. PrusaSlicer slices 3MF. The `mcap` package reads MCAP, and rosbags and mcap-ros2-support read its types of
ROS 2.

    check.py GROWBOT

A failed check ends the program with a message and exit code 1. tests/exports/run calls it.
"""

import csv
import io
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy
import trimesh
from evo.core import metrics
from evo.tools import file_interface
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

GROWBOT = sys.argv[1]
# Environment without growbot's settings, so that no check moves the configured robot.
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("GROWBOT_")}
# Namespace of the core specification of 3MF.
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
# Max error of a wall's volume, as a fraction of the filament used.
VOLUME = 0.005

# Name, arguments for planning, arguments for the export.
PLANS = [
    ("643 mm", ["--to", "200,100,600,0,45"], []),
    ("helicoidal", ["--to", "60,50,40,100,-20"], []),
    ("from far out", ["--from", "3000,-2000,1000,30,20", "--to", "3600,-2300,1500,80,-40"], []),
    ("robot B", ["--robot", "growbot-b", "--to", "3000,2000,6000,0,45"], []),
    ("robot C", ["--robot", "growbot-c", "--to", "300,200,600,0,45"], []),
    ("8 chords, rings at every 9th", ["--to", "200,100,600,0,45"], ["--segments", "8", "--every", "9"]),
    ("10,000 layers, every 2nd", ["--to", "1000,500,7700,0,45"], ["--segments", "32", "--every", "2"]),
]
# Name, and arguments for growing.
RUNS = [
    ("52 layers as built", ["--robot", "growbot-a2", "--to", "0,0,40,0,90"]),
    ("with noise and feedback", ["--to", "100,50,300,0,45", "--noise", "10", "--feedback"]),
]


def demand(holds, message):
    if not holds:
        sys.exit(f"tests/exports: {message}")


def growbot(*args, code=0):
    ran = subprocess.run([GROWBOT, *map(str, args)], capture_output=True, text=True, env=ENVIRONMENT)
    demand(ran.returncode == code, f"growbot {' '.join(map(str, args))}: exit {ran.returncode}: {ran.stderr}")
    return ran


def check_mesh(name, mesh, volume):
    """Checks that a mesh is a closed surface, wound outwards, with this volume, mm^3. Returns its relative error."""
    uses = numpy.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    demand(mesh.is_watertight and (uses == 2).all(), f"{name}: not every edge is shared by two faces")
    demand(mesh.is_winding_consistent, f"{name}: faces disagree about outside")
    # The body is a torus, because it has one hole from rim to rim.
    demand(mesh.euler_number == 0, f"{name}: Euler characteristic {mesh.euler_number}")
    off = mesh.volume / volume - 1
    demand(abs(off) <= VOLUME, f"{name}: volume off by {100 * off:.3f} %")
    return off


def read_3mf(name, path):
    """Returns the only mesh of a 3MF file, mm, with its triangles as they are."""
    with zipfile.ZipFile(path) as archive:
        demand(archive.testzip() is None, f"{name}, 3MF: wrong checksum")
        targets = [relation.get("Target") for relation in ElementTree.fromstring(archive.read("_rels/.rels"))]
        demand(targets == ["/3D/3dmodel.model"], f"{name}, 3MF: models {targets}")
        model = ElementTree.fromstring(archive.read(targets[0][1:]))
    demand(model.get("unit") == "millimeter", f"{name}, 3MF: unit {model.get('unit')}")
    [object_] = model.findall(f"{CORE}resources/{CORE}object")
    items = [item.attrib for item in model.findall(f"{CORE}build/{CORE}item")]
    demand(items == [{"objectid": object_.get("id")}], f"{name}, 3MF: the build is {items}")
    vertices = [[float(at.get(axis)) for axis in "xyz"] for at in object_.iter(f"{CORE}vertex")]
    faces = [[int(at.get(corner)) for corner in ("v1", "v2", "v3")] for at in object_.iter(f"{CORE}triangle")]
    return trimesh.Trimesh(vertices, faces, process=False)


def check_wall(name, directory, source, options, volume, parts=0):
    stl, glb = directory / "body.stl", directory / "body.glb"
    began = time.monotonic()
    growbot("export", source, "-o", stl, *options)
    took = time.monotonic() - began
    growbot("export", source, "-o", glb, *options)
    content = stl.read_bytes()
    demand(content.startswith(b"binary STL, units mm"), f"{name}: the header of the STL does not say mm")
    in_mm = trimesh.load_mesh(stl)
    demand(len(content) == 84 + 50 * len(in_mm.faces), f"{name}: faces of the STL were dropped or merged")
    off = check_mesh(f"{name}, STL", in_mm, volume)
    obj, three_mf = directory / "body.obj", directory / "body.3mf"
    for path in (obj, three_mf):
        growbot("export", source, "-o", path, *options)
    demand(obj.read_text().split("\n")[1] == "# units mm, z up", f"{name}: the OBJ does not say mm")
    shared = {"OBJ": trimesh.load_mesh(obj, process=False), "3MF": read_3mf(name, three_mf)}
    for format_, mesh in shared.items():
        check_mesh(f"{name}, {format_}", mesh, volume)
        demand(len(mesh.vertices) == len(in_mm.vertices), f"{name}, {format_}: {len(mesh.vertices)} vertices")
        # The same triangles, in the same order. STL has 32-bit numbers.
        same = numpy.array_equal(mesh.triangles.astype(numpy.float32), in_mm.triangles.astype(numpy.float32))
        demand(same, f"{name}, {format_}: not the triangles of the STL")
        off_stl = mesh.volume / in_mm.volume - 1
        demand(abs(off_stl) < 1e-3, f"{name}, {format_}: volume off by {100 * off_stl:.4f} % from the STL")
    scene = trimesh.load_scene(glb)
    # If a body was laid elsewhere than commanded, the GLB has the commanded body too, under its own name.
    beside = set(scene.geometry) - {"wall"}
    demand(beside <= {"wall, commanded"} and "wall" in scene.geometry, f"{name}: GLB of {set(scene.geometry)}")
    demand(len(beside) == parts, f"{name}: GLB with {len(beside)} bodies beside the one")
    # The vertices' colours are the heights of the layers.
    colours = scene.geometry["wall"].visual.vertex_attributes["color"]
    layers = {(row["height_mm"], row["tilt_deg"]) for row in table(source)[1:]}
    demand(len(colours) == len(scene.geometry["wall"].vertices), f"{name}: vertices without a colour")
    demand(len(layers) < 3 or len(numpy.unique(colours, axis=0)) > 1, f"{name}: vertices of one colour")
    scene.delete_geometry(beside)
    demand(len(scene.graph.nodes_geometry) == 1, f"{name}: GLB of more than one body")
    in_metres = scene.to_mesh()
    check_mesh(f"{name}, GLB", in_metres, volume / 1e9)
    # Converts y up to z up, and metres to mm.
    turned = in_metres.bounds * 1000
    (x0, y0, z0), (x1, y1, z1) = turned
    far = numpy.abs(numpy.array([[x0, -z1, y0], [x1, -z0, y1]]) - in_mm.bounds).max()
    demand(far < 1e-2, f"{name}: STL and GLB are {far} mm apart")
    print(
        f"{name:30} {len(in_mm.faces):9} {len(content) / 1e6:9.1f} {glb.stat().st_size / 1e6:9.1f} {took:7.2f} "
        f"{100 * off:+10.4f}"
    )


def table(source):
    text = growbot("export", source, "--format", "csv").stdout
    return list(csv.DictReader(io.StringIO(text)))


def numbers(row, *columns):
    return [float(row[column]) for column in columns]


def check_plan(name, directory, plan_args, options):
    plan = directory / "plan.json"
    growbot("plan", *plan_args, "-o", plan)
    planned = json.loads(plan.read_text())
    diameter = 1.75 if planned["robot"] == "growbot-a" else filament_diameter(planned["robot"])
    check_wall(name, directory, plan, options, planned["filament_mm"] * math.pi / 4 * diameter**2)
    rows = table(plan)
    demand(len(rows) == planned["layers"] + 1, f"{name}: {len(rows)} rows for {planned['layers']} layers")
    goal = [planned["goal"][field] for field in ("x_mm", "y_mm", "z_mm")]
    demand(math.dist(numbers(rows[-1], "x_mm", "y_mm", "z_mm"), goal) < 1e-4, f"{name}: the centreline misses the goal")
    layers = csv.DictReader(io.StringIO(growbot("layers", plan).stdout))
    columns = ("alpha_deg", "height_mm", "tilt_deg")
    same = all([row[c] for c in columns] == [layer[c] for c in columns] for row, layer in zip(rows[1:], layers))
    demand(same, f"{name}: not the layers of growbot layers")


def filament_diameter(robot):
    import tomllib

    description = tomllib.loads((Path(__file__).parents[2] / "robots" / f"{robot}.toml").read_text())
    return description["feed"]["filament_diameter_mm"]


def read_recording(name, path):
    """Returns the messages by topic, each with its time in s, checked against their schemas."""
    messages = {}
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        last = 0
        for schema, channel, message in reader.iter_messages():
            known = json.loads(schema.data)["properties"]
            content = json.loads(message.data)
            demand(schema.encoding == "jsonschema" and channel.message_encoding == "json", f"{name}: another encoding")
            demand(content.keys() <= known.keys(), f"{name}: {channel.topic} has fields beyond its schema")
            demand(message.log_time >= last, f"{name}: time runs backwards")
            last = message.log_time
            stamp = content.get("timestamp")
            demand(not stamp or stamp["sec"] * 10**9 + stamp["nsec"] == last, f"{name}: two times in one message")
            messages.setdefault(channel.topic, []).append((last / 1e9, content))
        demand(
            reader.get_summary().statistics.message_count == sum(map(len, messages.values())), f"{name}: messages lost"
        )
    return messages


def check_recording(name, directory, log):
    recording = directory / "run.mcap"
    growbot("export", log, "-o", recording)
    messages = read_recording(name, recording)
    events = [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
    told = Counter(event["event"] for event in events)
    for topic, kind in (("/layers", "laid"), ("/body", "laid"), ("/status", "status")):
        demand(len(messages[topic]) == told[kind], f"{name}: {len(messages[topic])} of {told[kind]} on {topic}")
    rows = table(log)
    position = messages["/tip"][-1][1]["pose"]["position"]
    tip = [1000 * position[axis] for axis in "xyz"]
    demand(math.dist(tip, numbers(rows[-1], "x_mm", "y_mm", "z_mm")) < 1e-6, f"{name}: the tip is elsewhere")
    reached = json.loads(growbot("replay", log, "--json").stdout)["final"]
    demand(
        math.dist(tip, [reached[f"{axis}_mm"] for axis in "xyz"]) < 1e-6, f"{name}: the tip is not where replay has it"
    )
    turn = messages["/tip"][-1][1]["pose"]["orientation"]
    demand(abs(sum(part**2 for part in turn.values()) - 1) < 1e-9, f"{name}: no unit quaternion")
    heat = [status["temperature_c"] for _, status in messages["/status"] if "temperature_c" in status]
    demand(heat and max(heat) > 180, f"{name}: the nozzle never was hot")
    took = messages["/layers"][-1][0]
    size = recording.stat().st_size / 1e6
    print(f"{name:30} {len(messages['/layers'])} layers, {len(heat)} temperatures, {took:.0f} s, {size:.1f} MB of MCAP")
    return messages


# Max difference of a pose from the CSV file: m, and of a unit vector.
POSE = 1e-12
# Types of the topics of ROS 2.
ROS2 = {
    "/growbot/start": "geometry_msgs/msg/PoseStamped",
    "/growbot/goal": "geometry_msgs/msg/PoseStamped",
    "/growbot/tip": "geometry_msgs/msg/PoseStamped",
    "/growbot/commanded": "geometry_msgs/msg/PoseStamped",
    "/growbot/plan": "nav_msgs/msg/Path",
    "/growbot/body": "nav_msgs/msg/Path",
    "/growbot/layers": "visualization_msgs/msg/Marker",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def poses_of(rows):
    """Returns positions in m and directions, from the table of a body."""
    positions = [[mm / 1000 for mm in numbers(row, "x_mm", "y_mm", "z_mm")] for row in rows]
    return positions, [numbers(row, "direction_x", "direction_y", "direction_z") for row in rows]


def demand_poses(name, poses, rows):
    """Checks that poses, each a position (m) and a quaternion (x, y, z, w), equal those of the table."""
    demand(len(poses) == len(rows), f"{name}: {len(poses)} poses of {len(rows)}")
    for (position, (x, y, z, w)), at, to in zip(poses, *poses_of(rows)):
        demand(math.dist(position, at) <= POSE, f"{name}: {position} is {math.dist(position, at)} m from {at}")
        axis = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        demand(math.dist(axis, to) <= POSE, f"{name}: points {math.dist(axis, to)} off {to}")
        demand(abs(x * x + y * y + z * z + w * w - 1) <= POSE, f"{name}: no unit quaternion")


def pose_of(pose):
    p, q = pose.position, pose.orientation
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def nanoseconds(header):
    demand(header.frame_id == "base", f"frame {header.frame_id}")
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def same(one, other):
    """Returns true if two readers decode the same values in a message."""
    if hasattr(one, "__msgtype__"):
        # Constants, in capitals, are not in the message.
        fields = [field for field in one.__dataclass_fields__ if field[0] != "_" and not field.isupper()]
        return all(same(getattr(one, field), getattr(other, field)) for field in fields)
    if isinstance(one, (list, numpy.ndarray)):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other))
    if isinstance(one, int) and isinstance(other, bytes):
        return bytes([one]) == other
    return one == other


def check_ros2(name, directory, log):
    """Checks all messages in the types of ROS 2, as two readers decode them, and the poses in them."""
    bag = directory / "bag.mcap"
    growbot("export", log, "-o", bag, "--ros2")
    known = get_typestore(Stores.ROS2_JAZZY)
    messages, stamps = {}, []
    with Reader(bag) as reader:
        for connection in reader.connections:
            demand(ROS2[connection.topic] == connection.msgtype, f"{name}: {connection.topic} is {connection.msgtype}")
            demand(connection.msgdef.format.name == "MSG", f"{name}: {connection.topic} has no ros2msg schema")
            # The definition in the file decodes the messages. By its hash it is that of ROS 2.
            own = get_typestore(Stores.EMPTY)
            own.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            kind = connection.msgtype
            demand(own.hash_rihs01(kind) == known.hash_rihs01(kind), f"{name}: another definition of {kind}")
        for connection, time, data in reader.messages():
            message = known.deserialize_cdr(data, connection.msgtype)
            written = bytes(known.serialize_cdr(message, connection.msgtype))
            demand(written == bytes(data), f"{name}: rosbags writes a {connection.msgtype} with other bytes")
            messages.setdefault(connection.topic, []).append((time, message))
            stamps.append(time)
    demand(stamps == sorted(stamps), f"{name}: time runs backwards")
    with open(bag, "rb") as file:
        demand(make_reader(file).get_header().profile == "ros2", f"{name}: not the profile of ROS 2")
    again = {}
    for read in read_ros2_messages(str(bag)):
        again.setdefault(read.channel.topic, []).append((read.log_time_ns, read.ros_msg))
    demand(again.keys() == messages.keys(), f"{name}: mcap-ros2 finds {again.keys()}")
    for topic, found in messages.items():
        demand(len(found) == len(again[topic]), f"{name}: {topic} of another length")
        for (time, one), (other_time, other) in zip(found, again[topic]):
            demand(time == other_time and same(one, other), f"{name}: two readers differ on {topic}: {one} {other}")
    check_ros2_messages(name, messages, log)
    return sum(map(len, messages.values()))


def check_ros2_messages(name, messages, log):
    rows, events = table(log), [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
    told = Counter(event["event"] for event in events)
    for time, message in (entry for topic in messages if topic not in ("/tf",) for entry in messages[topic]):
        demand(nanoseconds(message.header) == time, f"{name}: two times in one message")
    tips = messages["/growbot/tip"]
    demand_poses(f"{name}, tip", [pose_of(message.pose) for _, message in tips], rows)
    way = messages["/growbot/body"][-1][1].poses
    demand_poses(f"{name}, body", [pose_of(message.pose) for message in way], rows)
    demand([nanoseconds(message.header) for message in way] == [time for time, _ in tips], f"{name}: times of the body")
    transforms = [message.transforms[0] for _, message in messages["/tf"]]
    demand({transform.child_frame_id for transform in transforms} == {"tip"}, f"{name}: another frame")
    turns = [(t.transform.translation, t.transform.rotation) for t in transforms]
    demand_poses(f"{name}, tf", [((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)) for p, q in turns], rows)
    if "commanded_x_mm" in rows[0]:
        at = [[float(row[f"commanded_{axis}_mm"]) / 1000 for axis in "xyz"] for row in rows[1:]]
        found = [pose_of(message.pose)[0] for _, message in messages["/growbot/commanded"]]
        demand(len(at) == len(found), f"{name}: {len(found)} commanded poses")
        demand(max(map(math.dist, at, found)) <= POSE, f"{name}: commanded elsewhere")
    plan = json.loads(log.read_text().splitlines()[0])["plan"]
    goal = [plan["goal"][f"{axis}_mm"] / 1000 for axis in "xyz"]
    demand(math.dist(pose_of(messages["/growbot/goal"][0][1].pose)[0], goal) <= POSE, f"{name}: another goal")
    demand(len(messages["/growbot/plan"][0][1].poses) == plan["layers"] + 1, f"{name}: another plan")
    markers = [message for _, message in messages["/growbot/layers"]]
    demand([marker.id for marker in markers] == list(range(len(rows) - 1)), f"{name}: markers")
    heights = [float(row["height_mm"]) / 1000 for row in rows[1:]]
    demand(
        all(abs(m.scale.z - h) <= POSE and m.type == m.CYLINDER for m, h in zip(markers, heights)), f"{name}: heights"
    )
    states = [m.status[0] for _, m in messages["/diagnostics"] if m.status[0].name == "growbot: board"]
    demand(len(states) == told["status"], f"{name}: {len(states)} of {told['status']} states")
    hot = [float(value.value) for state in states for value in state.values if value.key == "temperature_c"]
    demand(hot == [event["temperature_c"] for event in events if "temperature_c" in event], f"{name}: temperatures")
    demand(all("(simulated)" in state.hardware_id for state in states), f"{name}: does not say that it is simulated")


def check_tum(name, directory, log):
    """Checks that evo reads the trajectory, and that its error against the copy that evo writes is 0."""
    file, written = directory / "tip.tum", directory / "written.tum"
    growbot("export", log, "-o", file)
    trajectory = file_interface.read_tum_trajectory_file(str(file))
    demand(trajectory.check()[0], f"{name}: evo finds {trajectory.check()[1]}")
    rows = table(log)
    start = len(rows) - trajectory.num_poses
    demand(start in (0, 1), f"{name}: {trajectory.num_poses} lines for {len(rows)} rows")
    quaternions = numpy.roll(trajectory.orientations_quat_wxyz, -1, axis=1)
    demand_poses(f"{name}, TUM", list(zip(trajectory.positions_xyz.tolist(), quaternions.tolist())), rows[start:])
    file_interface.write_tum_trajectory_file(str(written), trajectory)
    error = metrics.APE(metrics.PoseRelation.full_transformation)
    error.process_data((trajectory, file_interface.read_tum_trajectory_file(str(written))))
    demand(error.get_statistic(metrics.StatisticsType.max) < 1e-9, f"{name}: evo's copy is elsewhere")
    return trajectory


def check_ros(name, directory, log):
    count = check_ros2(name, directory, log)
    trajectory = check_tum(name, directory, log)
    took = trajectory.timestamps[-1] - trajectory.timestamps[0]
    print(f"{name:30} {count} messages of ROS 2, {trajectory.num_poses} poses of TUM over {took:.0f} s")


def check_run(name, directory, grow_args):
    log = directory / "run.jsonl"
    growbot("grow", *grow_args, "--log", log)
    end = json.loads(log.read_text().splitlines()[-1])["result"]
    volume = end["filament_mm"] * math.pi / 4 * 1.75**2
    check_wall(name, directory, log, [], volume, parts=int("--noise" in grow_args))
    messages = check_recording(name, directory, log)
    check_ros(name, directory, log)
    demand("/faults" not in messages, f"{name}: a fault out of nowhere")
    demand(messages["/events"][-1][1]["message"] == "end: done", f"{name}: no end")


def check_fault(directory):
    """Checks the export of a log that was cut off after a fault."""
    whole, cut = directory / "whole.jsonl", directory / "cut.jsonl"
    growbot("grow", "--robot", "growbot-a2", "--to", "0,0,40,0,90", "--log", whole)
    lines = whole.read_text().splitlines(keepends=True)
    laid = [index for index, line in enumerate(lines) if '"event":"laid"' in line]
    status = json.loads(next(line for line in reversed(lines) if '"event":"status"' in line))
    status.update(fault="over-temperature", state="fault", temperature_c=251.5, laid=20)
    cut.write_text("".join(lines[: laid[19] + 1]) + json.dumps(status) + "\n" + lines[laid[20]][:30])
    messages = check_recording("cut off after a fault", directory, cut)
    check_ros("cut off after a fault", directory, cut)
    demand([fault["code"] for _, fault in messages["/faults"]] == ["over-temperature"], "the fault is not told")
    demand(messages["/status"][-1][1]["temperature_c"] == 251.5, "the temperature at the fault is not told")
    demand(len(table(cut)) == 21, "a log that was cut off has other layers")


def check_refusals(directory):
    plan, kept = directory / "plan.json", directory / "kept.stl"
    growbot("plan", "--to", "0,0,100,0,90", "-o", plan)
    kept.write_text("kept")
    broken = directory / "broken.json"
    broken.write_text(plan.read_text()[:300])
    before = sorted(directory.iterdir())
    for args in (
        [plan, "-o", directory / "a.mcap"],
        [plan, "-o", directory / "a.ply"],
        [plan, "-o", directory / "a.obj", "--ros2"],
        [plan, "-o", directory / "a.3mf", "--format", "obj"],
        [plan, "-o", directory / "a.stl", "--ros2"],
        [plan],
        [broken, "-o", kept],
        [kept, "-o", directory / "a.glb"],
        [directory / "missing.json", "-o", directory / "a.glb"],
        [plan, "-o", directory / "missing" / "a.stl"],
        [plan, "-o", kept, "--robot", "growbot-b"],
        [plan, "-o", kept, "--segments", "1"],
    ):
        output = growbot("export", *args, code=2).stderr
        first, *rest = output.splitlines()
        demand(first.startswith("error: "), f"no error for {args}: {output}")
        one = all(not line.strip() or line.startswith("    ") for line in rest)
        demand(one or "--segments" in args, f"more than one message for {args}: {output}")
    demand(
        sorted(directory.iterdir()) == before and kept.read_text() == "kept", "something was left of what was refused"
    )


# Max relative error of the volume of obstacles, which their facets cause.
FACETS = 0.03


def check_scene(directory):
    """Checks the scene around a body: obstacles of the right size and place, translucent, and a mark at one."""
    room, plan, glb = directory / "room.toml", directory / "plan.json", directory / "body.glb"
    ball, box = ([0, 0, 300], 60), ([150, 0, 300], [30, 200, 300])
    room.write_text(
        'format = "growbot-scene/1"\nmargin_mm = 5\n'
        f"[[ball]]\ncenter_mm = {ball[0]}\nradius_mm = {ball[1]}\n[[box]]\ncenter_mm = {box[0]}\nsize_mm = {box[1]}\n"
    )
    growbot("plan", "--to", "0,0,500", "--scene", room, "-o", plan)
    growbot("export", plan, "-o", glb, "--segments", "16", "--every", "4")
    scene = trimesh.load_scene(glb)
    names = {"wall", "obstacles", "narrowest place"}
    demand(set(scene.geometry) == names, f"scene: GLB of {set(scene.geometry)}")
    demand(scene.geometry["wall"].is_watertight, "scene: an open wall")
    obstacles = scene.geometry["obstacles"]
    material = obstacles.visual.material
    demand(material.alphaMode == "BLEND" and material.baseColorFactor[3] < 128, f"scene: not translucent: {material}")
    demand(obstacles.is_watertight and obstacles.is_winding_consistent, "scene: open obstacles")
    volume = 4 / 3 * math.pi * ball[1] ** 3 + math.prod(box[1])
    off = obstacles.volume * 1e9 / volume - 1
    demand(-FACETS < off < 1e-6, f"scene: volume of the obstacles off by {100 * off:.2f} %")
    # Relative to the start of the plan, which is the origin. x, y and z are in the base's frame before the node's
    # rotation.
    ends = numpy.array([[-60, -100, 150], [165, 100, 450]])
    far = numpy.abs(obstacles.bounds * 1000 - ends).max()
    demand(far < 0.6, f"scene: the obstacles are {far} mm from where they should be")
    clearance_mm = json.loads(plan.read_text())["scene"]["clearance_mm"]
    tip = scene.geometry["narrowest place"].vertices * 1000
    near = numpy.abs(numpy.linalg.norm(tip - ball[0], axis=1) - ball[1]).min()
    demand(near < 1.5, f"scene: the mark ends {near} mm from the ball")
    print(f"scene: {len(obstacles.faces)} triangles of obstacles, {clearance_mm:.2f} mm clear, volume {100 * off:+.2f} %")


def slicer(directory, *args):
    command = ["prusa-slicer", *map(str, args)]
    ran = subprocess.run(command, capture_output=True, text=True, cwd=directory, env=ENVIRONMENT)
    demand(ran.returncode == 0, f"prusa-slicer {' '.join(map(str, args))}: exit {ran.returncode}: {ran.stderr}")
    return ran.stdout


def check_slicer(directory):
    """Checks that PrusaSlicer finds the wall in 3MF and OBJ manifold and of the volume of the STL, and slices 3MF."""
    plan, files = directory / "plan.json", [directory / f"body.{ending}" for ending in ("stl", "3mf", "obj")]
    # Rings at every 2nd layer, because a coarser body is sliced faster.
    growbot("plan", "--to", "60,30,150,0,70", "-o", plan)
    found = []
    for file in files:
        growbot("export", plan, "-o", file, "--segments", "32", "--every", "2")
        info = dict(line.split(" = ") for line in slicer(directory, "--info", file).splitlines() if " = " in line)
        demand(info["manifold"] == "yes", f"{file.name}: not manifold: {info}")
        demand(info["number_of_parts"].strip() == "1", f"{file.name}: {info['number_of_parts']} parts")
        found.append((int(info["number_of_facets"]), float(info["volume"])))
        demand(found[-1][0] == found[0][0], f"{file.name}: {found[-1][0]} of {found[0][0]} facets")
        off = found[-1][1] / found[0][1] - 1
        demand(abs(off) < 1e-3, f"{file.name}: volume off by {100 * off:.3f} % from the STL")
    gcode = directory / "body.gcode"
    slicer(directory, "--export-gcode", files[1], "-o", gcode)
    extruded = [line for line in gcode.read_text().splitlines() if line.startswith("G1 ") and " E" in line]
    demand(len(extruded) > 1000, f"G-code with {len(extruded)} extrusions")
    print(f"slicer: {found[1][0]} facets, manifold, {found[1][1]:.1f} mm^3 in 3MF, {len(extruded)} extrusions")


def main():
    print(f"{'body':30} {'triangles':>9} {'STL, MB':>9} {'GLB, MB':>9} {'STL, s':>7} {'volume, %':>10}")
    for name, *rest in PLANS:
        with tempfile.TemporaryDirectory() as directory:
            check_plan(name, Path(directory), *rest)
    for name, *rest in RUNS:
        with tempfile.TemporaryDirectory() as directory:
            check_run(name, Path(directory), *rest)
    for check in (check_scene, check_fault, check_refusals, check_slicer):
        with tempfile.TemporaryDirectory() as directory:
            check(Path(directory))


main()
