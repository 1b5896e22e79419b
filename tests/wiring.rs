//! WIRING.md describes the robot's pins as the firmware uses them: the types of its signals, and the writes of the
//! image to the ports.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use growbot_client::client::Client;
use growbot_client::port::stream::Stream;
use growbot_core::robot::{BoardKind, Signal};
use growbot_plan::robot_file;
use growbot_tests::firmware;
use growbot_tests::netduinoplus2::{self, RegisterWrite, Setup};
use growbot_tests::wiring::{Row, WIRING, pin_of, rows, rp2040_rows};

const PINS: &str = include_str!("../growbot-firmware/boards/stm32f405/pins.rs");

/// Signals whose pins stay as after a reset of the processor.
const LEFT_ALONE: [&str; 2] = ["oscillator", "debug probe"];

/// Meanings of the alternate functions (data sheet DS8626, table "alternate function mapping"), and the channels of the
/// analog inputs.
const FUNCTIONS: [(&str, u32, &str); 8] = [
    ("PA2", 7, "USART2 TX"),
    ("PA3", 7, "USART2 RX"),
    ("PA6", 2, "TIM3 channel 1, PWM"),
    ("PA7", 1, "TIM1 channel 1N, PWM"),
    ("PA8", 1, "TIM1 channel 1, PWM"),
    ("PB15", 9, "TIM12 channel 2, PWM"),
    ("PC6", 3, "TIM8 channel 1, PWM"),
    ("PC7", 3, "TIM8 channel 2, PWM"),
];
const ANALOG: [(&str, &str); 4] = [
    ("PC0", "ADC1 channel 10, analog"),
    ("PC1", "ADC1 channel 11, analog"),
    ("PC2", "ADC1 channel 12, analog"),
    ("PC3", "ADC1 channel 13, analog"),
];

/// Configuration of a pin by an image.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Pin {
    /// MODER: input, output, alternate function, analog.
    mode: u32,
    open_drain: bool,
    /// PUPDR: none, up, down.
    pull: u32,
    function: u32,
    /// Level that the pin was given before it became an output. `None` without such a level.
    level: Option<bool>,
}

impl Pin {
    fn kind(&self, name: &str) -> String {
        let kind = match self.mode {
            0 => "input".to_owned(),
            1 => if self.open_drain { "open-drain output" } else { "push-pull output" }.to_owned(),
            2 => {
                let known = FUNCTIONS.iter().find(|(pin, function, _)| (*pin, *function) == (name, self.function));
                known.map_or_else(|| format!("alternate function {}", self.function), |known| known.2.to_owned())
            }
            _ => {
                let known = ANALOG.iter().find(|(pin, _)| *pin == name);
                known.map_or("analog", |known| known.1).to_owned()
            }
        };
        kind + ["", " with pull-up", " with pull-down", " with both pulls"][self.pull as usize % 4]
    }
}

/// Returns the configuration of the pins from writes to the ports. The emulator has no ports, so their registers read
/// 0, and what the firmware changes in a register is all that it writes.
fn pins_of(writes: &[RegisterWrite]) -> BTreeMap<String, Pin> {
    let mut pins: BTreeMap<String, Pin> = BTreeMap::new();
    let mut levels: BTreeMap<String, bool> = BTreeMap::new();
    for RegisterWrite { address, value } in writes {
        let Some(at) = address.checked_sub(0x4002_0000).filter(|at| *at < 0x2400) else { continue };
        let port = char::from(b'A' + (at / 0x400) as u8);
        for number in 0..16 {
            let name = format!("P{port}{number}");
            let pair = value >> (2 * number) & 3;
            match at % 0x400 {
                0x00 if pair != 0 => {
                    let pin = pins.entry(name.clone()).or_default();
                    pin.mode = pair;
                    pin.level = levels.get(&name).copied();
                }
                0x04 if value >> number & 1 == 1 => pins.entry(name).or_default().open_drain = true,
                0x0C if pair != 0 => pins.entry(name).or_default().pull = pair,
                0x18 if value >> number & 1 == 1 => _ = levels.insert(name, true),
                0x18 if value >> (number + 16) & 1 == 1 => _ = levels.insert(name, false),
                0x20 if number < 8 && value >> (4 * number) & 15 != 0 => {
                    pins.entry(name).or_default().function = value >> (4 * number) & 15;
                }
                0x24 if number >= 8 && value >> (4 * (number - 8)) & 15 != 0 => {
                    pins.entry(name).or_default().function = value >> (4 * (number - 8)) & 15;
                }
                _ => {}
            }
        }
    }
    pins
}

/// Returns the writes of the image to registers until it responds.
fn writes_of(image: &Path) -> Vec<RegisterWrite> {
    let directory = tempfile::tempdir().unwrap();
    let trace = directory.path().join("trace");
    let setup = Setup { trace: Some(trace.clone()), ..Setup::default() };
    let board = netduinoplus2::boot_with(image, &setup).unwrap();
    let link = Stream::over("netduinoplus2".to_owned(), board.link.try_clone().unwrap()).unwrap();
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    Client::new(Box::new(link), "netduinoplus2").open_session_for(&robot).unwrap();
    netduinoplus2::writes(&std::fs::read_to_string(trace).unwrap())
}

fn driven(rows: &[Row]) -> impl Iterator<Item = &Row> {
    rows.iter().filter(|row| !LEFT_ALONE.contains(&row.signal.as_str()))
}

#[test]
fn the_image_configures_the_pins_of_the_table() {
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let enable_low = robot.description().motion.enable_low;
    let rows = rows();
    let mut pins = pins_of(&writes_of(&firmware("stm32f405")));
    for row in driven(&rows) {
        let [name] = &row.pins[..] else { panic!("{row:?} has not one pin") };
        let pin = pins.remove(name).unwrap_or_else(|| panic!("{}: the image does not configure {name}", row.signal));
        assert_eq!(pin.kind(name), row.kind, "{}, {name}: {pin:?}", row.signal);
        let level = match (row.safe.as_str(), pin.mode) {
            ("low", 1) => Some(false),
            ("off", 1) => Some(enable_low),
            ("released", 1) => Some(true),
            // Output of a timer, output with any level, input.
            ("low", 2) | ("any", 1) => pin.level,
            ("", _) => None,
            (other, mode) => panic!("{}: a safe level of {other:?} means nothing in mode {mode}", row.signal),
        };
        assert_eq!(pin.level, level, "{}, {name}: its level before it becomes an output", row.signal);
    }
    assert!(pins.is_empty(), "the image configures pins that are in no row: {pins:?}");
}

/// The firmware documents each signal at the pin of the table. The compiler checks that the signal's type belongs to
/// this pin.
#[test]
fn each_firmware_signal_is_at_the_pin_of_the_table() {
    let lines: Vec<&str> = PINS.lines().collect();
    let signal_of = |line: &str| line.strip_prefix("/// Signal `")?.split('`').next().map(str::to_owned);
    let pin_of = |line: &str| {
        let mut types = line.strip_prefix("pub type ")?.split(['<', '=', ' ', '>', ';']);
        let is_pin = |word: &&str| word.starts_with('P') && word.ends_with(|c: char| c.is_ascii_digit());
        types.find(is_pin).map(str::to_owned)
    };
    let of_firmware: BTreeSet<(String, String)> =
        lines.windows(2).filter_map(|pair| Some((signal_of(pair[0])?, pin_of(pair[1])?))).collect();
    let rows = rows();
    let of_table: BTreeSet<(String, String)> =
        driven(&rows).map(|row| (row.signal.clone(), row.pins.join(", "))).collect();
    assert_eq!(of_firmware, of_table);
    assert_eq!(lines.iter().filter(|line| line.starts_with("pub type ")).count(), of_firmware.len());
}

#[test]
fn no_pin_has_two_roles_or_is_a_jtag_pin() {
    let rows = rows();
    let pins: Vec<&String> = rows.iter().flat_map(|row| &row.pins).collect();
    let once: BTreeSet<&&String> = pins.iter().collect();
    assert_eq!(once.len(), pins.len(), "{pins:?}");
    for jtag in ["PA15", "PB3", "PB4"] {
        assert!(!pins.iter().any(|pin| *pin == jtag), "{jtag} is JTAG's");
    }
    assert!(pins.iter().all(|pin| pin.starts_with('P')), "{pins:?}");
}

#[test]
fn every_named_robot_file_field_exists() {
    let fields =
        [include_str!("../growbot-core/src/robot/description.rs"), include_str!("../growbot-core/src/robot/board.rs")]
            .concat();
    let names =
        WIRING.split('`').skip(1).step_by(2).filter(|name| name.contains('.') && !name.contains(['/', ' ', '-']));
    for name in names {
        for part in name.trim_matches(['[', ']']).split('.') {
            assert!(fields.contains(&format!("pub {part}: ")), "{name} is in no robot file");
        }
    }
}

#[test]
fn pin_tables_match_the_boards() {
    let rows = rp2040_rows();
    assert_eq!(rows.len(), Signal::ALL.len() + 2, "every signal, and the link");
    for signal in Signal::ALL {
        let [name, _, pico, skr_pico] =
            rows.iter().find(|row| row[1] == signal.name()).unwrap_or_else(|| panic!("WIRING.md has no {signal}"));
        assert_eq!(BoardKind::Pico.pin(signal).map(|pin| pin.to_string()).as_ref(), Some(pico), "{signal}");
        let place = BoardKind::SkrPico.pin(signal).zip(BoardKind::SkrPico.terminal(signal));
        let place = place.map_or("none".to_owned(), |(pin, terminal)| format!("{pin}, {terminal}"));
        assert_eq!(&place, skr_pico, "{signal}");
        assert_eq!(BoardKind::Stm32f405.terminal(signal), Some(pin_of(name).as_str()), "{signal}");
    }
}

#[test]
fn the_skr_pico_diagram_shows_its_pins() {
    let diagram = include_str!("../book/src/pictures/wiring-skr-pico.svg");
    for signal in Signal::ALL {
        let Some((pin, terminal)) = BoardKind::SkrPico.pin(signal).zip(BoardKind::SkrPico.terminal(signal)) else {
            continue;
        };
        // The number is in a text such as ">GPIO 4<", or in a list of numbers.
        let is_there = |text: &str| {
            let text = text.trim_start_matches("GPIO ");
            text.split(", ").any(|number| number == pin.to_string())
        };
        let mut texts = diagram.split(['<', '>']);
        assert!(texts.any(is_there), "{signal} is at pin {pin}");
        assert!(diagram.contains(terminal), "{signal} is at {terminal}");
    }
}
