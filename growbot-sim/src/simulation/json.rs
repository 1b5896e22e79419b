//! Simulated growths as JSON for scripts.

use super::campaign::{Campaign, ObstacleStatistics};
use super::obstacles::{ClearancePause, Contact, ObstacleReport};
use super::statistics::Statistics;
use super::{SagResult, Simulation, SimulationResult};
use growbot_core::angle::degrees;
use growbot_core::pose::Pose;
use growbot_core::tracking::Estimate;
use growbot_plan::plan_deviation::PlanDeviation;
use growbot_plan::plan_file::TipPoseJson;
use growbot_plan::run_log::ArrivalJson;
use serde::Serialize;

use super::disturbance_report::DisturbanceReport;

/// A growth as JSON for scripts.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SimulatedGrowth {
    #[serde(flatten)]
    arrival: ArrivalJson,
    /// Number of layers.
    layers: u64,
    /// Length of the body, mm.
    length_mm: f64,
    /// Length of the planned path, mm.
    path_length_mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    feedback: Option<EstimateJson>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sag: Option<SagJson>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<SceneResultJson>,
    /// Deviation of the body from its plan. Null for a body of more than a million layers.
    plan_deviation: Option<PlanDeviation>,
    disturbances: DisturbanceReport,
    /// Seed of the random numbers.
    seed: u64,
}

impl SimulatedGrowth {
    /// Returns the JSON of this growth, with this seed.
    pub fn new(
        outcome: &SimulationResult,
        plan_deviation: Option<PlanDeviation>,
        simulation: &Simulation,
        seed: u64,
    ) -> Self {
        let SimulationResult { grown, arrival, sag: hung, obstacles: among } = outcome;
        Self {
            arrival: arrival.into(),
            layers: grown.layers,
            length_mm: grown.length,
            path_length_mm: simulation.path_length(),
            disturbances: DisturbanceReport::of(simulation, seed),
            seed,
            feedback: grown.estimate.as_ref().map(EstimateJson::from),
            sag: hung.as_ref().map(SagJson::from),
            scene: among.as_ref().map(SceneResultJson::from),
            plan_deviation,
        }
    }
}

/// Estimate of feedback.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct EstimateJson {
    estimate: TipPoseJson,
    /// Standard deviation of the estimated position, mm.
    position_sd_mm: f64,
    /// Standard deviation of the estimated direction, degrees.
    direction_sd_deg: f64,
    /// Systematic error of the growth of layers, percent.
    growth_bias_percent: f64,
    /// Systematic error of the tilt of layers, percent.
    tilt_bias_percent: f64,
    /// Systematic error of the deposition angle, degrees.
    alpha_bias_deg: f64,
    /// Systematic twist of a layer, degrees.
    twist_bias_deg: f64,
}

impl From<&Estimate> for EstimateJson {
    fn from(estimate: &Estimate) -> Self {
        let bias = &estimate.systematic_errors;
        Self {
            estimate: TipPoseJson::from(&Pose::from_frame(&estimate.base_from_tip)),
            position_sd_mm: estimate.position_sd,
            direction_sd_deg: degrees(estimate.direction_sd),
            growth_bias_percent: 100.0 * bias.growth,
            tilt_bias_percent: 100.0 * bias.tilt,
            alpha_bias_deg: degrees(bias.alpha),
            twist_bias_deg: degrees(bias.twist),
        }
    }
}

/// Many growths as JSON for scripts.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SimulatedCampaign {
    /// Number of growths.
    repeat: u64,
    /// Seed of the first growth. Each later growth has the next seed.
    seed: u64,
    /// Length of the planned path, mm.
    path_length_mm: f64,
    layers: StatisticsJson,
    position_error_mm: StatisticsJson,
    normalized_position_error: StatisticsJson,
    /// Statistics of the heading errors, degrees. Null if no growth has a heading error.
    heading_error_deg: Option<StatisticsJson>,
    pitch_error_deg: StatisticsJson,
    direction_error_deg: StatisticsJson,
    /// Seed of the growth with the greatest position error.
    worst_seed: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max_sag: Option<SagJson>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<RepeatedContactsJson>,
    disturbances: DisturbanceReport,
}

impl SimulatedCampaign {
    /// Returns the JSON of these growths. `seed` is the seed of the first growth, and each later growth has the next
    /// seed.
    pub fn new(campaign: &Campaign, simulation: &Simulation, seed: u64) -> Self {
        Self {
            repeat: campaign.runs,
            seed,
            path_length_mm: simulation.path_length(),
            layers: (&campaign.layers).into(),
            position_error_mm: (&campaign.position_error_mm).into(),
            normalized_position_error: (&campaign.normalized_position_error).into(),
            heading_error_deg: Some(&campaign.heading_error_deg).filter(|errors| !errors.is_empty()).map(Into::into),
            pitch_error_deg: (&campaign.pitch_error_deg).into(),
            direction_error_deg: (&campaign.direction_error_deg).into(),
            worst_seed: campaign.farthest.map(|farthest| farthest.seed),
            max_sag: campaign.hung.as_ref().map(SagJson::from),
            scene: campaign.among.as_ref().map(RepeatedContactsJson::from),
            disturbances: DisturbanceReport::of(simulation, seed),
        }
    }
}

/// The distribution of an error.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct StatisticsJson {
    mean: f64,
    /// Standard deviation.
    sd: f64,
    min: f64,
    /// Median.
    p50: f64,
    /// 95th percentile.
    p95: f64,
    max: f64,
}

impl From<&Statistics> for StatisticsJson {
    fn from(statistics: &Statistics) -> Self {
        Self {
            mean: statistics.mean(),
            sd: statistics.deviation(),
            min: statistics.min(),
            p50: statistics.percentile(50.0),
            p95: statistics.percentile(95.0),
            max: statistics.max(),
        }
    }
}

/// Sag of a body under its weight.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct SagJson {
    /// Deflection of the tip, mm.
    deflection_mm: f64,
    /// Stress at the base, MPa.
    root_stress_mpa: f64,
    /// Bending moment at the base, N mm.
    root_moment_n_mm: f64,
}

impl From<&SagResult> for SagJson {
    fn from(hung: &SagResult) -> Self {
        Self { deflection_mm: hung.deflection, root_stress_mpa: hung.root.stress, root_moment_n_mm: hung.root.moment }
    }
}

/// First contact of a body with an obstacle.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct ContactJson {
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    /// Index of the layer.
    layer: u64,
    /// Distance from the base along the body, mm.
    at_mm: f64,
    /// Point of the contact, mm.
    point_mm: [f64; 3],
    obstacle: Option<String>,
}

impl ContactJson {
    fn new(contact: &Contact, seed: Option<u64>) -> Self {
        let Contact { layer, at, point, obstacle } = contact;
        let obstacle = obstacle.map(|obstacle| obstacle.to_string());
        Self { seed, layer: *layer, at_mm: *at, point_mm: (*point).into(), obstacle }
    }
}

/// Place at which a growth paused.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct PauseJson {
    /// Number of finished layers.
    layers: u64,
    /// Distance from the base along the body, mm.
    at_mm: f64,
    /// Clearance of the rest of the path, mm.
    clearance_mm: f64,
    /// Deviation of the tip from the plan, mm.
    deviation_mm: f64,
}

/// Result of a growth in a scene.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct SceneResultJson {
    /// First contact of the body with an obstacle. Null if it touches none.
    contact: Option<ContactJson>,
    /// Smallest clearance of the body, mm. Negative inside an obstacle.
    clearance_mm: f64,
    /// Number of detours that replaced corrections.
    detours: u32,
    /// Place at which the growth paused. Null if it did not pause.
    paused: Option<PauseJson>,
}

impl From<&ObstacleReport> for SceneResultJson {
    fn from(ObstacleReport { contact, clearance, detours, paused }: &ObstacleReport) -> Self {
        let pause = |&ClearancePause { layers, at, clearance, deviation }: &ClearancePause| PauseJson {
            layers,
            at_mm: at,
            clearance_mm: clearance,
            deviation_mm: deviation,
        };
        Self {
            contact: contact.as_ref().map(|contact| ContactJson::new(contact, None)),
            clearance_mm: *clearance,
            detours: *detours,
            paused: paused.as_ref().map(pause),
        }
    }
}

/// Results of many growths in a scene.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct RepeatedContactsJson {
    /// Number of growths that touch an obstacle.
    contacts: u64,
    /// Contact of the first growth that touches an obstacle. Null if none does.
    first_contact: Option<ContactJson>,
    /// Smallest clearance of all bodies, mm.
    min_clearance_mm: f64,
    /// Number of growths with detours.
    with_detours: u64,
    /// Number of growths that paused.
    pauses: u64,
}

impl From<&ObstacleStatistics> for RepeatedContactsJson {
    fn from(
        ObstacleStatistics { contacts, first_contact, clearance, with_detours, pauses }: &ObstacleStatistics,
    ) -> Self {
        Self {
            contacts: *contacts,
            first_contact: first_contact.as_ref().map(|(seed, contact)| ContactJson::new(contact, Some(*seed))),
            min_clearance_mm: *clearance,
            with_detours: *with_detours,
            pauses: *pauses,
        }
    }
}
