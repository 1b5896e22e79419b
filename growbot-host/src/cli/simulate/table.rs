//! Tables at the end of simulated growths.

use growbot_core::angle::degrees;
use growbot_core::pose::Pose;
use growbot_pictures::growth_table::{arrived, deviates, row};
use growbot_plan::figures::fixed;
use growbot_plan::plan_deviation::PlanDeviation;
use growbot_sim::simulation::campaign::{Campaign, ObstacleStatistics, WorstRun};
use growbot_sim::simulation::disturbance_report::DisturbanceReport;
use growbot_sim::simulation::obstacles::{ClearancePause, Contact, ObstacleReport};
use growbot_sim::simulation::statistics::Statistics;
use growbot_sim::simulation::{SagResult, Simulation, SimulationResult};

/// Returns the table of a growth: target and final pose, the error between them, and the body.
pub fn growth(
    goal: &Pose,
    outcome: &SimulationResult,
    deviation: Option<&PlanDeviation>,
    disturbances: &DisturbanceReport,
    seed: u64,
) -> String {
    let SimulationResult { grown, arrival, sag: hung, obstacles: among } = outcome;
    let mut table = arrived(goal, arrival);
    let pitch = arrival.pitch_error_deg;
    table += &match arrival.heading_error_deg {
        Some(heading) => format!("          {heading:.3} deg of heading, {pitch:.3} deg of pitch\n"),
        None => format!(
            "          {pitch:.3} deg of pitch; no heading error, because a vertical direction has no heading\n"
        ),
    };
    if let Some(estimate) = &grown.estimate {
        table += &row("estimate", &Pose::from_frame(&estimate.base_from_tip));
        table += &format!(
            "          1 sd {:.3} mm and {:.3} deg; estimated bias of growth {} %\n",
            estimate.position_sd,
            degrees(estimate.direction_sd),
            with_sign(100.0 * estimate.systematic_errors.growth)
        );
    }
    table += &format!("body      {} layers, {:.1} mm\n", grown.layers, grown.length);
    table += &deviation.map(deviates).unwrap_or_default();
    table += &hung.as_ref().map(hangs).unwrap_or_default();
    table += &among.as_ref().map(went).unwrap_or_default();
    table += &disturbances.describe();
    table + &format!("seed      {seed}, of a simulated growth\n")
}

fn hangs(hung: &SagResult) -> String {
    let SagResult { deflection, root } = hung;
    format!(
        "sag       {deflection:.3} mm; the root bears {:.3} MPa, {:.0} N mm, at {:.0} mm of body\n",
        root.stress, root.moment, root.length
    )
}

/// Returns the rows about a growth in a scene.
fn went(among: &ObstacleReport) -> String {
    let ObstacleReport { contact, clearance, detours, paused } = among;
    let mut text = match contact {
        Some(contact) => format!("scene     touches {}\n", place(contact)),
        None => format!("scene     the true body touches nothing; its clearance is {clearance:.2} mm\n"),
    };
    if *detours > 0 {
        text += &format!("          {detours} detours were taken to stay clear\n");
    }
    if let Some(ClearancePause { layers, at, clearance, deviation }) = paused {
        text += &format!(
            "          the growth pauses after {layers} layers, at {at:.1} mm: the next layers would be {clearance:.2} \
             mm clear, with an uncertainty of {deviation:.2} mm (3 sd)\n"
        );
    }
    text
}

/// Returns the obstacle and the place of a contact.
fn place(Contact { layer, at, point, obstacle }: &Contact) -> String {
    let obstacle = obstacle.map_or_else(|| "an obstacle".to_owned(), |obstacle| obstacle.to_string());
    format!("{obstacle} in layer {layer}, {at:.1} mm along, at {:.1}, {:.1}, {:.1}", point.x, point.y, point.z)
}

/// Returns the lines about many growths in a scene.
fn many(among: &ObstacleStatistics) -> String {
    let ObstacleStatistics { contacts, first_contact, clearance, with_detours, pauses } = among;
    let mut text = format!(
        "Scene: {contacts} growths touch an obstacle, {pauses} pause, {with_detours} take another path; min clearance \
         {clearance:.2} mm.\n"
    );
    if let Some((seed, contact)) = first_contact {
        text += &format!("First contact: --seed {seed}, {}.\n", place(contact));
    }
    text
}

/// Returns the table with the errors of many growths.
pub fn campaign(campaign: &Campaign, robot: &str, simulation: &Simulation, seed: u64) -> String {
    let path_length = simulation.path_length();
    let last = seed.wrapping_add(campaign.runs - 1);
    let mut table = format!(
        "{} simulated growths of {robot}, {:.0} layers, {path_length:.1} mm, seeds {seed} to {last}\n{}\n",
        campaign.runs,
        campaign.layers.mean(),
        DisturbanceReport::of(simulation, seed).describe()
    );
    table +=
        &format!("{:<17}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}\n", "error", "mean", "SD", "min", "median", "95 %", "max");
    table += &line("position, mm", &campaign.position_error_mm, 1.0);
    table += &line("  % of the path", &campaign.normalized_position_error, 100.0);
    table += &line("direction, deg", &campaign.direction_error_deg, 1.0);
    table += &line("heading, deg", &campaign.heading_error_deg, 1.0);
    table += &line("pitch, deg", &campaign.pitch_error_deg, 1.0);
    table += &format!("\nMedian and 95 %: exact to {} %", 100.0 * Statistics::RESOLUTION);
    if let Some(WorstRun { seed, .. }) = campaign.farthest {
        table += &format!("; the max position error is that of --seed {seed}");
    }
    table += ".\n";
    table += &campaign.among.as_ref().map(many).unwrap_or_default();
    table + &campaign.hung.as_ref().map(|hung| format!("Max: {}", hangs(hung))).unwrap_or_default()
}

/// Formats a number to hundredths, with its sign. The sign of 0 is +.
fn with_sign(number: f64) -> String {
    let text = fixed(number, 2);
    if text.starts_with('-') { text } else { format!("+{text}") }
}

/// Returns the row of one error: its statistics, multiplied by `scale`. Without growths the row has no numbers.
fn line(name: &str, statistics: &Statistics, scale: f64) -> String {
    let values = [
        statistics.mean(),
        statistics.deviation(),
        statistics.min(),
        statistics.percentile(50.0),
        statistics.percentile(95.0),
        statistics.max(),
    ];
    let text = |value: &f64| if statistics.is_empty() { "-".to_owned() } else { readable(scale * value) };
    let columns: String = values.iter().map(|value| format!("{:>10}", text(value))).collect();
    format!("{name:<17}{columns}\n")
}

/// Limit below which a number is a rounding error and counts as 0.
const ROUNDING: f64 = 1e-9;

/// Formats a number with about four digits, in nine columns.
fn readable(value: f64) -> String {
    if value.abs() < ROUNDING {
        "0".to_owned()
    } else if !(1e-3..1e6).contains(&value) {
        format!("{value:.2e}")
    } else if value < 10.0 {
        format!("{value:.4}")
    } else {
        format!("{value:.2}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_magnitude_fit_their_column() {
        for (value, text) in [
            (0.0, "0"),
            (1.234_56e-17, "0"),
            (-6e-14, "0"),
            (1.234_56e-7, "1.23e-7"),
            (0.000_999_9, "1.00e-3"),
            (0.012_345, "0.0123"),
            (9.876_54, "9.8765"),
            (123.456, "123.46"),
            (999_999.99, "999999.99"),
            (1.5e7, "1.50e7"),
            (1e300, "1.00e300"),
        ] {
            assert_eq!(readable(value), text);
            assert!(text.len() <= 9);
        }
    }
}
