//! The campaign as a table.

use std::fmt::Write;

use growbot_core::link::message::Fault;

use super::cases::{Case, Onset, Right};
use super::growth::Seen;

/// Seconds to detection and peak temperature of each fault and onset, as Markdown.
#[must_use]
pub fn markdown(rows: &[(Case, Vec<Seen>)]) -> String {
    let mut text = String::from(
        "| fault | onset | growths | noticed | as | after, s: median | longest | peak, C |\n|---|---|---|---|---|---|---|---|\n",
    );
    for (case, seen) in rows {
        let mut after: Vec<f64> = seen.iter().filter_map(|one| one.after_s).collect();
        after.sort_by(f64::total_cmp);
        let mut codes: Vec<&str> = seen.iter().filter_map(|one| one.fault).map(Fault::code).collect();
        codes.sort_unstable();
        codes.dedup();
        let told = match case.right() {
            Right::Codes(_) => codes.join(", "),
            Right::EmergencyStop => "state emergency-stop".to_string(),
            Right::GoesOn => "no harm: the growth goes on".to_string(),
        };
        let peak = seen.iter().map(|one| one.peak_c).fold(f64::NEG_INFINITY, f64::max);
        let time = |seconds: Option<&f64>| seconds.map_or("-".to_string(), |seconds| format!("{seconds:.1}"));
        let fault = if case.onset == Onset::Boot { case.fault.name() } else { "" };
        let noticed = match case.right() {
            Right::GoesOn => "-".to_string(),
            _ => format!("{:.0} %", 100.0 * after.len() as f64 / seen.len().max(1) as f64),
        };
        // A string takes everything that is written to it.
        let _ = writeln!(
            text,
            "| {fault} | {} | {} | {noticed} | {told} | {} | {} | {peak:.0} |",
            case.onset.name(),
            seen.len(),
            time(after.get(after.len() / 2)),
            time(after.last()),
        );
    }
    text
}
