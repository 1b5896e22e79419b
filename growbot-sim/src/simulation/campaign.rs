//! Repetition of a growth with many seeds, on all cores, with memory that does not depend on their number.
//!
//! Growth k has the seed N + k, so that any growth can be repeated alone, above all the worst. Random numbers are
//! derived from a hash of the seed, so growths with neighbouring seeds are unrelated. Campaigns from N and N + 1 share
//! all growths but one. Outcomes are stored 16,384 at a time, so 3,000,000 growths take as much memory as 100,000: 14
//! MB.

use std::cmp::Reverse;
use std::convert::Infallible;

use growbot_plan::parallel;
use serde::{Deserialize, Serialize};

use super::obstacles::{Contact, ObstacleReport};
use super::statistics::Statistics;
use super::{SagResult, Simulation, SimulationResult};

/// Number of growths whose outcomes are stored at a time.
const BATCH: u64 = 16_384;

/// The growth that ended farthest from the goal. If several growths ended equally far, this is the growth with the
/// smallest seed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WorstRun {
    /// Seed of the growth.
    pub seed: u64,
    /// Distance of the body's end from the goal, mm.
    pub position_error_mm: f64,
}

/// Results of many growths among the obstacles of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleStatistics {
    /// Number of growths whose true body touches an obstacle.
    pub contacts: u64,
    /// Seed of the first growth that touches an obstacle, and its contact.
    pub first_contact: Option<(u64, Contact)>,
    /// Minimum distance between the outside of the tube and the obstacles over all growths, mm.
    pub clearance: f64,
    /// Number of growths with detours.
    pub with_detours: u64,
    /// Number of growths that paused because they came too near to an obstacle.
    pub pauses: u64,
}

impl ObstacleStatistics {
    /// Creates the statistics of a single growth from its obstacle report.
    fn of(seed: u64, among: &ObstacleReport) -> Self {
        Self {
            contacts: u64::from(among.contact.is_some()),
            first_contact: among.contact.map(|contact| (seed, contact)),
            clearance: among.clearance,
            with_detours: u64::from(among.detours > 0),
            pauses: u64::from(among.paused.is_some()),
        }
    }

    fn merge(&mut self, other: &Self) {
        self.contacts += other.contacts;
        let contacts = [self.first_contact, other.first_contact];
        self.first_contact = contacts.into_iter().flatten().min_by_key(|(seed, _)| *seed);
        self.clearance = self.clearance.min(other.clearance);
        self.with_detours += other.with_detours;
        self.pauses += other.pauses;
    }
}

/// Statistics over many simulated growths. The result does not depend on the order in which runs are added or merged.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Campaign {
    /// Number of growths.
    pub runs: u64,
    /// Number of laid layers of each growth.
    pub layers: Statistics,
    /// Distance of the body's end from the goal, mm.
    pub position_error_mm: Statistics,
    /// Distance of the body's end from the goal, divided by the length of the planned path.
    pub normalized_position_error: Statistics,
    /// Difference between the headings of the body's end and the goal, degrees. Growths that end vertically are not
    /// counted. Empty if the goal is vertical.
    pub heading_error_deg: Statistics,
    /// Difference between the pitches of the body's end and the goal, degrees.
    pub pitch_error_deg: Statistics,
    /// Angle between the directions of the body's end and the goal, degrees.
    pub direction_error_deg: Statistics,
    /// The growth that ended farthest from the goal.
    pub farthest: Option<WorstRun>,
    /// Maximum sag, and maximum stress at the root of a body, over all growths. The two maxima may belong to different
    /// bodies. `None` if sag is not simulated.
    pub hung: Option<SagResult>,
    /// Results among the obstacles of a scene. `None` without a scene.
    #[serde(skip)]
    pub among: Option<ObstacleStatistics>,
}

impl Campaign {
    /// Simulates `runs` growths with consecutive seeds from `seed` on. Calls `at` with the number of finished growths.
    /// The result does not depend on the number of threads.
    pub fn run(simulation: &Simulation, seed: u64, runs: u64, threads: usize, at: impl FnMut(u64)) -> Self {
        Self::run_each(simulation, seed, runs, threads, at, |_, _| Ok::<(), Infallible>(()))
            .unwrap_or_else(|never| match never {})
    }

    /// Like [`Self::run`], but calls `each` with every seed and its outcome, in the order of the seeds.
    ///
    /// # Errors
    /// The first error of `each`, after which no further growth is simulated.
    pub fn run_each<E>(
        simulation: &Simulation,
        seed: u64,
        runs: u64,
        threads: usize,
        mut at: impl FnMut(u64),
        mut each: impl FnMut(u64, &SimulationResult) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut campaign = Self::default();
        while campaign.runs < runs {
            let done = campaign.runs;
            let seeds: Vec<u64> = (done..runs.min(done + BATCH)).map(|run| seed.wrapping_add(run)).collect();
            let grown: Vec<SimulationResult> =
                parallel::map_on(threads, &seeds, |seed| simulation.run(*seed), |more| at(done + more as u64));
            for (seed, outcome) in seeds.iter().zip(&grown) {
                each(*seed, outcome)?;
                campaign.add(*seed, outcome);
            }
        }
        Ok(campaign)
    }

    /// Adds the outcome of a growth with this seed.
    pub fn add(&mut self, seed: u64, outcome: &SimulationResult) {
        let SimulationResult { grown, arrival, sag: hung, obstacles: among } = outcome;
        self.runs += 1;
        self.layers.add(grown.layers as f64);
        self.position_error_mm.add(arrival.position_error_mm);
        self.normalized_position_error.add(arrival.normalized_position_error);
        if let Some(heading) = arrival.heading_error_deg {
            self.heading_error_deg.add(heading);
        }
        self.pitch_error_deg.add(arrival.pitch_error_deg);
        self.direction_error_deg.add(arrival.direction_error_deg);
        self.add_farthest(WorstRun { seed, position_error_mm: arrival.position_error_mm });
        if let Some(hung) = hung {
            self.add_hung(hung);
        }
        if let Some(among) = among {
            self.add_among(&ObstacleStatistics::of(seed, among));
        }
    }

    /// Adds the results of other growths. The result is the same, to the bit, in any order and grouping.
    pub fn merge(&mut self, other: &Self) {
        self.runs += other.runs;
        self.layers.merge(&other.layers);
        self.position_error_mm.merge(&other.position_error_mm);
        self.normalized_position_error.merge(&other.normalized_position_error);
        self.heading_error_deg.merge(&other.heading_error_deg);
        self.pitch_error_deg.merge(&other.pitch_error_deg);
        self.direction_error_deg.merge(&other.direction_error_deg);
        other.farthest.into_iter().for_each(|farthest| self.add_farthest(farthest));
        other.hung.iter().for_each(|hung| self.add_hung(hung));
        other.among.iter().for_each(|among| self.add_among(among));
    }

    fn add_farthest(&mut self, one: WorstRun) {
        let key = |farthest: &WorstRun| (farthest.position_error_mm, Reverse(farthest.seed));
        if self.farthest.is_none_or(|farthest| key(&one) > key(&farthest)) {
            self.farthest = Some(one);
        }
    }

    fn add_among(&mut self, other: &ObstacleStatistics) {
        match &mut self.among {
            Some(among) => among.merge(other),
            none => *none = Some(*other),
        }
    }

    fn add_hung(&mut self, hung: &SagResult) {
        let max = self.hung.get_or_insert(*hung);
        max.deflection = max.deflection.max(hung.deflection);
        let key = |hung: &SagResult| [hung.root.stress, hung.root.moment, hung.root.length];
        if key(hung) > key(max) {
            max.root = hung.root;
        }
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_core::slicing::Slicing;
    use growbot_plan::plan::Plan;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;

    use super::*;

    #[test]
    fn results_do_not_depend_on_threads_and_runs_can_be_repeated_alone() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,20,50,90,80").unwrap());
        let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap();
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        simulation.disturbance.growth_noise = 0.1;
        simulation.sag = true;
        // This is more than a batch.
        let runs = BATCH + 100;
        let one = Campaign::run(&simulation, 7, runs, 1, |_| ());
        assert_eq!(one, Campaign::run(&simulation, 7, runs, 3, |_| ()));
        assert_eq!(one.runs, runs);
        let WorstRun { seed, position_error_mm } = one.farthest.unwrap();
        assert_eq!(simulation.run(seed).arrival.position_error_mm, position_error_mm);
        assert_eq!(one.position_error_mm.max(), position_error_mm);
        let [seven, eight] = [7, 8].map(|seed| Campaign::run(&simulation, seed, 100, 1, |_| ()));
        assert_ne!(seven, eight);
        assert_eq!(Campaign::run(&simulation, 7, 0, 1, |_| ()).runs, 0);
        let [mut head, tail] =
            [(7, 5000), (5007, runs - 5000)].map(|(seed, runs)| Campaign::run(&simulation, seed, runs, 2, |_| ()));
        let mut backwards = tail.clone();
        backwards.merge(&head);
        head.merge(&tail);
        assert_eq!((&head, &backwards), (&one, &one));
    }
}
