//! Runs growbot on hostile inputs: changed plans, run logs, robot files, batches and scripts, and boards that send
//! nonsense. There must be no panic, no hang, no character that controls a terminal, no partial file, and a documented
//! exit code.
//!
//! The test tries some files and boards. `cargo hostile-campaign` tries 10,000 files and 200 boards.
//! `GROWBOT_HOSTILE_FILES`, `GROWBOT_HOSTILE_BOARDS`, `GROWBOT_HOSTILE_SECONDS` (the time limit of one run) and
//! `GROWBOT_HOSTILE_SEED` change these numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use growbot_core::random::Rng;
use growbot_plan::parallel;
use hostile::boards::{self, Manner};
use hostile::mutation::mutated;
use hostile::{faults, number, run};

use crate::hostile;

fn limit() -> Duration {
    Duration::from_secs(number("GROWBOT_HOSTILE_SECONDS", 60))
}

/// A kind of input: its valid text, and the commands that read it. In the commands, `IN` stands for the input file and
/// `OUT.` for the output file.
struct Kind {
    name: &'static str,
    text: Vec<u8>,
    commands: &'static [&'static str],
}

const OF_PLANS: &[&str] = &[
    "layers IN",
    "view IN -o OUT.html",
    "view IN -o OUT.svg",
    "view IN --plot heights,tilt -o OUT.svg",
    "export IN -o OUT.stl --segments 8 --every 20",
    "export IN -o OUT.3mf --segments 8 --every 20",
    "export IN -o OUT.csv",
    "simulate IN --noise 5 --repeat 3",
    "grow IN --json --log OUT.jsonl",
    "resume IN --yes",
    "replay IN",
];
const OF_LOGS: &[&str] = &[
    "replay IN",
    "replay IN --json",
    "replay IN --layers",
    "view IN -o OUT.html",
    "view IN -o OUT.svg",
    "view IN --plot heights,tilt,error,temperature --x-axis time -o OUT.svg",
    "export IN -o OUT.mcap",
    "export IN -o OUT.glb --segments 8 --every 20",
    "export IN -o OUT.csv",
    "export IN --body commanded -o OUT.stl --segments 8 --every 20",
    "resume IN --yes",
    "layers IN",
];
const OF_ROBOTS: &[&str] = &[
    "robots IN",
    "rmin --robot IN",
    "rmin --robot IN --json",
    "plan --robot IN --to 0,60,120,90,30 -o OUT.json",
    "status --port sim --robot IN",
    "grow --robot IN --to 0,0,5,0,90 --json --log OUT.jsonl",
];
const OF_BATCHES: &[&str] = &["plan --batch IN --json", "plan --batch - --json"];
const OF_SCRIPTS: &[&str] = &["console --robot growbot-a2", "new-robot -o OUT.toml"];

fn text_of(file: &str) -> Vec<u8> {
    fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file)).unwrap()
}

/// Runs a command that must succeed.
fn done(directory: &Path, command: &str) {
    let args: Vec<String> = command.split(' ').map(str::to_owned).collect();
    let ran = run(directory, &args, b"", Duration::from_secs(600));
    assert_eq!(ran.code, Some(0), "{command}: {}", String::from_utf8_lossy(&ran.err));
}

/// Creates valid inputs in the directory, and returns each kind of input with the commands that read it.
fn kinds(directory: &Path) -> Vec<Kind> {
    done(directory, "plan --robot growbot-a2 --to 0,60,120,90,30 -o plan.json");
    done(directory, "plan --to 0,0,20,0,90 -o short.json");
    done(directory, "grow --to 0,0,20,0,90 --noise 5 --log run.jsonl");
    done(directory, "grow --to 0,0,20,0,90 --noise 5 --feedback --log fed-back.jsonl");
    let read = |name: &str| fs::read(directory.join(name)).unwrap();
    let header = "id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg,radius_mm,planner";
    let batch = format!(
        "{header}\na,0,0,0,0,90,0,0,100,0,90,,\nb,0,0,0,0,90,200,100,600,0,45,120,two-plane\nc,1,2,3,4,5,6,7,8,9,10,,\n"
    );
    let script =
        "help\nstatus\nplan 0,0,20,0,90\nlayers 3\nstart\nwait 60\npause\nwait 5\nstart\nstop\nstatus\nclear\nquit\n";
    let kind = |name, text, commands| Kind { name, text, commands };
    vec![
        kind("plan", read("plan.json"), OF_PLANS),
        kind("short plan", read("short.json"), OF_PLANS),
        kind("run log", read("run.jsonl"), OF_LOGS),
        kind("run log with feedback", read("fed-back.jsonl"), OF_LOGS),
        kind("robot", text_of("robots/growbot-a2.toml"), OF_ROBOTS),
        kind("another robot", text_of("robots/growbot-b.toml"), OF_ROBOTS),
        kind("batch", batch.into_bytes(), OF_BATCHES),
        kind("script", script.as_bytes().to_vec(), OF_SCRIPTS),
    ]
}

/// Runs a command on one randomly changed input. Returns the exit code, and descriptions of the faults of the command.
fn try_file(kind: &Kind, seed: u64, index: u64) -> (Option<i32>, Vec<String>) {
    let mut random = Rng::new(&[seed, index]);
    let text = mutated(&kind.text, &mut random);
    let command = kind.commands[random.below(kind.commands.len() as u64) as usize];
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("in"), &text).unwrap();
    let args: Vec<String> = command.split(' ').map(|part| if part == "IN" { "in" } else { part }.to_owned()).collect();
    let output = args.iter().find(|arg| arg.starts_with("OUT."));
    let ran = run(directory.path(), &args, &text, limit());
    let mut wrong = faults(&ran, directory.path(), output.map(String::as_str));
    // `resume` may have appended to a log. All other inputs must be unchanged.
    let after = fs::read(directory.path().join("in")).unwrap();
    if !after.starts_with(&text) || (after.len() > text.len() && args[0] != "resume") {
        wrong.push("its input was changed".to_owned());
    }
    if !wrong.is_empty() {
        let kept = keep(&text, kind.name, seed, index);
        wrong.push(format!(
            "{} {index} of seed {seed}, `growbot {command}`; the file is {}",
            kind.name,
            kept.display()
        ));
    }
    (ran.code, wrong)
}

/// Number of runs by exit code. `None` stands for runs without an exit code.
type Codes = BTreeMap<Option<i32>, u64>;

/// Stores an input that caused a fault, so that it can be inspected, and returns its path.
fn keep(text: &[u8], kind: &str, seed: u64, index: u64) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hostile");
    fs::create_dir_all(&folder).unwrap();
    let file = folder.join(format!("{}-{seed}-{index}", kind.replace(' ', "-")));
    fs::write(&file, text).unwrap();
    file
}

#[test]
fn corrupted_files_cause_no_crash() {
    let (files, seed) = (number("GROWBOT_HOSTILE_FILES", 240), number("GROWBOT_HOSTILE_SEED", 1));
    println!("{files} files, seed {seed}");
    let directory = tempfile::tempdir().unwrap();
    let kinds = kinds(directory.path());
    let (mut codes, mut wrong) = (Codes::new(), Vec::new());
    for index in 0..files {
        let (code, faults) = try_file(&kinds[index as usize % kinds.len()], seed, index);
        *codes.entry(code).or_default() += 1;
        if !faults.is_empty() {
            println!("{}", faults.join("\n  "));
            wrong.push(faults);
        }
    }
    println!("{} of {files} files did harm; exit codes {codes:?}", wrong.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
    // Changes that all fail the first check would test nothing.
    assert!(codes.get(&Some(0)).is_some_and(|done| *done > files / 10), "{codes:?}");
}

/// Commands that communicate with a hostile board.
const TO_BOARDS: [&str; 9] = [
    "grow --robot growbot-a2 --to 0,0,8,0,90 --json --log OUT.jsonl",
    "grow --robot growbot-a2 --to 0,0,8,0,90 --feedback --log OUT.jsonl",
    "status",
    "status --json",
    "stop",
    "estop",
    "cancel",
    "console --robot growbot-a2",
    "resume run.jsonl --yes",
];

/// Runs a command on a hostile board, with this run log as input. Returns the exit code, and descriptions of the faults
/// of the command.
fn try_board(log: &Path, seed: u64, index: u64) -> (Option<i32>, Vec<String>) {
    let script = "status\nplan 0,0,6,0,90\nstart\nwait 600\nlayers\nstatus\nquit\n";
    let mut random = Rng::new(&[seed, index]);
    let manner = Manner::ALL[index as usize % Manner::ALL.len()];
    // A growth on a robot that lies is possible, and the robot sends most of its lies there.
    let command = TO_BOARDS[random.below(TO_BOARDS.len() as u64) as usize];
    let command =
        if manner == Manner::Lies && !index.is_multiple_of(3) { TO_BOARDS[index as usize % 2] } else { command };
    let directory = tempfile::tempdir().unwrap();
    fs::copy(log, directory.path().join("run.jsonl")).unwrap();
    let mut args: Vec<String> = command.split(' ').map(str::to_owned).collect();
    args.extend(["--port".to_owned(), boards::start(manner, seed.wrapping_add(index))]);
    let output = args.iter().find(|arg| arg.starts_with("OUT.")).cloned();
    let ran = run(directory.path(), &args, script.as_bytes(), limit() + boards::LIFE);
    let mut faults = faults(&ran, directory.path(), None);
    let log = output.filter(|_| ran.code == Some(2)).map(|output| directory.path().join(output));
    if log.is_some_and(|log| log.exists()) {
        faults.push("a log was left of a growth that never began".to_owned());
    }
    if !faults.is_empty() {
        let answer = String::from_utf8_lossy(&ran.err).into_owned();
        faults.push(format!("board {index} of seed {seed}, {manner:?}, `growbot {command}`: {answer}"));
    }
    (ran.code, faults)
}

#[test]
fn nonsense_responses_of_boards_cause_no_crash() {
    let (boards, seed) = (number("GROWBOT_HOSTILE_BOARDS", 16), number("GROWBOT_HOSTILE_SEED", 1));
    println!("{boards} boards, seed {seed}");
    let before = tempfile::tempdir().unwrap();
    let log = before.path().join("run.jsonl");
    done(before.path(), "grow --robot growbot-a2 --to 0,0,8,0,90 --log run.jsonl");
    let all: Vec<u64> = (0..boards).collect();
    // The runs mostly wait, so eight run at a time.
    let tried = parallel::map_on(8, &all, |&index| try_board(&log, seed, index), |_| {});
    let (mut codes, mut wrong) = (Codes::new(), Vec::new());
    for (code, faults) in tried {
        *codes.entry(code).or_default() += 1;
        if !faults.is_empty() {
            println!("{}", faults.join("\n  "));
            wrong.push(faults);
        }
    }
    println!("{} of {boards} boards did harm; exit codes {codes:?}", wrong.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
}
