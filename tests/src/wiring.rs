//! The table of pins in WIRING.md.

/// Text of the document.
pub const WIRING: &str = include_str!("../../WIRING.md");

/// A row of the table: a signal and its wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// Name of the signal.
    pub signal: String,
    /// Pins of the signal, such as "PA2". Only the oscillator and the debug probe have several.
    pub pins: Vec<String>,
    /// Type of the pin.
    pub kind: String,
    /// Safe level. Empty for an input.
    pub safe: String,
}

/// Returns all rows of the table of pins.
///
/// # Panics
/// Panics if the table does not exist.
pub fn rows() -> Vec<Row> {
    let lines = WIRING.lines().skip_while(|line| !line.starts_with("<!-- pins")).skip(3);
    let rows = lines.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, signal, pins, kind, safe, _] = cells[..] else {
            panic!("a row of the table of pins in WIRING.md has the wrong number of columns: {line}")
        };
        Row {
            signal: signal.to_owned(),
            pins: pins.split(',').map(|pin| pin.trim().to_owned()).collect(),
            kind: kind.to_owned(),
            safe: safe.to_owned(),
        }
    });
    let rows: Vec<Row> = rows.collect();
    assert!(rows.len() > 20, "the table of pins in WIRING.md has {} rows", rows.len());
    rows
}

/// Returns the pin of a signal.
///
/// # Panics
/// Panics if the signal does not exist.
pub fn pin_of(signal: &str) -> String {
    let row = rows().into_iter().find(|row| row.signal == signal);
    row.and_then(|row| row.pins.into_iter().next()).unwrap_or_else(|| panic!("WIRING.md has no signal {signal:?}"))
}

/// Returns the rows of the table of boards with an RP2040: signal, key, pin of the Pico, pin and terminal of the SKR
/// Pico.
///
/// # Panics
/// Panics if a row has another number of cells.
pub fn rp2040_rows() -> Vec<[String; 4]> {
    let lines = WIRING.lines().skip_while(|line| !line.starts_with("<!-- rp2040")).skip(3);
    let rows = lines.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, signal, key, pico, skr_pico, _] = cells[..] else {
            panic!("a row of the table of pins in WIRING.md has the wrong number of columns: {line}")
        };
        [signal, key.trim_matches('`'), pico, skr_pico].map(str::to_owned)
    });
    rows.collect()
}
