//! Tests of descriptions of robots in the form that boards receive: encoded, decoded, and corrupted on the link.

use std::collections::BTreeMap;

use growbot_core::hash::Hasher;
use growbot_core::random::splitmix64;
use growbot_core::robot::{ENCODING_VERSION, MAX_VERSIONED_LEN, Robot, RobotError};

/// Number of corrupted descriptions that are tried.
const CHANGED: u64 = 10_000;

/// Returns all robots in `robots/` and in its examples.
fn robots() -> Vec<Robot> {
    let directories =
        [concat!(env!("CARGO_MANIFEST_DIR"), "/../robots"), concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/examples")];
    let files = directories.map(|directory| std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()));
    let mut files: Vec<_> = files.into_iter().flatten().collect();
    files.sort();
    let read = |file| Robot::new(toml::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()).unwrap();
    files.iter().filter(|file| file.extension().is_some_and(|kind| kind == "toml")).map(read).collect()
}

fn encoded(robot: &Robot) -> Vec<u8> {
    robot.encode_for_board(&mut [0; MAX_VERSIONED_LEN]).unwrap().to_vec()
}

#[test]
fn every_built_in_robot_round_trips() {
    let robots = robots();
    assert!(robots.len() >= 12, "{} robots", robots.len());
    assert!(robots.iter().any(|robot| robot.description().board.is_some()), "one names its board");
    for robot in robots.iter().filter(|robot| robot.check_for_board().is_ok()) {
        let bytes = encoded(robot);
        assert!(bytes.len() < MAX_VERSIONED_LEN, "{}: {} bytes", robot.name(), bytes.len());
        assert_eq!(Robot::decode_for_board(&bytes).as_ref(), Ok(robot), "{}", robot.name());
        assert_eq!(robot.hash(), Hasher::hash(&bytes[1..]), "{}", robot.name());
    }
    let to_simulate = robots.iter().filter(|robot| robot.check_for_board().is_err());
    for robot in to_simulate {
        let refused = Robot::decode_for_board(&encoded(robot));
        assert!(matches!(refused, Err(RobotError::TooLarge { field: "motion.tick_hz", .. })), "{refused:?}");
    }
}

/// Checks that the encoding is that of this version. A change of the encoding needs another [`ENCODING_VERSION`],
/// because a board reads the description that it stored with its previous firmware.
#[test]
fn the_encoding_matches_its_version() {
    let robot = robots().into_iter().find(|robot| robot.name() == "growbot-a").unwrap();
    let bytes = encoded(&robot);
    assert_eq!((ENCODING_VERSION, bytes.len(), Hasher::hash(&bytes)), (2, 461, 0x78d2_6cdc_c785_5249));
}

#[test]
fn truncated_and_unsupported_encodings_are_refused() {
    let bytes = encoded(&robots()[0]);
    for length in 0..bytes.len() {
        assert_eq!(Robot::decode_for_board(&bytes[..length]), Err(RobotError::Unreadable), "{length} bytes");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert_eq!(Robot::decode_for_board(&longer), Err(RobotError::Unreadable));
    for version in (0..=u8::MAX).filter(|version| *version != ENCODING_VERSION) {
        let other: Vec<u8> = [version].into_iter().chain(bytes[1..].iter().copied()).collect();
        assert_eq!(Robot::decode_for_board(&other), Err(RobotError::VersionMismatch { version }));
    }
}

/// Numbers that code often does not handle, which are written into descriptions.
const ODD: [f64; 10] =
    [0.0, -0.0, -1.0, 1e-300, 1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MIN_POSITIVE, f64::MAX];

/// Makes one to three random changes in the bytes.
fn change(bytes: &mut Vec<u8>, mut random: impl FnMut() -> usize) {
    for _ in 0..=random() % 3 {
        let at = random() % bytes.len();
        match random() % 6 {
            0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << (random() % 8)),
            1 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = random() as u8),
            2 => bytes.truncate(at),
            3 => bytes.insert(at, random() as u8),
            4 => {
                let odd = ODD[random() % ODD.len()].to_le_bytes();
                bytes.iter_mut().skip(at).zip(odd).for_each(|(byte, odd)| *byte = odd);
            }
            _ => {
                let with = random() % bytes.len();
                bytes.swap(at, with);
            }
        }
        if bytes.is_empty() {
            return;
        }
    }
}

#[test]
fn a_changed_description_is_refused_or_valid() {
    let robots = robots();
    let mut outcomes = BTreeMap::<&str, u64>::new();
    for seed in 0..CHANGED {
        let mut count = seed << 8;
        let mut random = || {
            count += 1;
            splitmix64(count) as usize >> 8
        };
        let mut bytes = encoded(&robots[random() % robots.len()]);
        change(&mut bytes, random);
        let outcome = match Robot::decode_for_board(&bytes) {
            Ok(robot) => {
                assert_eq!(Robot::new(robot.description().clone()).as_ref(), Ok(&robot), "seed {seed}");
                assert_eq!(Robot::decode_for_board(&encoded(&robot)).as_ref(), Ok(&robot), "seed {seed}");
                assert!(robot.min_radius() > 0.0 && robot.feed_steps_per_length() > 0.0, "seed {seed}");
                "valid"
            }
            Err(RobotError::VersionMismatch { .. }) => "other version",
            Err(RobotError::Unreadable) => "unreadable",
            Err(error) => {
                assert!(error.to_string().len() > 20, "seed {seed}: {error}");
                "against a limit"
            }
        };
        *outcomes.entry(outcome).or_default() += 1;
    }
    println!("{CHANGED} changed descriptions: {outcomes:?}");
    assert_eq!(outcomes.len(), 4, "{outcomes:?}");
    assert!(outcomes.values().all(|count| *count > CHANGED / 1000), "{outcomes:?}");
}
