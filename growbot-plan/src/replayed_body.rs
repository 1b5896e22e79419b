//! The body that is rebuilt from a run log.

use growbot_core::angle::degrees;
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::decode;

use crate::arrival::Arrival;
use crate::degrees::degrees_below_turn;
use crate::feedback::FeedbackReport;
use crate::growth_report::{MeasuredBy, as_built_hash};
use crate::plan::Plan;
use crate::plan_file::PlanFileError;
use crate::run_log::{ArrivalJson, FeedbackResult, GrowthResult, RecordedRun};
use crate::table::{NumberFormat, Table};

/// The body that is rebuilt from a run log.
pub struct ReplayedBody<'a> {
    /// Run log of the body.
    pub record: &'a RecordedRun,
    /// Layers that follow from the steps of the board's motors.
    pub commanded: Vec<Layer>,
    /// Layers of the plastic of a simulated tip. `None` if the log does not contain them.
    pub simulated: Option<Vec<Layer>>,
}

/// Final poses of the body.
pub struct Arrivals {
    /// Final pose of the body: as laid on a simulated tip, or else as commanded.
    pub body: Arrival,
    /// Final pose of the commanded body. `None` if the log does not contain the layers as laid on a simulated tip.
    pub commanded: Option<Arrival>,
}

/// Result of feedback, and the plan that it followed.
pub struct ReplayedFeedback {
    /// Result of feedback.
    pub fed_back: FeedbackReport,
    /// Plan that the growth followed.
    pub plan: Plan,
}

impl<'a> ReplayedBody<'a> {
    /// Rebuilds the body of a run log.
    pub fn of(record: &'a RecordedRun) -> Self {
        let commanded = record.commanded().map(|layer| decode(&layer)).collect();
        Self { record, commanded, simulated: record.simulated() }
    }

    /// Returns the layers: as laid on a simulated tip, or else as commanded.
    pub fn body(&self) -> &[Layer] {
        self.simulated.as_ref().unwrap_or(&self.commanded)
    }

    /// Returns the length of the body, mm.
    pub fn length_mm(&self) -> f64 {
        self.body().iter().fold(0.0, |length, layer| length + layer.height)
    }

    /// Returns the final poses.
    ///
    /// # Errors
    /// If start or goal of the log is not a valid pose.
    pub fn arrivals(&self) -> Result<Arrivals, PlanFileError> {
        let (start, goal) = self.record.start_and_goal()?;
        let path_length = self.record.plan.length_mm;
        let end_of = |body: &[Layer]| Arrival::of(&grow(&start.frame(), body.iter().copied()), &goal, path_length);
        let commanded = self.simulated.is_some().then(|| end_of(&self.commanded));
        Ok(Arrivals { body: end_of(self.body()), commanded })
    }

    /// Returns the result of the growth. Pose, layers and length are those of the rebuilt body, and the rest is from
    /// the result in the log.
    pub fn result(&self, arrivals: &Arrivals, feedback: Option<&ReplayedFeedback>) -> GrowthResult {
        let record = self.record;
        let logged = record.result.as_ref();
        GrowthResult {
            outcome: record.outcome(),
            simulated: record.is_simulated(),
            error: logged.and_then(|logged| logged.error.clone()),
            refusal: None,
            fault: logged.and_then(|logged| logged.fault.clone()),
            clock_drift: record.clock_drift(),
            arrival: Some((&arrivals.body).into()),
            layers: self.body().len(),
            length_mm: self.length_mm(),
            seed: logged.and_then(|logged| logged.seed),
            measured_by: Some(if self.simulated.is_some() { MeasuredBy::Tip } else { MeasuredBy::Steps }),
            feedback: feedback.map(|feedback| FeedbackResult::new(&feedback.fed_back, &feedback.plan, None)),
            plan_deviation: logged.and_then(|logged| logged.plan_deviation),
            scene: logged.and_then(|logged| logged.scene.clone()),
            warnings: logged.map_or_else(Vec::new, |logged| logged.warnings.clone()),
            duration_s: logged.and_then(|logged| logged.duration_s),
            filament_mm: logged.and_then(|logged| logged.filament_mm),
            plan_id: Some(record.plan_id),
            as_built_hash: Some(as_built_hash(&record.as_built)),
            unknown_layers: record.unknown_layers(),
            interrupted: logged.and_then(|logged| logged.interrupted),
            commanded: arrivals.commanded.as_ref().map(ArrivalJson::from),
            skipped_lines: Some(record.damage.lines),
            log_lines_missing: logged.and_then(|logged| logged.log_lines_missing),
        }
    }

    /// Returns the layers as CSV. On a simulated tip, the commanded layers are beside them.
    pub fn layers_table(&self) -> String {
        let values = |layer: &Layer| [degrees_below_turn(layer.alpha), layer.height, degrees(layer.tilt)];
        let mut table = Table::new(NumberFormat::Plain)
            .column("layer", |(index, _): &(usize, &Layer)| *index)
            .columns(["alpha_deg", "height_mm", "tilt_deg"], move |(_, layer)| values(layer));
        if self.simulated.is_some() {
            let names = ["commanded_alpha_deg", "commanded_height_mm", "commanded_tilt_deg"];
            // The layer under way was not finished, so it has no commanded values.
            table = table.columns(names, move |(index, _)| {
                let values = self.commanded.get(*index).map(values);
                [0, 1, 2].map(|column| values.map(|values| values[column]))
            });
        }
        table.csv(self.body().iter().enumerate())
    }
}
