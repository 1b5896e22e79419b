//! Checks that PROTOCOL.md agrees with the code: its examples byte for byte, its table of messages, its types and its
//! numbers.
//!
//! PROTOCOL.md must contain these parts, which the tests read:
//!
//! - fenced blocks ` ```frame NAME `: lines `header`, `body`, `crc` and `wire`, each with bytes in hex, which continue
//!   in lines that begin with a space. `#` begins a comment. Header, body and crc are the frame before COBS, and wire
//!   is the frame as sent;
//! - fenced blocks ` ```bytes NAME `: a line `wire` of bytes that are not a frame, written as above;
//! - fenced blocks ` ```type NAME `: a struct's fields or an enum's variants, one on each line, with comments as above;
//! - rows ``| `0x01` | `Name` | direction | `Body` | ...`` for the messages, and ``| name | `value` | ...`` for the
//!   constants.
//!
//! If an example is wrong, the failure prints the correct text.

use std::collections::BTreeMap;
use std::fmt::Write;

use growbot_core::hash::Hasher;
use growbot_core::job::{job_layers, summarize};
use growbot_core::layer::{Layer, SECTORS};
use growbot_core::layer_bytes::{self, LayerBytes, LayerEncoder};
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::frame::{
    self, FRAME_VERSION, FrameDecoder, FrameHeader, LinkFrame, MAX_BODY_LEN, MAX_FRAME_LEN,
};
use growbot_core::link::message::{
    Accepted, Amend, AppendLayers, BeginJob, BoardInfo, BootReport, Cancel, Configure, Configured, Empty, Hello,
    HostName, HostSilencePolicy, InterruptedLayer, LatestFault, LayerLaid, LayerReadings, MAX_LAYERS_PER_MESSAGE,
    Maintain, Message, PauseCause, PlanRequest, Planned, ReadLayers, Refusal, RefusalResponse, ResetCause, Resume,
    SCHEMA_HASH, SensorReadings, Start, State, StateChanged, Status, StoredLayers, Tune, Tuned,
};
use growbot_core::path::Segment;
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use postcard_schema::Schema;
use postcard_schema::schema::{DataModelType, DataModelVariant, NamedType};

const PROTOCOL: &str = include_str!("../../PROTOCOL.md");

/// Computes CRC-32C independently, bit by bit, to check the CRC in the frames.
fn crc_32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0x82F6_3B78 } else { 0 })
    })
}

/// Returns name and lines of the fenced blocks whose info string is `KIND NAME`, without comments.
fn blocks(kind: &str) -> Vec<(String, Vec<String>)> {
    let mut found: Vec<(String, Vec<String>)> = Vec::new();
    let mut inside = None;
    for line in PROTOCOL.lines() {
        match (inside, line.strip_prefix("```")) {
            (None, Some(info)) => {
                let name = info.strip_prefix(kind).and_then(|rest| rest.strip_prefix(' '));
                inside = Some(name.is_some());
                found.extend(name.map(|name| (name.trim().to_owned(), Vec::new())));
            }
            (Some(_), Some(_)) => inside = None,
            (Some(true), None) => {
                let text = line.split('#').next().unwrap_or_default().trim_end();
                let (_, lines) = found.last_mut().unwrap();
                lines.extend((!text.is_empty()).then(|| text.to_owned()));
            }
            _ => {}
        }
    }
    assert_eq!(inside, None, "a fence is not closed");
    found
}

/// The four parts of an example frame in PROTOCOL.md.
#[derive(Debug, PartialEq, Default)]
struct Example {
    header: Vec<u8>,
    body: Vec<u8>,
    crc: Vec<u8>,
    wire: Vec<u8>,
}

impl Example {
    fn parse(name: &str, lines: &[String]) -> Self {
        let mut example = Self::default();
        let mut part = String::new();
        for line in lines {
            let mut words = line.split_whitespace();
            if !line.starts_with(' ') {
                part = words.next().unwrap().to_owned();
            }
            let bytes = match part.as_str() {
                "header" => &mut example.header,
                "body" => &mut example.body,
                "crc" => &mut example.crc,
                "wire" => &mut example.wire,
                other => panic!("example {name} has a line {other:?}"),
            };
            for word in words {
                assert_eq!(word.len(), 2, "example {name}: {word:?} is no byte");
                bytes.push(u8::from_str_radix(word, 16).unwrap());
            }
        }
        example
    }

    /// Returns the parts of the frame into which the code encodes a message.
    fn of(header: &FrameHeader, message: &Message) -> Self {
        assert_eq!(header.kind, message.kind());
        let mut buffer = [0; MAX_BODY_LEN];
        let body = message.encode(&mut buffer).unwrap();
        let wire = frame::encode(header, body).unwrap().to_vec();
        let mut raw = wire[..wire.len() - 1].to_vec();
        let length = cobs::decode_in_place(&mut raw).unwrap();
        let (content, crc) = raw[..length].split_at(length - 4);
        assert_eq!(crc, crc_32c(content).to_le_bytes());
        Self { header: content[..10].to_vec(), body: content[10..].to_vec(), crc: crc.to_vec(), wire }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        for (name, bytes) in [("header", &self.header), ("body", &self.body), ("crc", &self.crc), ("wire", &self.wire)]
        {
            text += name;
            for byte in bytes {
                write!(text, " {byte:02x}").unwrap();
            }
            text += "\n";
        }
        text
    }
}

fn robot() -> Robot {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml");
    Robot::new(toml::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()).unwrap()
}

/// Returns the path of the examples' job: two layers of an arc, whose tilt is not a whole number of units.
fn job() -> [Segment; 1] {
    [Segment::Arc { alpha: std::f64::consts::FRAC_PI_2, bend: 0.015, length: 1.5 }]
}

/// Number of the session in the examples.
const SESSION: u32 = 0x1a2b_3c4d;
/// Number of the session of another host, which finds that the board is owned.
const OTHER_SESSION: u32 = 0x5e6f_7a8b;
/// Number of the session in frames that belong to no session.
const NO_SESSION: u32 = 0;

/// An example of PROTOCOL.md: its name, and the contents of the frame.
struct ExampleFrame {
    name: &'static str,
    session: u32,
    seq: u16,
    ack: u16,
    message: Message,
}

/// Returns an example of a request, with its sequence number and the number of the latest event that the host has
/// received.
fn request(name: &'static str, seq: u16, heard: u16, message: Message) -> ExampleFrame {
    ExampleFrame { name, session: SESSION, seq, ack: heard, message }
}

/// Returns an example of a response, with the sequence number of its request.
fn answer(name: &'static str, request: u16, message: Message) -> ExampleFrame {
    ExampleFrame { name, session: SESSION, seq: 0, ack: request, message }
}

/// Returns an example of an event, with its sequence number.
fn event(name: &'static str, seq: u16, message: Message) -> ExampleFrame {
    ExampleFrame { name, session: SESSION, seq, ack: 0, message }
}

fn host(name: &[u8]) -> HostName {
    HostName::from_slice(name).unwrap()
}

/// Returns all examples of PROTOCOL.md, in order: a conversation of hosts and a board.
fn conversation() -> Vec<ExampleFrame> {
    let robot = robot();
    let job_id = summarize(&job(), &robot).plan_id;
    let layers = job_layers(&job(), &robot).collect();
    let idle = Status {
        state: State::Idle,
        fault: None,
        temperature_centi_c: Some(2213),
        target_centi_c: None,
        duty: 0,
        plan_id: 0,
        layer_count: 0,
        next_layer: 0,
        layers_laid: 0,
        interrupted: None,
        pause_cause: PauseCause::LayersExhausted,
        is_resumable: true,
        uptime_ms: 1500,
    };
    let growing = Status {
        state: State::Growing,
        temperature_centi_c: Some(20_004),
        target_centi_c: Some(20_000),
        duty: 33_000,
        plan_id: job_id,
        layer_count: 2,
        next_layer: 2,
        layers_laid: 1,
        uptime_ms: 120_000,
        ..idle.clone()
    };
    let interrupted = Status {
        state: State::Idle,
        temperature_centi_c: Some(19_120),
        target_centi_c: None,
        duty: 0,
        interrupted: Some(InterruptedLayer { min: 31, max: 32 }),
        uptime_ms: 126_000,
        ..growing.clone()
    };
    let up = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_degrees([0.0, 0.0, 1.5, 0.0, 90.0]).unwrap();
    let path = plan(&robot, &up, &goal, 100.0, Planner::TwoPlane).unwrap().path;
    let planned = summarize(&path, &robot);
    // The layer that robot A's step engine makes of the first layer: 3200 steps of the head, 6207 of the feed.
    let as_built =
        Layer { alpha: 1.570_351_470_414_044_2, height: 0.750_036_991_003_787_8, tilt: 0.007_501_530_553_559_996 };
    let hello = |name| Message::Hello(Hello { schema: SCHEMA_HASH, host: host(name), take_over: false });
    let board_hello = BoardInfo {
        schema_hash: SCHEMA_HASH,
        boot_id: 0x986b_155d,
        reset_cause: ResetCause::PowerOn,
        firmware: [0, 1, 0],
        robot_name: "growbot-a".try_into().unwrap(),
        robot_hash: robot.hash(),
        layer_capacity: 4096,
        status: idle,
        owner: Some(host(b"grow 4711 on bench")),
    };
    let measured = LayerReadings { filament_pulses: Some(55), gravity_milli_g: Some([-7, 0, 1000]) };
    let as_built = Some(LayerEncoder::default().encode(&as_built));
    let laid = LayerLaid { plan_id: job_id, index: 0, as_built, readings: Some(measured) };
    let plan_request =
        PlanRequest { start: (&up).into(), goal: (&goal).into(), radius: 100.0, planner: Planner::TwoPlane };
    let planned = Planned {
        plan_id: planned.plan_id,
        exact_hash: planned.exact_hash,
        layers: planned.layers,
        length: growbot_core::path::length(&path),
    };
    let refused = |kind, refusal| Message::Refused(RefusalResponse { kind, refusal });
    let other = |name, seq, ack, message| ExampleFrame { name, session: OTHER_SESSION, seq, ack, message };
    vec![
        request("Hello", 1, 0, hello(b"grow 4711 on bench")),
        answer("BoardInfo", 1, Message::BoardInfo(board_hello)),
        request("BeginJob", 2, 0, Message::BeginJob(BeginJob { plan_id: job_id, layers: 2, robot_hash: robot.hash() })),
        answer("Accepted", 2, Message::Accepted(Accepted { plan_id: job_id, next: 0, free_layers: 4096 })),
        request("AppendLayers", 3, 0, Message::AppendLayers(AppendLayers { plan_id: job_id, first: 0, layers })),
        request(
            "Start",
            4,
            0,
            Message::Start(Start {
                plan_id: job_id,
                on_host_silence: HostSilencePolicy::Pause,
                is_continuation: false,
            }),
        ),
        event("StateChanged", 1, Message::StateChanged(StateChanged { state: State::Heating, fault: None })),
        request("Ack", 0, 1, Message::Ack(Empty {})),
        event("LayerLaid", 4, Message::LayerLaid(laid)),
        request("GetStatus", 5, 4, Message::GetStatus(Empty {})),
        answer("Status", 5, Message::Status(growing)),
        request("Plan", 6, 4, Message::Plan(plan_request)),
        answer("Refused", 6, refused(0x08, Refusal::WrongState { state: State::Growing })),
        other("Hello of another host", 1, 0, hello(b"status 4712 on desk")),
        other("Refused, owned", 0, 1, refused(0x01, Refusal::OwnedByOtherHost { silent_ms: 340 })),
        ExampleFrame {
            name: "EmergencyStopAck",
            session: NO_SESSION,
            seq: 0,
            ack: 0,
            message: Message::EmergencyStopAck(Empty {}),
        },
        request("ClearFault", 7, 5, Message::ClearFault(Empty {})),
        answer("Status of an interrupted layer", 8, Message::Status(interrupted)),
        request("Resume", 9, 6, Message::Resume(Resume { plan_id: job_id, start_layer: 1, reported_layers: 1 })),
        answer(
            "Accepted, layers still stored",
            9,
            Message::Accepted(Accepted { plan_id: job_id, next: 2, free_layers: 4095 }),
        ),
        answer("Planned", 11, Message::Planned(planned)),
        request("Goodbye", 12, 12, Message::Goodbye(Empty {})),
    ]
}

#[test]
fn protocol_examples_match_the_code() {
    let blocks = blocks("frame");
    let written: Vec<&str> = blocks.iter().map(|(name, _)| name.as_str()).collect();
    let conversation = conversation();
    assert_eq!(written, conversation.iter().map(|example| example.name).collect::<Vec<_>>());

    let mut wrong = String::new();
    for ((name, lines), ExampleFrame { session, seq, ack, message, .. }) in blocks.iter().zip(&conversation) {
        let header = FrameHeader { kind: message.kind(), session: *session, seq: *seq, ack: *ack };
        let written = Example::parse(name, lines);
        let expected = Example::of(&header, message);
        if written != expected {
            write!(wrong, "```frame {name}\n{}```\n\n", expected.text()).unwrap();
            continue;
        }
        let mut receiver = FrameDecoder::default();
        let frames: Vec<_> = written.wire.iter().filter_map(|byte| receiver.push(*byte)).collect();
        let [Ok(LinkFrame { header: arrived, body })] = &frames[..] else { panic!("{name}: {frames:?}") };
        assert_eq!(*arrived, header, "{name}");
        assert_eq!(body[..], written.body, "{name}");
        assert_eq!(Message::decode(arrived.kind, body).as_ref(), Ok(message), "{name}");
    }
    assert!(wrong.is_empty(), "these examples must read:\n\n{wrong}");
}

#[test]
fn emergency_stop_bytes_match_the_code() {
    let blocks = blocks("bytes");
    let [(name, lines)] = &blocks[..] else { panic!("one block of bytes: {blocks:?}") };
    assert_eq!(name, "EmergencyStop");
    assert_eq!(Example::parse(name, lines).wire, EMERGENCY_STOP);
}

/// A row of the table of messages in PROTOCOL.md.
struct Row {
    kind: u8,
    name: &'static str,
    direction: &'static str,
    body: &'static str,
}

fn table() -> Vec<Row> {
    let row = |line: &'static str| {
        let cells: Vec<&str> = line.split('|').map(|cell| cell.trim().trim_matches('`')).collect();
        let kind = u8::from_str_radix(cells[1].strip_prefix("0x").unwrap(), 16).unwrap();
        Row { kind, name: cells[2], direction: cells[3], body: cells[4] }
    };
    PROTOCOL.lines().filter(|line| line.starts_with("| `0x")).map(row).collect()
}

#[test]
fn message_table_lists_exactly_all_messages() {
    let kinds: Vec<(u8, &str)> = table().iter().map(|row| (row.kind, row.name)).collect();
    assert_eq!(kinds, Message::KINDS);
    for Row { kind, name, direction, .. } in table() {
        let expected = if kind < 0x40 { "host to board" } else { "board to host" };
        assert_eq!(direction, expected, "{name}");
    }
}

/// Asserts that PROTOCOL.md has, for each of these names, one row that begins with the name and has the value in its
/// second cell.
fn assert_rows(expected: &[(&str, String)]) {
    for (name, value) in expected {
        let rows: Vec<&str> = PROTOCOL.lines().filter(|line| line.starts_with(&format!("| {name} |"))).collect();
        let [row] = rows[..] else { panic!("{name} must have one row: {rows:?}") };
        assert_eq!(row.split('|').nth(2).unwrap().trim(), format!("`{value}`"), "{name}");
    }
}

#[test]
fn quoted_numbers_match_the_code() {
    assert_rows(&[
        ("Link version", FRAME_VERSION.to_string()),
        ("Schema hash", format!("{SCHEMA_HASH:016x}")),
        ("Longest body", MAX_BODY_LEN.to_string()),
        ("Longest frame", MAX_FRAME_LEN.to_string()),
        ("Layers in one message", MAX_LAYERS_PER_MESSAGE.to_string()),
        ("Sectors of a layer", SECTORS.to_string()),
        ("CRC-32C check value", format!("{:08x}", crc_32c(b"123456789"))),
        ("CRC-64/XZ check value", format!("{:016x}", Hasher::hash(b"123456789"))),
        ("Robot hash of growbot-a", format!("{:016x}", robot().hash())),
    ]);
}

/// Returns the number of bytes that a message occupies on the link, as a request with the sequence number `seq` or as a
/// response to the request `ack`.
fn wire_bytes(seq: u16, ack: u16, message: &Message) -> usize {
    Example::of(&FrameHeader { kind: message.kind(), session: SESSION, seq, ack }, message).wire.len()
}

#[test]
fn link_load_of_layers_matches_the_text() {
    const LAYERS: u32 = 4096;
    let robot = robot();
    let arc = [Segment::Arc { alpha: 1.0, bend: 3.0, length: f64::from(LAYERS) }];
    let layers: Vec<LayerBytes> = job_layers(&arc, &robot).take(LAYERS as usize).collect();
    assert_eq!(layers.len(), LAYERS as usize);
    // The longest identifier: its varint takes ten bytes.
    let plan_id = u64::MAX;
    let (mut there, mut back) = (0, 0);
    for (seq, (batch, first)) in
        (1..).zip(layers.chunks(MAX_LAYERS_PER_MESSAGE).zip((0..).step_by(MAX_LAYERS_PER_MESSAGE)))
    {
        let layers = batch.iter().copied().collect();
        there += wire_bytes(seq, 0, &Message::AppendLayers(AppendLayers { plan_id, first, layers }));
        let next = first + batch.len() as u32;
        back += wire_bytes(0, seq, &Message::Accepted(Accepted { plan_id, next, free_layers: LAYERS - next }));
    }
    // Each byte has a start bit, eight data bits and a stop bit.
    let seconds = |bytes: usize| bytes as f64 * 10.0 / 115_200.0;
    let share = layers.concat().len() as f64 / there as f64;
    assert!(share >= 0.85 && seconds(there) < 8.0 && back < there, "{share}, {} s, {back} back", seconds(there));
    assert_rows(&[
        ("Bytes of 4,096 layers, all their frames", there.to_string()),
        ("Share of the layers in them", format!("{:.1} %", 100.0 * share)),
        ("Time at 115200 baud", format!("{:.2} s", seconds(there))),
        ("Bytes of the answers, the other way", back.to_string()),
        ("Their time", format!("{:.2} s", seconds(back))),
    ]);
}

#[test]
fn plan_id_is_the_crc_of_robot_hash_and_layers() {
    let robot = robot();
    let layers: Vec<LayerBytes> = job_layers(&job(), &robot).collect();
    let mut bytes = robot.hash().to_le_bytes().to_vec();
    bytes.extend(layers.concat());
    assert_eq!(summarize(&job(), &robot).plan_id, Hasher::hash(&bytes));

    // The second layer compensates for the rounding of the first, as PROTOCOL.md states.
    let tilts: Vec<u32> = layers.iter().map(|bytes| layer_bytes::RawLayer::from_bytes(bytes).tilt).collect();
    assert_eq!(tilts, [32_212_255, 32_212_254]);
}

/// Returns the name of a type as PROTOCOL.md writes it in another type.
fn short(ty: &NamedType) -> String {
    match ty.ty {
        DataModelType::U8 => "u8".to_owned(),
        DataModelType::U16 => "u16".to_owned(),
        DataModelType::U32 => "u32".to_owned(),
        DataModelType::U64 => "u64".to_owned(),
        DataModelType::Bool => "bool".to_owned(),
        DataModelType::I16 => "i16".to_owned(),
        DataModelType::I32 => "i32".to_owned(),
        DataModelType::F64 => "f64".to_owned(),
        DataModelType::String => "string".to_owned(),
        DataModelType::Option(inner) => format!("option {}", short(inner)),
        DataModelType::Seq(inner) => format!("list of {}", short(inner)),
        DataModelType::Tuple(parts) => format!("[{}; {}]", short(parts[0]), parts.len()),
        DataModelType::Struct(_) | DataModelType::Enum(_) => ty.name.to_owned(),
        other => panic!("PROTOCOL.md has no word for {other:?}"),
    }
}

/// Writes a type and all types in it into the map, in the form of PROTOCOL.md.
fn write_out(ty: &NamedType, into: &mut BTreeMap<String, Vec<String>>) {
    let mut inner: Vec<&NamedType> = Vec::new();
    match ty.ty {
        DataModelType::Struct(fields) => {
            let line = |name: &str, ty| format!("{name}: {}", short(ty));
            into.insert(ty.name.to_owned(), fields.iter().map(|field| line(field.name, field.ty)).collect());
            inner.extend(fields.iter().map(|field| field.ty));
        }
        DataModelType::Enum(variants) => {
            let line = |index: usize, name: &str, fields: String| format!("{index} {name}{fields}");
            let mut lines = Vec::new();
            for (index, variant) in variants.iter().enumerate() {
                let fields = match variant.ty {
                    DataModelVariant::UnitVariant => String::new(),
                    DataModelVariant::StructVariant(fields) => {
                        inner.extend(fields.iter().map(|field| field.ty));
                        let parts: Vec<_> =
                            fields.iter().map(|field| format!("{}: {}", field.name, short(field.ty))).collect();
                        format!(" {{ {} }}", parts.join(", "))
                    }
                    other => panic!("PROTOCOL.md has no word for {other:?}"),
                };
                lines.push(line(index, variant.name, fields));
            }
            into.insert(ty.name.to_owned(), lines);
        }
        DataModelType::Option(part) | DataModelType::Seq(part) => inner.push(part),
        DataModelType::Tuple(parts) => inner.push(parts[0]),
        _ => {}
    }
    for part in inner {
        write_out(part, into);
    }
}

#[test]
fn documented_types_match_the_code() {
    // The types are in the order of the table of messages.
    let bodies = [
        Hello::SCHEMA,
        Empty::SCHEMA,
        BeginJob::SCHEMA,
        AppendLayers::SCHEMA,
        Start::SCHEMA,
        Empty::SCHEMA,
        Empty::SCHEMA,
        PlanRequest::SCHEMA,
        ReadLayers::SCHEMA,
        Empty::SCHEMA,
        Tune::SCHEMA,
        Empty::SCHEMA,
        Empty::SCHEMA,
        Empty::SCHEMA,
        Resume::SCHEMA,
        Amend::SCHEMA,
        Cancel::SCHEMA,
        Empty::SCHEMA,
        Empty::SCHEMA,
        Empty::SCHEMA,
        Maintain::SCHEMA,
        Configure::SCHEMA,
        BoardInfo::SCHEMA,
        Status::SCHEMA,
        Accepted::SCHEMA,
        RefusalResponse::SCHEMA,
        Planned::SCHEMA,
        StoredLayers::SCHEMA,
        LatestFault::SCHEMA,
        SensorReadings::SCHEMA,
        BootReport::SCHEMA,
        Configured::SCHEMA,
        LayerLaid::SCHEMA,
        StateChanged::SCHEMA,
        Tuned::SCHEMA,
        Empty::SCHEMA,
    ];
    assert_eq!(table().iter().map(|row| row.body).collect::<Vec<_>>(), bodies.map(|body| body.name));
    let mut expected = BTreeMap::new();
    for body in bodies {
        write_out(body, &mut expected);
    }
    let blocks = blocks("type");
    let count = blocks.len();
    let written: BTreeMap<_, _> = blocks.into_iter().collect();
    assert_eq!(written.len(), count, "a type is written out twice");
    for (name, lines) in &expected {
        assert_eq!(written.get(name), Some(lines), "type {name}");
    }
    let unknown: Vec<_> = written.keys().filter(|name| !expected.contains_key(*name)).collect();
    assert!(unknown.is_empty(), "no message has these types: {unknown:?}");
}
