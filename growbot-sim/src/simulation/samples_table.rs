//! The table of simulated growths, with a row for each growth.

use growbot_plan::table::{NumberFormat, Table, pose_columns};

use super::disturbance_report::DisturbanceReport;
use super::{Simulation, SimulationResult};

/// A row of the table: the seed, and the growth.
pub type SampleRow = (u64, SimulationResult);

/// Returns the table of growths. The endings `_mm` and `_deg` are units.
pub fn samples_table(simulation: &Simulation) -> Table<'static, SampleRow> {
    let [start, goal] = [simulation.start(), simulation.goal()].map(|pose| pose.to_degrees());
    let path_length = simulation.path_length();
    let mut table = Table::new(NumberFormat::Shortest)
        .column("seed", |(seed, _): &SampleRow| *seed)
        .columns(pose_columns("start"), move |_| start);
    // Only a body at the tip of another one has a start with roll.
    let roll = simulation.start().roll();
    if roll != 0.0 {
        table = table.column("start_roll_deg", move |_| roll.to_degrees());
    }
    table = table
        .columns(pose_columns("goal"), move |_| goal)
        .columns(pose_columns("final"), |(_, outcome)| outcome.arrival.final_pose.to_degrees())
        .column("layers", |(_, outcome)| outcome.grown.layers)
        .column("length_mm", |(_, outcome)| outcome.grown.length)
        .column("path_length_mm", move |_| path_length)
        .column("position_error_mm", |(_, outcome)| outcome.arrival.position_error_mm)
        .column("normalized_position_error", |(_, outcome)| outcome.arrival.normalized_position_error)
        // A vertical pose has no heading.
        .column("heading_error_deg", |(_, outcome)| outcome.arrival.heading_error_deg)
        .column("pitch_error_deg", |(_, outcome)| outcome.arrival.pitch_error_deg)
        .column("direction_error_deg", |(_, outcome)| outcome.arrival.direction_error_deg);
    if simulation.sag {
        table = table
            .column("sag_mm", |(_, outcome)| outcome.sag.map(|sag| sag.deflection))
            .column("root_stress_mpa", |(_, outcome)| outcome.sag.map(|sag| sag.root.stress))
            .column("root_moment_n_mm", |(_, outcome)| outcome.sag.map(|sag| sag.root.moment));
    }
    if simulation.scene.is_some() {
        // The contact is empty if the body touches nothing, and the pause if it does not pause.
        table = table
            .column("contact_at_mm", |(_, outcome)| outcome.obstacles?.contact.map(|contact| contact.at))
            .column("clearance_mm", |(_, outcome)| outcome.obstacles.map(|report| report.clearance))
            .column("detours", |(_, outcome)| outcome.obstacles.map(|report| f64::from(report.detours)))
            .column("paused_at_mm", |(_, outcome)| outcome.obstacles?.paused.map(|paused| paused.at));
    }
    // The disturbances are the same in every row.
    let (names, values): (Vec<_>, Vec<_>) = DisturbanceReport::of(simulation, 0).columns().into_iter().unzip();
    table.columns(names, move |_| values.clone())
}
