//! The table at the end of a growth.

use growbot_core::angle::degrees;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::arrival::{Arrival, PoseDifference};
use growbot_plan::feedback::FeedbackReport;
use growbot_plan::figures::fixed;
use growbot_plan::growth_report::{GrowthReport, MeasuredBy};
use growbot_plan::plan::Plan;
use growbot_plan::plan_deviation::{BodyClearance, PlanDeviation};
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, InterruptedLayerJson};

use crate::duration::duration_text;

/// Returns the table: target and final pose, the error between them and, with feedback, the estimate.
pub fn table(plan: &Plan, robot: &Robot, grown: &GrowthReport, result: &GrowthResult) -> String {
    let GrowthResult { seed, simulated, plan_deviation, scene, .. } = result;
    let length = grown.length_mm();
    let mut table = arrived(&plan.goal, &grown.arrival);
    table += &format!("body      {} layers of {}, {length:.1} mm\n", grown.body.len(), plan.requirements.layers);
    table += &format!(
        "growth    {} on {}{}, {:.2} m of filament\n",
        duration_text(grown.duration_s),
        RobotKind::from(*simulated).prefix(),
        robot.name(),
        grown.filament_mm / 1000.0
    );
    if let Some(seed) = seed {
        table += &format!("seed      {seed}\n");
    }
    if let Some(fed_back) = &grown.feedback {
        table += &feedback(plan, grown, fed_back);
    }
    table += &plan_deviation.as_ref().map(deviates).unwrap_or_default();
    if let Some(BodyClearance { clearance_mm, obstacle, contact, .. }) = scene {
        table += &match contact {
            true => format!("scene     touches {obstacle}, {:.2} mm deep\n", -clearance_mm),
            false => format!("scene     {clearance_mm:.2} mm clear of everything, as built\n"),
        };
    }
    if grown.unknown_layers() > 0 {
        table += &format!(
            "caution   {} layers were interrupted and kept as they are; this result counts them as planned\n",
            grown.unknown_layers()
        );
    }
    if let Some(interrupted) = grown.interrupted {
        let layer = InterruptedLayerJson::new(grown.as_built.len(), interrupted);
        table += &format!("layer     {} was interrupted: {}\n", layer.layer, made(&layer));
    }
    table
}

/// Returns the row with the greatest distance of a body from its plan.
pub fn deviates(PlanDeviation { max_mm, at_mm, .. }: &PlanDeviation) -> String {
    format!("plan      the body lies up to {max_mm:.3} mm from its plan, {at_mm:.0} mm along\n")
}

/// Returns the rows with target and final pose, and the error between them.
pub fn arrived(goal: &Pose, arrival: &Arrival) -> String {
    let mut table =
        format!("{:<10}{:>11}{:>11}{:>11}{:>13}{:>12}\n", "", "x mm", "y mm", "z mm", "heading deg", "pitch deg");
    table += &row("target", goal);
    table += &row("final", &arrival.final_pose);
    table += &format!(
        "error     {:.3} mm, {:.4} % of the length, {:.3} deg between the directions\n",
        arrival.position_error_mm,
        100.0 * arrival.normalized_position_error,
        arrival.direction_error_deg
    );
    table
}

/// Returns the row of a pose, in the columns of [`arrived`]. A vertical pose has no heading.
pub fn row(name: &str, pose: &Pose) -> String {
    let [x, y, z, heading, pitch] = pose.to_degrees().map(|number| fixed(number, 3));
    let heading = if pose.is_vertical() { "-" } else { &heading };
    format!("{name:<10}{x:>11}{y:>11}{z:>11}{heading:>13}{pitch:>12}\n")
}

/// Returns the rows about feedback: the number of amendments, and the accuracy of the estimate.
fn feedback(plan: &Plan, grown: &GrowthReport, fed_back: &FeedbackReport) -> String {
    let estimate = &fed_back.estimate;
    let arrived = match grown.measured_by {
        MeasuredBy::Tip => {
            let PoseDifference { position_mm, direction_deg } = fed_back.arrival(plan).difference_from(&grown.arrival);
            format!("estimate  {position_mm:.3} mm and {direction_deg:.3} deg from where the tip is\n")
        }
        MeasuredBy::Estimate | MeasuredBy::Steps => "final     estimated from the sensors, not measured\n".to_string(),
    };
    let (position, direction) = (estimate.position_sd, degrees(estimate.direction_sd));
    format!(
        "feedback  {} amendments\n{arrived}1 sd      {position:.3} mm and {direction:.3} deg, of the estimate\n",
        fed_back.amendments
    )
}

/// Returns a text about the finished part of an interrupted layer.
pub fn made(cut: &InterruptedLayerJson) -> String {
    let degrees = |share: f64| share * 360.0;
    if (cut.min, cut.max) == (0.0, 1.0) {
        "it is unknown how much of this layer was made".to_string()
    } else {
        format!(
            "at least {:.1} and at most {:.1} of the 360 degrees of this layer were made",
            degrees(cut.min),
            degrees(cut.max)
        )
    }
}
