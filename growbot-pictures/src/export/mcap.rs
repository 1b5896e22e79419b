//! The events of a run log over time, as MCAP (<https://mcap.dev/spec>), which Foxglove plays.
//!
//! Times are those of [`growbot_plan::run_clock`].

use std::collections::{BTreeMap, HashMap};
use std::io::Cursor;

use growbot_core::angle::degrees;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::decode;
use growbot_core::link::message::Fault;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_plan::clearance_guard::Detour;
use growbot_plan::degrees::degrees_below_turn;
use growbot_plan::plan::Plan;
use growbot_plan::run_clock::{RunClock, events, time_for};
use growbot_plan::run_log::{BoardRecord, BoardStatus, GrowthResult, MeasuredJson, OutcomeKind, RecordedRun, RunEvent};
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use serde_json::json;

use super::body::{BodyLayer, ExportedBody};
use super::foxglove::{self, LogLevel, Topic};
use super::message::EncodedMessage;
use super::ros2;

/// Colour (RGB, 0 to 1) of the smallest height of a layer. `HIGH` is the colour of the largest height, and `PLANNED`
/// that of the planned centreline.
const LOW: [f64; 3] = [0.2, 0.4, 0.9];
const HIGH: [f64; 3] = [0.95, 0.45, 0.1];
const PLANNED: [f64; 3] = [0.3, 0.7, 0.3];

/// Encoding of the messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// JSON, in message types of Foxglove and of growbot.
    Json,
    /// CDR, in message types of ROS 2.
    Ros2,
}

/// Returns the recording of a run log as an MCAP file. `log` is the content of the log, and `record` is the parsed log.
///
/// # Errors
/// Errors of the MCAP writer. They do not occur when it writes to memory.
pub fn write(
    robot: &Robot,
    plan: &Plan,
    record: &RecordedRun,
    log: &[u8],
    encoding: Encoding,
) -> Result<Vec<u8>, McapError> {
    let commanded = ExportedBody::as_built(robot, &plan.start, record);
    let simulated = ExportedBody::simulated(robot, &plan.start, record);
    let body = simulated.as_ref().unwrap_or(&commanded);
    let hardware = format!("{}{}", robot.name(), if record.is_simulated() { " (simulated)" } else { "" });
    let mut recorder = Recorder::new(robot, encoding, hardware)?;
    recorder.frame(Topic::Start, &plan.start)?;
    recorder.frame(Topic::Goal, &plan.goal)?;
    let planned = ExportedBody::planned(robot, plan);
    let frames =
        planned.layers_with_base().map(|(frame, _)| frame).chain(planned.layers.last().map(|last| last.base_from_tip));
    recorder.write_message(
        Topic::Plan,
        &EncodedMessage::Line { id: "planned", frames: frames.collect(), color: PLANNED },
    )?;
    recorder.frame(Topic::Tip, &plan.start)?;
    if record.is_simulated() {
        recorder.event(LogLevel::Info, "the robot is simulated")?;
    }

    let mut growing = body.layers_with_base().zip(&record.layers).enumerate().peekable();
    for event in events(log) {
        match &event {
            RunEvent::Status(status) => recorder.status(status)?,
            // A layer may be reported again after a resumption, and the first report counts. A layer whose line is lost
            // came before the next layer.
            RunEvent::Laid(laid) if (laid.layer as usize) < body.layers.len() => {
                let laid_index = laid.layer as usize;
                while let Some((index, ((before, grown), planned))) = growing.next_if(|(index, _)| laid_index >= *index)
                {
                    recorder.clock.add_layer(time_for(&grown.layer, plan));
                    let beside = commanded.layers.get(index).filter(|_| simulated.is_some());
                    let measured = laid.measured.filter(|_| laid_index == index);
                    recorder.layer(index, grown, &decode(planned), beside, measured)?;
                    let middle = before * half(&grown.layer).step();
                    recorder.disc(index, &middle, &grown.layer, body)?;
                    recorder.tip(Topic::Tip, grown)?;
                    if let Some(beside) = beside {
                        recorder.tip(Topic::Commanded, beside)?;
                    }
                }
            }
            RunEvent::End { result } => recorder.end(result)?,
            event => {
                if let Some((level, words)) = describe(event) {
                    recorder.event(level, &words)?;
                }
            }
        }
    }
    recorder.finish()
}

/// Returns an event as text, without the bytes of layers. `None` if another channel contains the event.
fn describe(event: &RunEvent) -> Option<(LogLevel, String)> {
    let words = match event {
        RunEvent::Board(board) => {
            let [major, minor, patch] = board.firmware;
            let BoardRecord { boot_id, reset_cause, state, laid, .. } = board;
            format!(
                "board: firmware {major}.{minor}.{patch}, boot {boot_id:08x}, started by {reset_cause}, {state}, {laid} layers laid"
            )
        }
        RunEvent::Crash(crash) => {
            let at = crash.pc.as_deref().map(|pc| format!(", at {pc}")).unwrap_or_default();
            format!("crash: {}{at}", crash.cause)
        }
        RunEvent::State { state } => format!("state: {state}"),
        RunEvent::EncoderReference(count) => match count.filament_pulses {
            Some(pulses) => format!("encoder-reference: {} layers laid, {pulses} pulses of filament", count.laid),
            None => format!("encoder-reference: {} layers laid", count.laid),
        },
        RunEvent::Amendment(amendment) => {
            format!(
                "amendment: plan {:016x}, {} layers, new from {}",
                amendment.plan_id, amendment.total, amendment.from
            )
        }
        RunEvent::AmendmentRejected { reason: Some(reason) } => format!("amendment-rejected: {reason}"),
        RunEvent::AmendmentRejected { reason: None } => "amendment-rejected".to_owned(),
        RunEvent::Detour(Detour { from, instead_of, .. }) => format!("detour: from layer {from}, because {instead_of}"),
        RunEvent::ClearanceViolation(too_near) => format!("clearance-violation: {too_near}"),
        RunEvent::LayersSent { from, .. } => format!("layers-sent: from layer {from}"),
        RunEvent::Command { command } => format!("command: {}", command.name()),
        RunEvent::CommandFailed { reason } => format!("command-failed: {reason}"),
        RunEvent::NoResponse => "no-response".to_owned(),
        RunEvent::Reconnected => "reconnected".to_owned(),
        RunEvent::Resumed(resumed) => format!("resumed: growbot {}, port {}", resumed.growbot, resumed.port),
        // Their content is in the layers and in the status.
        RunEvent::Header(_)
        | RunEvent::Status(_)
        | RunEvent::Laid(_)
        | RunEvent::Simulated(_)
        | RunEvent::End { .. } => return None,
    };
    let level = match event {
        RunEvent::NoResponse
        | RunEvent::AmendmentRejected { .. }
        | RunEvent::Detour(_)
        | RunEvent::ClearanceViolation(_) => LogLevel::Warning,
        _ => LogLevel::Info,
    };
    Some((level, words))
}

fn half(layer: &Layer) -> Layer {
    Layer { height: 0.5 * layer.height, tilt: 0.5 * layer.tilt, ..*layer }
}

/// Smallest and largest permitted height of a layer, mm.
#[derive(Debug, Clone, Copy)]
struct Heights {
    min: f64,
    max: f64,
}

/// An unfinished recording.
struct Recorder {
    writer: Writer<Cursor<Vec<u8>>>,
    encoding: Encoding,
    /// Numbers of the channels by their names.
    channels: HashMap<&'static str, u16>,
    clock: RunClock,
    /// Number of messages so far.
    message_count: u32,
    /// The latched fault of the latest status.
    fault: Option<String>,
    /// Smallest and largest permitted height of a layer, mm.
    heights: Heights,
    /// Name of the robot.
    hardware: String,
    /// Poses of the tip so far, each with its time, ms.
    way: Vec<(u64, Frame)>,
}

/// Topic of the tip's path in ROS 2. `TRANSFORMS` is the topic of the transform from the base to the tip.
const WAY: &str = "/growbot/body";
const TRANSFORMS: &str = "/tf";

/// Returns the channel and type of a topic in ROS 2. `None` if ROS 2 has no message type for the topic.
fn ros2_channel(topic: Topic) -> Option<(&'static str, &'static str)> {
    match topic {
        Topic::Start => Some(("/growbot/start", ros2::POSE)),
        Topic::Goal => Some(("/growbot/goal", ros2::POSE)),
        Topic::Tip => Some(("/growbot/tip", ros2::POSE)),
        Topic::Commanded => Some(("/growbot/commanded", ros2::POSE)),
        Topic::Plan => Some(("/growbot/plan", ros2::PATH)),
        Topic::Body => Some(("/growbot/layers", ros2::MARKER)),
        Topic::Status | Topic::Events => Some(("/diagnostics", ros2::DIAGNOSTICS)),
        Topic::Layers | Topic::Faults => None,
    }
}

impl Recorder {
    fn new(robot: &Robot, encoding: Encoding, hardware: String) -> Result<Self, McapError> {
        let options = WriteOptions::new().library(concat!("growbot ", env!("CARGO_PKG_VERSION")));
        let profile = if encoding == Encoding::Ros2 { "ros2" } else { "" };
        let mut writer = options.profile(profile).create(Cursor::new(Vec::new()))?;
        let mut channels = HashMap::new();
        match encoding {
            Encoding::Json => {
                for topic in Topic::ALL {
                    let (name, schema) = topic.schema();
                    let schema = writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
                    let channel = writer.add_channel(schema, topic.name(), "json", &BTreeMap::new())?;
                    channels.insert(topic.name(), channel);
                }
            }
            Encoding::Ros2 => {
                let others = [(WAY, ros2::PATH), (TRANSFORMS, ros2::TRANSFORMS)];
                for (name, kind) in Topic::ALL.into_iter().filter_map(ros2_channel).chain(others) {
                    let schema = writer.add_schema(kind, "ros2msg", ros2::definition(kind).as_bytes())?;
                    let channel = writer.add_channel(schema, name, "cdr", &BTreeMap::new())?;
                    channels.insert(name, channel);
                }
            }
        }
        let limits = &robot.description().layer;
        let heights = Heights { min: limits.height_min_mm, max: limits.height_max_mm };
        let (clock, way) = (RunClock::default(), Vec::new());
        Ok(Self { writer, encoding, channels, clock, message_count: 0, fault: None, heights, hardware, way })
    }

    fn write_message(&mut self, topic: Topic, message: &EncodedMessage) -> Result<(), McapError> {
        let now = self.clock.now();
        match (self.encoding, ros2_channel(topic)) {
            (Encoding::Json, _) => self.put(topic.name(), message.json(now).to_string().as_bytes()),
            (Encoding::Ros2, Some((name, _))) => match ros2::encode(now, message, &self.hardware) {
                Some(bytes) => self.put(name, &bytes),
                None => Ok(()),
            },
            (Encoding::Ros2, None) => Ok(()),
        }
    }

    fn put(&mut self, channel: &str, bytes: &[u8]) -> Result<(), McapError> {
        let time = self.clock.now().saturating_mul(1_000_000);
        let channel_id = self.channels.get(channel).copied().unwrap_or_default();
        let header = MessageHeader { channel_id, sequence: self.message_count, log_time: time, publish_time: time };
        self.message_count = self.message_count.wrapping_add(1);
        self.writer.write_to_known_channel(&header, bytes)
    }

    fn frame(&mut self, topic: Topic, pose: &Pose) -> Result<(), McapError> {
        self.at(topic, pose.frame())
    }

    fn tip(&mut self, topic: Topic, laid: &BodyLayer) -> Result<(), McapError> {
        self.at(topic, laid.base_from_tip)
    }

    /// Records a pose. In ROS 2, the tip's pose is also recorded as a transform and as a point of the tip's path.
    fn at(&mut self, topic: Topic, frame: Frame) -> Result<(), McapError> {
        self.write_message(topic, &EncodedMessage::Pose(frame))?;
        if topic == Topic::Tip && self.encoding == Encoding::Ros2 {
            let now = self.clock.now();
            self.way.push((now, frame));
            self.put(TRANSFORMS, &ros2::transform(now, &frame))?;
        }
        Ok(())
    }

    fn event(&mut self, level: LogLevel, words: &str) -> Result<(), McapError> {
        self.write_message(Topic::Events, &EncodedMessage::Event(level, words))
    }

    fn status(&mut self, status: &BoardStatus) -> Result<(), McapError> {
        self.clock.status(status);
        self.write_message(Topic::Status, &EncodedMessage::Status(status))?;
        self.latched(status.fault.as_deref())
    }

    /// Records the end of the growth.
    fn end(&mut self, result: &GrowthResult) -> Result<(), McapError> {
        let level = match result.outcome {
            OutcomeKind::Done => LogLevel::Info,
            OutcomeKind::Fault => LogLevel::Error,
            _ => LogLevel::Warning,
        };
        if let Some(code) = &result.fault {
            self.latched(Some(code))?;
        } else if result.outcome == OutcomeKind::Fault && self.fault.is_none() {
            self.fault("unknown", "the run log does not name the fault that ended the growth")?;
        }
        self.event(level, &format!("end: {}", result.outcome))
    }

    /// Records the latched fault, unless it is recorded already. `fault` is `None` if no fault is latched.
    fn latched(&mut self, fault: Option<&str>) -> Result<(), McapError> {
        if fault != self.fault.as_deref() {
            self.fault = fault.map(ToString::to_string);
            if let Some(code) = fault {
                let known = code.parse::<Fault>();
                self.fault(
                    code,
                    known.map_or("a fault that this version of growbot does not know", Fault::explanation),
                )?;
            }
        }
        Ok(())
    }

    fn fault(&mut self, code: &str, explanation: &str) -> Result<(), McapError> {
        self.write_message(Topic::Faults, &EncodedMessage::Fault { code, explanation })?;
        self.event(LogLevel::Error, &format!("fault {code}: {explanation}"))
    }

    /// Records a layer. `beside` is the layer as commanded, or `None` if the layer is not known to lie otherwise.
    fn layer(
        &mut self,
        index: usize,
        laid: &BodyLayer,
        planned: &Layer,
        beside: Option<&BodyLayer>,
        measured: Option<MeasuredJson>,
    ) -> Result<(), McapError> {
        let layer = &laid.layer;
        let mut message = json!({
            "layer": index,
            "alpha_deg": degrees_below_turn(layer.alpha),
            "height_mm": layer.height,
            "tilt_deg": degrees(layer.tilt),
            "source": laid.source.name(),
            "planned_alpha_deg": degrees_below_turn(planned.alpha),
            "planned_height_mm": planned.height,
            "planned_tilt_deg": degrees(planned.tilt),
        });
        if let Some(BodyLayer { layer, .. }) = beside {
            message["commanded_alpha_deg"] = degrees_below_turn(layer.alpha).into();
            message["commanded_height_mm"] = layer.height.into();
            message["commanded_tilt_deg"] = degrees(layer.tilt).into();
        }
        if let Some(MeasuredJson { filament_pulses, gravity_milli_g }) = measured {
            foxglove::add_known(&mut message, "filament_pulses", filament_pulses);
            foxglove::add_known(&mut message, "gravity_milli_g", gravity_milli_g);
        }
        self.write_message(Topic::Layers, &EncodedMessage::Layer(message))
    }

    fn disc(
        &mut self,
        index: usize,
        base_from_middle: &Frame,
        layer: &Layer,
        body: &ExportedBody,
    ) -> Result<(), McapError> {
        let Heights { min, max } = self.heights;
        let share = ((layer.height - min) / (max - min).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let [low, high] = [LOW, HIGH].map(nalgebra::Vector3::from);
        let color = low.lerp(&high, share).into();
        let diameter = 2.0 * body.wall_radius + body.wall_thickness;
        let (height, base_from_middle) = (layer.height, *base_from_middle);
        self.write_message(Topic::Body, &EncodedMessage::Disc { index, base_from_middle, diameter, height, color })
    }

    fn finish(mut self) -> Result<Vec<u8>, McapError> {
        if self.encoding == Encoding::Ros2 {
            let way = ros2::path(self.clock.now(), self.way.iter().copied());
            self.put(WAY, &way)?;
        }
        self.writer.finish()?;
        Ok(self.writer.into_inner().into_inner())
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_core::simulation::ErrorModel;
    use growbot_plan::job::Job;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;
    use growbot_plan::run_log::{RunLog, RunOrigin};
    use mcap::MessageStream;
    use serde_json::Value;

    use super::*;

    /// Returns the messages of the recording of a log with these lines after its header: topic, time in ms, message.
    fn recorded(lines: &[Value]) -> Vec<(String, u64, Value)> {
        recorded_from("tcp:robot:1".into(), lines)
    }

    /// Like [`recorded`], for a growth with this origin.
    fn recorded_from(origin: RunOrigin, lines: &[Value]) -> Vec<(String, u64, Value)> {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,0,3,0,90").unwrap());
        let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap();
        let job = Job::of_plan(&robot, &plan);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run.jsonl");
        RunLog::create(&path, &plan, &job, None, origin).unwrap();
        let mut log = std::fs::read(&path).unwrap();
        log.extend(lines.iter().flat_map(|line| format!("{line}\n").into_bytes()));
        log.extend(b"{\"event\":\"sta");
        let record = RecordedRun::read(&log, "run.jsonl").unwrap();
        let bytes = write(&robot, &plan, &record, &log, Encoding::Json).unwrap();
        let message = |message: mcap::Message| {
            let content = serde_json::from_slice(&message.data).unwrap();
            (message.channel.topic.clone(), message.log_time / 1_000_000, content)
        };
        MessageStream::new(&bytes).unwrap().map(|read| message(read.unwrap())).collect()
    }

    fn status(uptime_ms: u32, fault: Option<&str>) -> Value {
        json!({ "event": "status", "state": "growing", "fault": fault, "temperature_c": 199.5, "target_c": null, "laid": 0, "uptime_ms": uptime_ms })
    }

    fn laid(index: usize) -> Value {
        json!({ "event": "laid", "layer": index, "as_built": null })
    }

    #[test]
    fn layer_times_are_plausible_and_monotonic() {
        // The board restarts after the second layer.
        let lines =
            [status(1000, None), laid(0), laid(1), laid(1), status(30, None), status(2030, None), laid(2), laid(3)];
        let messages = recorded(&lines);
        let times = |topic: &str| -> Vec<u64> {
            messages.iter().filter(|(name, ..)| name == topic).map(|(_, ms, _)| *ms).collect()
        };
        // The body of 3 mm has four layers of 0.75 mm. A layer of full height takes 18 s.
        let layer = 18_000;
        assert_eq!(times("/layers"), [0, layer, 2 * layer, 3 * layer]);
        assert_eq!(times("/body"), times("/layers"));
        assert_eq!(times("/status"), [0, layer, layer + 2000]);
        assert!(messages.windows(2).all(|pair| pair[0].1 <= pair[1].1));
        let (_, _, tip) = messages.iter().rfind(|(topic, ..)| topic == "/tip").unwrap();
        assert!((tip["pose"]["position"]["z"].as_f64().unwrap() - 0.003).abs() < 1e-9, "{tip}");
    }

    #[test]
    fn a_fault_is_recorded_once_and_unknown_values_are_omitted() {
        let fault = Some("over-temperature");
        let end = json!({ "event": "end", "result": { "outcome": "fault" } });
        let messages = recorded(&[status(0, None), status(1, fault), status(2, fault), end]);
        let of = |topic: &str| {
            messages.iter().filter(|(name, ..)| name == topic).map(|(.., message)| message).collect::<Vec<_>>()
        };
        assert_eq!(of("/faults").len(), 1);
        assert_eq!(of("/faults")[0]["code"], "over-temperature");
        assert_eq!(of("/events").last().unwrap()["message"], "end: fault");
        assert_eq!((&of("/status")[0]["temperature_c"], of("/status")[0].get("target_c")), (&json!(199.5), None));
        // Only the end of the log reports the fault, and logs of older versions have no code there.
        let with = |result: Value| recorded(&[status(0, None), json!({ "event": "end", "result": result })]);
        for (code, result) in [
            ("unknown", json!({ "outcome": "fault" })),
            ("heating-too-slow", json!({ "outcome": "fault", "fault": "heating-too-slow" })),
        ] {
            let messages = with(result);
            assert!(messages.iter().any(|(topic, _, fault)| topic == "/faults" && fault["code"] == code), "{code}");
        }
    }

    #[test]
    fn a_recording_marks_a_simulated_robot_even_without_layers() {
        let says = |origin| {
            recorded_from(origin, &[]).iter().any(|(topic, _, message)| {
                topic == "/events" && message["message"].as_str().is_some_and(|words| words.contains("simulated"))
            })
        };
        let imperfection = ErrorModel::default();
        assert!(says(RunOrigin { port: "sim", imperfection: Some(&imperfection), ignores_scene: false }));
        assert!(!says("tcp:robot:1".into()));
    }

    #[test]
    fn invalid_log_lines_are_ignored() {
        let odd = [
            json!(7),
            json!({}),
            json!({ "event": 3 }),
            json!({ "event": "laid", "layer": -1 }),
            json!({ "event": "status", "uptime_ms": 1e300 }),
            json!({ "event": "status", "uptime_ms": u32::MAX }),
            status(0, Some("no-such-fault")),
            json!({ "event": "end" }),
            laid(usize::MAX),
        ];
        let messages = recorded(&odd);
        assert!(messages.iter().any(|(topic, _, fault)| topic == "/faults" && fault["code"] == "no-such-fault"));
    }
}
