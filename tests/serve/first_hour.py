"""The first hour of an operator, by a client for Python that a generator made from the OpenAPI document of the service.

    first_hour.py CLIENT DOCUMENT_URL GROWBOT

CLIENT is the directory of the generated package, GROWBOT the program, which changes the spool. The robots are `lab`,
with little filament and a switch that detects its end, and `cold`, which cannot heat in time.

The script sends the example of each request body, calls each operation of the document, and compares each event with
its schema. Generated clients read no streams, and this one no pictures and no run logs, so the script requests these.
"""

import importlib
import io
import json
import re
import subprocess
import sys
import threading
import time
from urllib.parse import urljoin

import httpx
from jsonschema_rs import Draft202012Validator

directory, document_url, growbot = sys.argv[1:]
sys.path.insert(0, directory)
client_module = importlib.import_module("growbot_serve_client")
models = importlib.import_module("growbot_serve_client.models")
types = importlib.import_module("growbot_serve_client.types")

DEADLINE_S = 300
document = httpx.get(document_url).json()
url = urljoin(document_url, document["servers"][0]["url"])
client = client_module.Client(base_url=url, timeout=60)
operations = {
    operation["operationId"]: (path, operation)
    for path, methods in document["paths"].items()
    for operation in methods.values()
}
by_client, by_script = set(), set()


def snake(name):
    return re.sub("(?=[A-Z])", "_", name).lower()


def example(name):
    """Returns the example of an operation's request body."""
    content = operations[name][1]["requestBody"]["content"]["application/json"]["schema"]
    return document["components"]["schemas"][content["$ref"].rsplit("/", 1)[1]]["examples"][0]


def call(operation, *path, body=None, file=None, **options):
    """Calls an operation of the generated client. Returns the parsed response, and fails if it is a problem."""
    by_client.add(operation)
    module = importlib.import_module(f"growbot_serve_client.api.default.{snake(operation)}")
    if body is not None:
        schema = operations[operation][1]["requestBody"]["content"]["application/json"]["schema"]["$ref"]
        options["body"] = getattr(models, schema.rsplit("/", 1)[1]).from_dict(body)
    if file:
        options["body"] = file
    response = module.sync(*path, client=client, **options)
    assert not isinstance(response, models.Problem), f"{operation}: {response}"
    return response


def read(name, **places):
    """Requests the content of an operation whose response is not JSON. Returns the response."""
    response = client.get_httpx_client().get(operations[name][0].format(**places))
    check(name, response)
    return response


def check(name, response):
    """Compares the status and the media type of a response with the document."""
    by_script.add(name)
    kind = response.headers["content-type"].split(";")[0]
    assert response.status_code == 200, f"{name}: {response.status_code}"
    assert kind in operations[name][1]["responses"]["200"]["content"], f"{name}: {kind}"


def events(name, is_last, **places):
    """Returns the events of a stream until `is_last` returns true for one, or the stream ends."""
    found = []
    with client.get_httpx_client().stream("GET", operations[name][0].format(**places)) as response:
        check(name, response)
        event = {}
        for line in response.iter_lines():
            if line:
                field, _, value = line.partition(": ")
                event[field] = json.loads(value) if field == "data" else value
            elif "data" in event:
                found.append(event)
                if is_last(event):
                    break
                event = {}
    return found


def wait(what, look):
    """Returns the first true result of a function."""
    began = time.monotonic()
    while not (found := look()):
        assert time.monotonic() - began < DEADLINE_S, f"not within {DEADLINE_S} s: {what}"
        time.sleep(0.05)
    return found


def wait_for(name, *states):
    """Waits until the robot is in one of these states, and has a job in those of a growth."""
    has_job = states[-1] in ("growing", "paused")

    def look():
        robot = attended(name)
        return robot if robot.state in states and bool(robot.job) == has_job else None

    return wait(f"{name} is {states}", look)


def attended(name):
    """Returns the status of a robot. On a busy machine the service may not run for seconds, which are minutes for the
    robot: it pauses and parks, and continues only if a person orders it. This orders it."""
    robot = call("getRobot", name)
    if robot.state in ("paused", "parked") and robot.pause_cause == "host-silent":
        call("sendCommand", name, body={"command": "continue"})
        return call("getRobot", name)
    return robot


def wait_for_job(job, state):
    """Waits until the job is in this state."""

    def look():
        attended(call("getJob", job).robot)
        return call("getJob", job).state == state

    wait(f"the job is {state}", look)


def recover(name):
    """Does the steps of the robot's guided sequence, as an operator who reads them."""
    for step in call("getRecovery", name).steps:
        if step.action in ("preheat", "load", "purge"):
            call("maintain", name, body={"task": step.action})
        elif step.action:
            call("sendCommand", name, body={"command": step.action})
        if step.action == "preheat":
            wait(f"{name} is hot", lambda: (robot := call("getRobot", name)).temperature_c > robot.target_c - 5)
        elif step.action in ("load", "purge"):
            time.sleep(2)
        while step.action == "continue" and call("getRobot", name).state == "paused":
            # The board refuses to continue as long as the feed moves.
            time.sleep(1)
            call("sendCommand", name, body={"command": "continue"})


for path, operation in operations.values():
    undescribed = [parameter["name"] for parameter in operation["parameters"] if not parameter.get("description")]
    assert not undescribed, f"{path}: no description of {undescribed}"

# The robots, and what happens to them, which a second thread watches.
assert call("getAccess").can_control
assert {robot.name for robot in call("listRobots")} == {"lab", "cold"}
assert call("listCameras") == ["lab"]
picture = read("getCameraPicture", robot="lab")
assert picture.headers["content-type"] == "image/png" and picture.content.startswith(b"\x89PNG")
seen = []
is_over = threading.Event()
watch = lambda: seen.extend(events("streamRobots", lambda _: is_over.is_set()))
watcher = threading.Thread(target=watch, daemon=True)
watcher.start()
wait_for("lab", "idle")
full = call("getFullStatus", "lab")
assert full.sensors.supply_v > 11 and full.latest_fault is None

# The first body: planned, kept, grown, paused, continued.
plan = call("planPath", robot="lab", body=example("planPath"))
assert "<html" in read("viewPlan", number=plan.view_path.split("/")[1]).text
scene = operations["uploadScene"][1]["requestBody"]["content"]["application/octet-stream"]["example"]
file = types.File(payload=io.BytesIO(scene.encode()))
scene = call("uploadScene", name="floor.toml", file=file).scene
floor = call("addLibraryEntry", body=example("addLibraryEntry"))
entry = call("addLibraryEntry", body={"name": "a rod", "plan": plan.plan})
assert [kept.name for kept in call("listLibrary")] == ["a rod", "the floor"]
assert call("getLibraryFile", entry.id) == plan.plan
assert "<svg" in read("getLibraryThumbnail", entry=entry.id).text
assert [kept.id for kept in call("removeLibraryEntry", entry.id)] == [floor.id]
goal = {**example("startJob"), "to": "0,0,120,0,90", "scene": scene, "force": True}
job = call("startJob", "lab", body=goal, idempotency_key="first")
assert call("startJob", "lab", body=goal, idempotency_key="first").id == job.id
wait_for("lab", "growing")
assert "<html" in read("viewGrowth", job=job.id).text
call("sendCommand", "lab", body=example("sendCommand"))
wait_for("lab", "paused")
call("sendCommand", "lab", body={"command": "continue"})

# The filament runs out, and is changed.
wait_for("lab", "growing")
wait("the filament runs out", lambda: attended("lab").pause_cause == "filament-out")
subprocess.run([growbot, "power", "new-spool", "--port", "sim:lab"], check=True, stdout=subprocess.DEVNULL)
recover("lab")
wait_for("lab", "growing")

# It is stopped and resumed, and its log has each line once.
call("stop", "lab")
wait_for("lab", "stopped")
call("resumeJob", job.id)
wait_for_job(job.id, "done")
lines = events("streamJobLog", lambda _: False, job=job.id)
assert {line["event"] for line in lines} == {"log"}
assert [int(line["id"]) for line in lines] == list(range(1, len(lines) + 1))
log = read("getJobLog", job=job.id).text
assert [json.loads(line) for line in log.splitlines()] == [line["data"] for line in lines]
assert "<html" in read("viewJob", job=job.id).text
layers = call("listSnapshots", job.id)
assert layers and read("getSnapshot", job=job.id, layer=layers[-1]).content == picture.content

# A queue of three: one is removed, two grow, each after the last body is removed.
subprocess.run([growbot, "power", "new-spool", "--port", "sim:lab"], check=True, stdout=subprocess.DEVNULL)
queued = [call("queueBody", "lab", body={"to": f"0,0,{length},0,90"}) for length in (20, 25, 30)]
assert [body.id for body in call("removeQueuedBody", "lab", queued[0].id)] == [body.id for body in queued[1:]]
queued = call("moveQueuedBodyToFront", "lab", queued[2].id)
assert [body.name for body in queued] == ["0,0,30,0,90", "0,0,25,0,90"]
queued = call("moveQueuedBodyToFront", "lab", queued[1].id)
for body in queued:
    grown = call("growQueuedBody", "lab", body.id, body=example("growQueuedBody"))
    wait_for_job(grown.id, "done")
assert call("listQueue", "lab") == []

# History: the last one grows again, until the emergency stop.
last = call("listJobs", limit=1)[0]
assert last.name == "0,0,30,0,90"
call("startJob", "lab", body={"to": last.name})
wait_for("lab", "heating", "homing", "growing")
call("emergencyStop", "lab")
wait_for("lab", "emergency-stop")
recover("lab")
call("maintain", "lab", body=example("maintain"))
call("maintain", "lab", body={"task": "cooldown"})
wait_for("lab", "idle")

# The heater is calibrated.
calibration, commissioning = call("listProcedures")
assert calibration.steps[0].action == "tune" and commissioning.steps[-1].action == "cooldown"
call("tuneHeater", "lab", body=example("tuneHeater"))
wait_for("lab", "tuning")
gains = wait("the gains are found", lambda: call("getRobot", "lab").tuning)
assert gains.kp > 0 and gains.simulated
wait_for("lab", "idle")

# The other robot has a fault, and recovers.
call("startJob", "cold", body={"to": "0,0,20,0,90"})
assert wait_for("cold", "fault").fault == "heating-too-slow"
recover("cold")
wait_for("cold", "idle")

is_over.set()
watcher.join(DEADLINE_S)
schema = {**document, "$ref": "#/components/schemas/RobotEvent"}
for event in seen:
    Draft202012Validator(schema).validate(event)
assert {event["event"] for event in seen} == {"robots", "recovery", "heartbeat"}
missing = operations.keys() - by_client - by_script
assert not missing, f"not called: {missing}"
print(
    f"the first hour: {len(by_client)} operations by a generated client, {len(by_script - by_client)} by the script, "
    f"{len(seen)} events of robots"
)
