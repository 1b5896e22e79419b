//! Tests of `growbot plan --scene` with randomly changed scene files, meshes and point clouds. The files must be read,
//! or refused with one message and exit code 2, within 2 GiB of memory and without a panic.
//!
//! The test tries a hundred files. `GROWBOT_SCENE_FILES=1000 cargo test -p growbot-host --test it scene_files::` tries
//! a thousand files.
#![cfg(target_os = "linux")]

use crate::running;

use std::fs;
use std::path::Path;

use growbot_core::random::Rng;
use running::{PROGRAM, command, in_lines};

const SCENE: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5.0\n[[box]]\ncenter_mm = [100.0, 0.0, 200.0]\n\
                     size_mm = [50, 60.0, 70.0]\nrpy_deg = [0, 0, 90]\n[[ball]]\ncenter_mm = [0, 300, 0]\n\
                     radius_mm = 40\n[[capsule]]\nfrom_mm = [0, 0, 500]\nto_mm = [100, 0, 500]\nradius_mm = 10\n\
                     [[halfspace]]\npoint_mm = [0, 0, -50]\nnormal = [0, 0, 2]\n[[mesh]]\nfile = \"wedge.obj\"\n\
                     solid = true\n[[points]]\nfile = \"scan.ply\"\nradius_mm = 0.6\n";
const WEDGE: &str = "v 200 0 0\nv 300 0 0\nv 200 100 0\nv 200 0 100\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
const SCAN: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                    end_header\n900 0 0\n910 0 0\n920 5 5\n";
const PCD: &str = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n\
                   DATA ascii\n900 0 0\n910 0 0\n";
/// Limit of the command's address space, KiB.
const MEMORY: u64 = 2 << 20;

/// Returns a binary STL file: its header, and one triangle, which is an open surface.
fn stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(1_u32.to_le_bytes());
    for value in [0.0, 0.0, 1.0, 200.0, 0.0, 0.0, 300.0, 0.0, 0.0, 200.0, 100.0_f32, 0.0] {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 2]);
    bytes
}

/// Applies one to four random changes: truncates the bytes, removes, repeats or overwrites a part, inserts a huge
/// number or a terminal escape sequence, or flips a bit.
fn mutate(bytes: &mut Vec<u8>, random: &mut Rng) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len() as u64 + 1) as usize;
        let length = (random.below(40) as usize).min(bytes.len() - at);
        match random.below(7) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..at + length)),
            2 => {
                let stretch = bytes[at..at + length].to_vec();
                bytes.splice(at..at, stretch);
            }
            3 => bytes[at..at + length].fill(random.next_u64() as u8),
            4 => drop(bytes.splice(at..at, *b" 99999999999 ")),
            5 => drop(bytes.splice(at..at, *b"\x1b[2J")),
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
    }
}

/// A plan names the file of its scene, so standard input cannot be one.
#[test]
fn standard_input_is_no_scene() {
    let ran = command(PROGRAM).args(["plan", "--to", "0,0,300", "--scene", "-"]).output().unwrap();
    let answer = String::from_utf8(ran.stderr).unwrap();
    assert!(ran.status.code() == Some(2) && answer.contains("cannot be read from standard input"), "{answer}");
}

/// Plans a path in this scene of the directory. Checks that a refusal is one message, and returns the exit code.
fn plan(directory: &Path, scene: &str) -> i32 {
    let limited = format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\"");
    let args = ["plan", "--to", "0,0,300", "--effort", "1", "--scene", scene];
    let ran = command("sh").args(["-c", &limited, PROGRAM]).args(args).current_dir(directory).output().unwrap();
    let answer = in_lines(&String::from_utf8(ran.stderr).unwrap());
    let code = ran.status.code().unwrap_or_else(|| panic!("{scene}: {:?}: {answer}", ran.status));
    assert!(matches!(code, 0..=2) && !answer.contains("panicked"), "{scene}: {code}: {answer}");
    assert!(!answer.contains('\x1b'), "{scene}: {answer:?}");
    if code == 2 {
        assert!(ran.stdout.is_empty(), "{scene}");
        assert!(answer.starts_with("error: ") && answer.matches('\n').count() == 1, "{scene}: {answer:?}");
    }
    code
}

#[test]
fn corrupted_files_are_read_or_refused_with_one_message() {
    let count = std::env::var("GROWBOT_SCENE_FILES").map_or(100, |count| count.parse().expect("a whole number"));
    let originals: [(&str, Vec<u8>); 6] = [
        ("scene.toml", SCENE.into()),
        ("scene.toml", SCENE.into()),
        ("changed.obj", WEDGE.into()),
        ("changed.ply", SCAN.into()),
        ("changed.pcd", PCD.into()),
        ("changed.stl", stl()),
    ];
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    fs::write(at("wedge.obj"), WEDGE).unwrap();
    fs::write(at("scan.ply"), SCAN).unwrap();
    fs::write(at("whole.toml"), SCENE).unwrap();
    assert_eq!(plan(directory.path(), "whole.toml"), 0);
    let mut random = Rng::new(&[17]);
    let mut codes = [0; 3];
    for number in 0..count {
        let (name, original) = &originals[number % originals.len()];
        let mut bytes = original.clone();
        mutate(&mut bytes, &mut random);
        fs::write(at(name), &bytes).unwrap();
        codes[plan(directory.path(), name) as usize] += 1;
    }
    println!("{codes:?} with exit codes 0, 1 and 2, of {count}");
    assert!(codes[2] > count / 4 && codes[0] > 0, "{codes:?}");
}

#[test]
fn repeated_references_cannot_exceed_the_size_limit() {
    let directory = tempfile::tempdir().unwrap();
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                 end_header\n900 0 0\n";
    let mut bytes = cloud.as_bytes().to_vec();
    bytes.resize(60 << 20, b'\n');
    fs::write(directory.path().join("scan.ply"), bytes).unwrap();
    let entry = "[[points]]\nfile = \"scan.ply\"\nradius_mm = 1\n";
    let scene = "format = \"growbot-scene/1\"\n".to_owned() + &entry.repeat(20);
    fs::write(directory.path().join("scene.toml"), scene).unwrap();
    assert_eq!(plan(directory.path(), "scene.toml"), 2);
}
