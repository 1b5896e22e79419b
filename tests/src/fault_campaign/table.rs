//! Formats the results of the campaign as a table.

use std::fmt::Write;

use growbot_core::link::message::Fault;

use super::cases::{Case, Expected, Onset};
use super::growth::Observation;

/// Returns a Markdown table of the seconds to detection and the peak temperature for each fault and onset, first for
/// the lump, then for the cartridge.
pub fn markdown(lump: &[(Case, Vec<Observation>)], cartridge: &[(Case, Vec<Observation>)]) -> String {
    let mut text = String::from(
        "| fault | onset | growths | noticed | as | lump: after, s: median | longest | peak, C | cartridge: after, s: median | longest | peak, C |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for ((case, on_lump), (_, on_cartridge)) in lump.iter().zip(cartridge) {
        let seen = || on_lump.iter().chain(on_cartridge);
        let mut codes: Vec<&str> = seen().filter_map(|one| one.fault).map(Fault::code).collect();
        codes.sort_unstable();
        codes.dedup();
        let told = match case.expected() {
            Expected::Codes(_) => codes.join(", "),
            Expected::CodesOrPause(_) => format!("{}, or a pause", codes.join(", ")),
            Expected::AtNextStart(_) => format!("{}, at the next start: no harm before", codes.join(", ")),
            Expected::EmergencyStop => "state emergency-stop".to_string(),
            Expected::Continues => "no harm: the growth continues".to_string(),
            Expected::Refused => "the growth is refused".to_string(),
            Expected::StaysPaused => "stays paused".to_string(),
        };
        let growths = seen().count();
        let noticed = match case.expected() {
            Expected::Continues | Expected::Refused | Expected::StaysPaused => "-".to_string(),
            _ => {
                format!("{:.0} %", 100.0 * seen().filter_map(|one| one.after_s).count() as f64 / growths.max(1) as f64)
            }
        };
        let fault = if case.onset == Onset::Boot { case.fault.name() } else { "" };
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "| {fault} | {} | {growths} | {noticed} | {told} | {} | {} |",
            case.onset.name(),
            figures(on_lump),
            figures(on_cartridge),
        );
    }
    text
}

/// Formats median and longest time to detection, s, and the peak, degrees Celsius.
fn figures(seen: &[Observation]) -> String {
    let mut after: Vec<f64> = seen.iter().filter_map(|one| one.after_s).collect();
    after.sort_by(f64::total_cmp);
    let peak = seen.iter().map(|one| one.peak_c).fold(f64::NEG_INFINITY, f64::max);
    let time = |seconds: Option<&f64>| seconds.map_or("-".to_string(), |seconds| format!("{seconds:.1}"));
    format!("{} | {} | {peak:.0}", time(after.get(after.len() / 2)), time(after.last()))
}
