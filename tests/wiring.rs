//! WIRING.md and the firmware say the same about the robot's pins.

use std::collections::BTreeSet;

const WIRING: &str = include_str!("../WIRING.md");
const PINS: &str = include_str!("../growbot-firmware/src/bin/stm32f405/pins.rs");

/// Rows of the first table after a line that begins like this, without the marks of a comment.
fn table(text: &str, after: &str) -> Vec<String> {
    text.lines()
        .skip_while(|line| !line.starts_with(after))
        .map(|line| line.strip_prefix("//! ").unwrap_or(line))
        .skip_while(|line| !line.starts_with('|'))
        .take_while(|line| line.starts_with('|'))
        .map(str::to_owned)
        .collect()
}

/// The pins of each row, as "PA2".
fn pins(rows: &[String]) -> Vec<String> {
    let cells = rows.iter().skip(2).filter_map(|row| row.split('|').nth(2));
    cells.flat_map(|cell| cell.split(',')).map(|pin| pin.trim().to_owned()).collect()
}

#[test]
fn the_table_of_pins_is_the_firmwares() {
    let firmware = table(PINS, "//! What is wired where");
    assert!(firmware.len() > 20, "{firmware:#?}");
    assert_eq!(table(WIRING, "<!-- pins"), firmware);
}

#[test]
fn no_pin_has_two_roles_and_none_is_jtags() {
    let pins = pins(&table(PINS, "//! What is wired where"));
    let once: BTreeSet<&String> = pins.iter().collect();
    assert_eq!(once.len(), pins.len(), "{pins:?}");
    for jtag in ["PA15", "PB3", "PB4"] {
        assert!(!pins.iter().any(|pin| pin == jtag), "{jtag} is JTAG's");
    }
    assert!(pins.iter().all(|pin| pin.starts_with('P')), "{pins:?}");
}

#[test]
fn every_field_of_a_robot_file_that_is_named_exists() {
    let robot = include_str!("../robots/growbot-a.toml");
    let names =
        WIRING.split('`').skip(1).step_by(2).filter(|name| name.contains('.') && !name.contains(['/', ' ', '-']));
    for name in names {
        for part in name.split('.') {
            assert!(robot.contains(part), "{name} is in no robot file");
        }
    }
}
