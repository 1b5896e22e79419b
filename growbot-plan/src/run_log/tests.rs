use std::sync::{Arc, Mutex};

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::LayerReadings;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::simulation::Disturbance;
use serde_json::{Value, json};
use time::format_description::well_known::Rfc3339;

use super::recorded_run::CountBefore;
use super::*;
use crate::clock_drift::ClockDrift;
use crate::feedback::EncoderReference;
use crate::hexadecimal::format_hash;
use crate::hexadecimal::{hex, hex_of};
use crate::plan::PlanOptions;

/// Returns a log of three layers of a robot with feedback, with these lines after its header.
fn log(lines: &[Value]) -> Vec<u8> {
    log_from("tcp:robot:1".into(), lines)
}

/// Like [`log`], but with this origin of the growth.
fn log_from(origin: RunOrigin, lines: &[Value]) -> Vec<u8> {
    let robot = crate::robot_file::load("growbot-a".as_ref()).unwrap();
    let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
    let search = PlanOptions { radius: 100.0, planner: Planner::Shortest, avoid_self_collision: false, existing: None };
    let plan = Plan::through_waypoints(&robot, &up(0.0), &[], &up(2.1), &search).unwrap();
    let job = Job::of_plan(&robot, &plan);
    let file = tempfile::tempdir().unwrap();
    let path = file.path().join("run.jsonl");
    let noise = SensorNoise { odometry: 0.01, direction: 0.002 };
    RunLog::create(&path, &plan, &job, Some(noise), origin).unwrap();
    let mut log = fs::read(&path).unwrap();
    log.extend(lines.iter().flat_map(|line| format!("{line}\n").into_bytes()));
    log
}

/// Returns the result of a growth of which only the outcome is known.
fn done() -> GrowthResult {
    serde_json::from_value(json!({ "outcome": "done" })).unwrap()
}

#[test]
fn amendments_are_read_back_without_those_that_the_board_refused() {
    let other = |byte: u8| [byte; 12];
    let amending = |plan_id: u64, from: u32, layers: &[LayerBytes]| json!({ "event": "amendment", "plan_id": format_hash(plan_id), "from": from, "total": 9, "layers": hex_of(layers) });
    let lines = [
        json!({ "event": "encoder-reference", "boot_id": 5, "laid": 0, "filament_pulses": 3 }),
        amending(7, 1, &[other(1), other(2)]),
        json!({ "event": "laid", "layer": 0, "as_built": hex(&other(9)), "filament_pulses": 60, "gravity_milli_g": [0, -3, 999] }),
        json!({ "event": "laid", "layer": 1, "as_built": null, "filament_pulses": null, "gravity_milli_g": null }),
        amending(8, 2, &[other(3)]),
        json!({ "event": "amendment-rejected" }),
        json!({ "event": "layers-sent", "from": 3, "layers": hex_of(&[other(4)]) }),
        amending(9, 3, &[other(5)]),
    ];
    let mut record = RecordedRun::read(&log(&lines), "log").unwrap();
    assert_eq!((record.plan_id, record.total, record.layers.len()), (9, 9, 4));
    assert_eq!(record.layers[1..], [other(1), other(2), other(5)]);
    assert_eq!(
        record.measured[0],
        Some(LayerReadings { filament_pulses: Some(60), gravity_milli_g: Some([0, -3, 999]) })
    );
    assert_eq!(record.measured[1], Some(LayerReadings::default()));
    let count = EncoderReference { boot_id: 5, laid: 0, filament_pulses: Some(3) };
    assert_eq!(record.counts, [CountBefore { layer: 0, count }]);
    // Two cases: the board has accepted the latest amendment, or has not.
    record.sync_to_board(9);
    assert_eq!(record.plan_id, 9);
    record.sync_to_board(7);
    assert_eq!((record.plan_id, record.layers[3]), (7, other(4)));
}

#[test]
fn feedback_is_none_if_the_header_has_none() {
    let mut bytes = log(&[]);
    assert!(RecordedRun::read(&bytes, "log").unwrap().feedback.is_some());
    let text = String::from_utf8(bytes).unwrap();
    let mut header: Value = serde_json::from_str(&text).unwrap();
    header["feedback"] = Value::Null;
    bytes = format!("{header}\n").into_bytes();
    assert_eq!(RecordedRun::read(&bytes, "log").unwrap().feedback, None);
}

/// A disk that accepts a number of bytes and is then full, until space is freed.
#[derive(Clone, Default)]
struct Disk(Arc<Mutex<(Vec<u8>, usize)>>);

impl Disk {
    fn with_room(bytes: usize) -> Self {
        Self(Arc::new(Mutex::new((Vec::new(), bytes))))
    }

    fn make_room(&self, bytes: usize) {
        self.0.lock().unwrap().1 += bytes;
    }

    fn written(&self) -> Vec<u8> {
        self.0.lock().unwrap().0.clone()
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let (written, room) = &mut *self.0.lock().unwrap();
        let count = bytes.len().min(*room);
        if count == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        written.extend_from_slice(&bytes[..count]);
        *room -= count;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn laid_event(index: u32) -> JobEvent {
    JobEvent::Laid { index, as_built: Some([index as u8 + 1; 12]), measured: None }
}

/// Returns a log of three layers that ends with the header.
fn header_of_three() -> Vec<u8> {
    log(&[])
}

#[test]
fn no_line_is_lost_if_the_disk_is_full_for_a_while() {
    let header = header_of_three();
    let whole = {
        let disk = Disk::with_room(usize::MAX / 2);
        let mut log = RunLog::to(Box::new(disk.clone()), "run", Frame::identity());
        (0..3).for_each(|index| log.record(&laid_event(index)).unwrap());
        disk.written().len()
    };
    for room in 0..whole {
        let disk = Disk::with_room(room);
        let mut log = RunLog::to(Box::new(disk.clone()), "run", Frame::identity());
        let failed = (0..3).filter(|index| log.record(&laid_event(*index)).is_err()).count();
        assert!(failed > 0 && log.missing_lines() > 0, "{room}");
        assert!(log.end(&done()).is_err() && log.write_waiting().is_err(), "{room}");
        disk.make_room(10_000);
        log.write_waiting().unwrap();
        assert_eq!(log.missing_lines(), 0, "{room}");
        let record = RecordedRun::read(&[header.clone(), disk.written()].concat(), "run").unwrap();
        let layers: Vec<Option<LayerBytes>> = (1..=3).map(|byte| Some([byte; 12])).collect();
        assert_eq!((&record.as_built, record.lost.len()), (&layers, 0), "{room}");
        assert_eq!(record.outcome(), OutcomeKind::Done, "{room}");
        assert!(record.damage.lines <= 1 && record.damage.cut_off == 0, "{room}: {:?}", record.damage);
    }
}

#[test]
fn all_lines_of_an_event_are_kept_while_the_disk_is_full() {
    let layer = Layer { alpha: 1.0, height: 0.7, tilt: 0.006 };
    let simulated = JobEvent::Simulated { from: 0, layers: vec![layer; 3] };
    let imperfection = ErrorModel::default();
    let header = log_from(RunOrigin { port: "sim", imperfection: Some(&imperfection), ignores_scene: false }, &[]);
    for room in [0, 10, 300] {
        let disk = Disk::with_room(room);
        let mut log = RunLog::to(Box::new(disk.clone()), "run", Frame::identity());
        log.record(&simulated).unwrap_err();
        disk.make_room(10_000);
        log.end(&done()).unwrap();
        let record = RecordedRun::read(&[header.clone(), disk.written()].concat(), "run").unwrap();
        assert!((0..3).all(|index| record.has_simulated_layer(index)), "{room}");
    }
}

#[test]
fn unknown_values_of_the_result_do_not_affect_other_fields() {
    let mut end = json!({ "event": "end", "utc": null, "result": serde_json::to_value(done()).unwrap() });
    end["result"]["outcome"] = "melted".into();
    end["result"]["feedback"] = json!({ "believed": 1 });
    end["result"]["seed"] = "seven".into();
    let record = RecordedRun::read(&[header_of_three(), format!("{end}\n").into_bytes()].concat(), "run").unwrap();
    let result = record.result.unwrap();
    assert_eq!((result.outcome, result.layers), (OutcomeKind::Unknown, done().layers));
    assert_eq!((result.feedback, result.seed, record.damage), (None, None, Damage::default()));
}

#[test]
fn a_corrupt_layer_line_does_not_affect_later_layers() {
    let line = |index: u32| {
        format!("{}\n", json!({ "event": "laid", "layer": index, "as_built": hex(&[index as u8 + 1; 12]) }))
    };
    let mut bytes = header_of_three();
    bytes.extend(line(0).bytes());
    bytes.extend(&line(1).as_bytes()[..20]);
    bytes.extend(b"\n");
    bytes.extend(line(2).bytes());
    let damaged = RecordedRun::read(&bytes, "run").unwrap();
    assert_eq!(damaged.as_built, [Some([1; 12]), None, Some([3; 12])]);
    assert_eq!((&damaged.lost[..], damaged.known_layers()), (&[1][..], vec![Some([1; 12])]));
    assert_eq!(damaged.damage, Damage { lines: 1, first: 3, cut_off: 0 });
    assert_eq!(damaged.commanded().count(), 3);
    // A repeated report of the board fills the gap.
    bytes.extend(line(1).bytes());
    let mended = RecordedRun::read(&bytes, "run").unwrap();
    assert_eq!(mended.as_built, [Some([1; 12]), Some([2; 12]), Some([3; 12])]);
    assert!(mended.lost.is_empty() && mended.known_layers().len() == 3);
}

#[test]
fn a_log_is_resumed_without_losing_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    let good = format!("{}\n", json!({ "event": "laid", "layer": 0, "as_built": hex(&[1; 12]) }));
    for end in ["", "{\"event\":\"la", "{\"event\":\"la\n{\"event\":\"no-response\"}\n"] {
        let before = [&header_of_three()[..], good.as_bytes(), end.as_bytes()].concat();
        fs::write(&path, &before).unwrap();
        let record = RecordedRun::open(&path).unwrap();
        let mut log = RunLog::resume(&path, &record, "sim").unwrap();
        log.record(&laid_event(1)).unwrap();
        let after = fs::read(&path).unwrap();
        assert!(after.starts_with(&before), "{end:?}");
        let record = RecordedRun::open(&path).unwrap();
        assert_eq!((record.as_built.len(), record.lost.len()), (2, 0), "{end:?}");
        // A log of another growth must not be deleted.
        log.discard();
        assert!(path.exists());
    }
}

#[test]
fn a_log_that_cannot_be_created_leaves_no_file_and_keeps_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    fs::write(&path, b"a body").unwrap();
    let robot = crate::robot_file::load("growbot-a".as_ref()).unwrap();
    let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
    let plan = Plan::new(&robot, &up(0.0), &up(2.1), 100.0, Planner::Shortest).unwrap();
    let job = Job::of_plan(&robot, &plan);
    assert!(RunLog::create(&path, &plan, &job, None, "sim").is_err());
    assert_eq!(fs::read(&path).unwrap(), b"a body");
    assert!(RunLog::create(&folder.path().join("run.pdf"), &plan, &job, None, "sim").is_err());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn header_has_command_time_and_disturbances_and_events_have_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    let robot = crate::robot_file::load("growbot-a".as_ref()).unwrap();
    let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
    let plan = Plan::new(&robot, &up(0.0), &up(2.1), 100.0, Planner::Shortest).unwrap();
    let job = Job::of_plan(&robot, &plan);
    let disturbance = Disturbance { growth_noise: 0.1, tilt_bias: 0.05, ..Disturbance::default() };
    let imperfection = ErrorModel { disturbance, seed: 7, ..ErrorModel::default() };
    let origin = RunOrigin { port: "sim", imperfection: Some(&imperfection), ignores_scene: false };
    let mut log = RunLog::create(&path, &plan, &job, None, origin).unwrap();
    log.record(&laid_event(0)).unwrap();
    log.record(&JobEvent::Simulated { from: 0, layers: vec![Layer { alpha: 1.0, height: 0.7, tilt: 0.004 }] }).unwrap();
    log.end(&done()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let lines: Vec<Value> =
        bytes.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
    let header = &lines[0];
    assert!(!header["command_line"].as_array().unwrap().is_empty() && header["tip"] == "simulated");
    assert_eq!(header["disturbances"]["seed"], 7);
    let noise = &header["disturbances"]["growth_noise"];
    assert_eq!((&noise["distribution"], &noise["max"]), (&json!("uniform"), &json!(10.0)));
    assert_eq!(header["disturbances"]["tilt_bias"]["value"], json!(5.0));
    for time in lines.iter().map(|line| &line["utc"]).chain([&header["started_utc"]]) {
        let time = time.as_str().unwrap();
        assert_eq!(time.len(), "2026-11-22T14:49:08.123Z".len(), "{time}");
        OffsetDateTime::parse(time, &Rfc3339).unwrap();
        assert!(time.ends_with('Z'), "{time}");
    }
    let record = RecordedRun::open(&path).unwrap();
    let laid = record.simulated().unwrap();
    assert_eq!(laid.len(), 1);
    assert!((laid[0].alpha - 1.0).abs() < 1e-15 && (laid[0].tilt - 0.004).abs() < 1e-15, "{laid:?}");
    assert_eq!(lines[2]["tip"]["z_mm"].as_f64().map(|z| (z - 0.7).abs() < 1e-4), Some(true));
}

#[test]
fn the_kind_of_tip_comes_from_the_header_alone() {
    let imperfection = ErrorModel::default();
    let simulated = RunOrigin { port: "sim", imperfection: Some(&imperfection), ignores_scene: false };
    let laid = |layer: u32| json!({ "event": "laid", "layer": layer, "as_built": hex(&[1; 12]) });
    let lies = |layer: u32| json!({ "event": "simulated", "layer": layer, "alpha_deg": 0.0, "height_mm": 0.7, "tilt_deg": 0.0 });
    let read = |origin, lines: &[Value]| RecordedRun::read(&log_from(origin, lines), "run").unwrap();
    let known = |record: &RecordedRun| (record.tip, record.body_kind(), record.simulated().map(|layers| layers.len()));
    // Three cases: the growth stopped before its first layer; its lines on plastic are missing; its lines are present.
    for (lines, kind, layers) in [
        (&[][..], BodyKind::Laid, Some(0)),
        (&[laid(0)], BodyKind::Commanded, None),
        (&[laid(0), lies(0)], BodyKind::Laid, Some(1)),
    ] {
        assert_eq!(known(&read(simulated, lines)), (TipKind::Simulated, kind, layers));
        assert_eq!(known(&read("tcp:robot:1".into(), lines)), (TipKind::Robot, BodyKind::AsBuilt, None));
    }
    let text = String::from_utf8(log(&[])).unwrap();
    for (changed, part) in [("\"tip\":\"both\"", "\"both\""), ("\"tap\":\"robot\"", "has no \"tip\"")] {
        let error = RecordedRun::read(text.replace("\"tip\":\"robot\"", changed).as_bytes(), "run").unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    }
}

#[test]
fn missing_simulated_layers_are_counted_without_the_open_layer() {
    let imperfection = ErrorModel::default();
    let laid = |layer: u32| json!({ "event": "laid", "layer": layer, "as_built": hex(&[1; 12]) });
    let lies = |layer: u32| json!({ "event": "simulated", "layer": layer, "alpha_deg": 0.0, "height_mm": 0.7, "tilt_deg": 0.0 });
    for (places, missing) in [(&[0, 1, 2][..], 0), (&[0, 2], 1), (&[1], 1), (&[2], 2), (&[0, 1], 0), (&[], 2)] {
        let lines: Vec<Value> = [laid(0), laid(1)].into_iter().chain(places.iter().map(|layer| lies(*layer))).collect();
        let origin = RunOrigin { port: "sim", imperfection: Some(&imperfection), ignores_scene: false };
        let record = RecordedRun::read(&log_from(origin, &lines), "run").unwrap();
        assert_eq!(record.missing_simulated_layers(), missing, "{places:?}");
        assert_eq!(
            RecordedRun::read(&log(&lines), "run").unwrap().missing_simulated_layers(),
            0,
            "of a robot: {places:?}"
        );
    }
}

#[test]
fn clock_drift_is_read_back_from_the_end_event() {
    let drift = ClockDrift { board_ms: 28_500, host_ms: [30_000, 30_100] };
    let end = json!({ "event": "end", "result": { "outcome": "clock-drift", "clock_drift": drift } });
    let record = RecordedRun::read(&log(std::slice::from_ref(&end)), "run").unwrap();
    assert_eq!((record.outcome(), record.clock_drift()), (OutcomeKind::ClockDrift, Some(drift)));
    let resumed = RecordedRun::read(&log(&[end, json!({ "event": "resumed" })]), "run").unwrap();
    assert_eq!((resumed.outcome(), resumed.clock_drift()), (OutcomeKind::Unfinished, None));
}

#[test]
fn extreme_numbers_are_ignored() {
    let lie = |layer: u64, height: f64| json!({ "event": "simulated", "layer": layer, "alpha_deg": 0.0, "height_mm": height, "tilt_deg": 0.0 });
    let laid = |layer: u64| json!({ "event": "laid", "layer": layer, "as_built": hex(&[1; 12]) });
    let most = u64::from(u32::MAX);
    let lines =
        [laid(u64::MAX), laid(most), laid(1 << 40), lie(u64::MAX, 1.0), lie(most, 1.0), lie(0, -1.0), lie(0, 1e300)];
    let record = RecordedRun::read(&log(&lines), "run").unwrap();
    assert!(record.as_built.is_empty() && record.simulated().is_none());
    let amending = |from: u64| json!({ "event": "amendment", "plan_id": "0000000000000007", "from": from, "total": 4_000_000_000_u32, "layers": "" });
    let record = RecordedRun::read(&log(&[amending(most), amending(0), amending(0), laid(0), laid(1)]), "run").unwrap();
    assert_eq!((record.layers.len(), record.commanded().count()), (0, 2));
}

#[test]
fn a_firmware_crash_is_logged_with_its_registers_only() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run.jsonl");
    fs::write(&path, log(&[])).unwrap();
    let before = RecordedRun::open(&path).unwrap();
    let mut log = RunLog::resume(&path, &before, "sim").unwrap();
    let mut words = [0x1001; growbot_core::link::crash::CRASH_WORDS];
    words[..9].copy_from_slice(&[3 << 16 | 3, 7, 0xfeed_beef, 0x1000_0800, 0xFFFF_FFF9, 1 << 16, 1 << 30, 1, 2]);
    log.record(&JobEvent::Crash(words)).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let line: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    assert_eq!(
        (&line["event"], &line["cause"], &line["boot_id"]),
        (&"crash".into(), &"processor fault".into(), &7.into())
    );
    assert_eq!((&line["pc"], &line["cfsr"]), (&"00001001".into(), &"00010000".into()));
    assert_eq!((&line["reasons"][0], &line["image_crc"]), (&"UNDEFINSTR".into(), &"feedbeef".into()));
    let after = RecordedRun::open(&path).unwrap();
    assert_eq!((after.as_built, after.layers, after.result), (before.as_built, before.layers, before.result));
}

#[test]
fn every_event_round_trips() {
    let header = RecordedRun::read(&log(&[]), "run").unwrap();
    let mut tip = header.start_frame();
    let words = [0x1001; growbot_core::link::crash::CRASH_WORDS];
    let measured = LayerReadings { filament_pulses: Some(7), gravity_milli_g: None };
    let amendment = crate::job::Amendment { plan_id: 7, from: 1, total: 9, layers: vec![[5; 12]; 2] };
    let happened = [
        JobEvent::Crash(words),
        JobEvent::State(growbot_core::link::message::State::Growing),
        laid_event(0),
        JobEvent::Laid { index: 1, as_built: None, measured: Some(measured) },
        JobEvent::Simulated { from: 0, layers: vec![Layer { alpha: 1.0, height: 0.7, tilt: 0.004 }; 2] },
        JobEvent::EncoderReference(EncoderReference { boot_id: 1, laid: 2, filament_pulses: None }),
        JobEvent::Amendment(amendment),
        JobEvent::AmendmentRejected(None),
        JobEvent::AmendmentRejected(Some("no room".to_owned())),
        JobEvent::LayersSent { from: 3, layers: vec![[6; 12]] },
        JobEvent::Command(crate::job::Command::EmergencyStop),
        JobEvent::CommandFailed("not now".to_owned()),
        JobEvent::NoResponse,
        JobEvent::Reconnected,
    ];
    let written: Vec<RunEvent> = happened.iter().flat_map(|event| to_run_events(event, &mut tip)).collect();
    let end = RunEvent::End { result: Box::new(done()) };
    let written: Vec<RunEvent> = written.into_iter().chain([end]).collect();
    let line = |event: &RunEvent| json_line(&RunLine { event: event.clone(), utc: Some(utc_now()) });
    let log: String = written.iter().map(line).collect();
    assert_eq!(Events::of(log.as_bytes()).collect::<Vec<_>>(), written);
}
