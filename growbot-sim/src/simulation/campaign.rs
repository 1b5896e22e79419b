//! The same growth with many seeds, on all cores, in a memory that does not grow with their number.

use std::convert::Infallible;

use super::among::{Among, Contact};
use super::statistics::Statistics;
use super::{Hung, Outcome, Simulation};
use crate::parallel;

/// Growths whose outcomes are stored at a time.
const BATCH: u64 = 16_384;

/// The growth that ended farthest from the goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Farthest {
    /// Its seed.
    pub seed: u64,
    /// How far from the goal it ended, mm.
    pub position_error_mm: f64,
}

/// What became of many growths among the obstacles of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManyAmong {
    /// Growths whose true body touches an obstacle.
    pub contacts: u64,
    /// The first of them: its seed, and where it does.
    pub first_contact: Option<(u64, Contact)>,
    /// The least clearance of all, mm.
    pub clearance: f64,
    /// Growths that took another path.
    pub with_detours: u64,
    /// Growths that paused.
    pub pauses: u64,
}

impl ManyAmong {
    fn add(&mut self, seed: u64, among: &Among) {
        self.contacts += u64::from(among.contact.is_some());
        self.first_contact = self.first_contact.or(among.contact.map(|contact| (seed, contact)));
        self.clearance = self.clearance.min(among.clearance);
        self.with_detours += u64::from(among.detours > 0);
        self.pauses += u64::from(among.paused.is_some());
    }
}

/// What many growths came to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Campaign {
    /// How many.
    pub runs: u64,
    /// Layers laid.
    pub layers: Statistics,
    /// Distance from the goal, mm.
    pub position_error_mm: Statistics,
    /// That, over the length of the planned path.
    pub normalized_position_error: Statistics,
    /// Difference of the headings, degrees, of the growths that have one; of none where the goal is vertical.
    pub heading_error_deg: Statistics,
    /// Difference of the pitches, degrees.
    pub pitch_error_deg: Statistics,
    /// Angle between the directions, degrees.
    pub direction_error_deg: Statistics,
    /// The growth that ended farthest from the goal.
    pub farthest: Option<Farthest>,
    /// Of bodies that hang: the max sag, and the max stress of a root, each of the body that has it.
    pub hung: Option<Hung>,
    /// Of growths in a scene: what became of them there.
    pub among: Option<ManyAmong>,
}

impl Campaign {
    /// Grows `runs` times, with the seeds from `seed` on. `at` is called with the number that is done. The result does
    /// not depend on the number of threads: outcomes are added in the order of the seeds.
    pub fn run(simulation: &Simulation, seed: u64, runs: u64, threads: usize, at: impl FnMut(u64)) -> Self {
        Self::run_each(simulation, seed, runs, threads, at, |_, _| Ok::<(), Infallible>(()))
            .unwrap_or_else(|never| match never {})
    }

    /// As [`Self::run`]; `each` is called with every seed and its outcome, in the order of the seeds.
    ///
    /// # Errors
    /// The first of `each`: no more is grown then.
    pub fn run_each<E>(
        simulation: &Simulation,
        seed: u64,
        runs: u64,
        threads: usize,
        mut at: impl FnMut(u64),
        mut each: impl FnMut(u64, &Outcome) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut campaign = Self::default();
        while campaign.runs < runs {
            let done = campaign.runs;
            let seeds: Vec<u64> = (done..runs.min(done + BATCH)).map(|run| seed.wrapping_add(run)).collect();
            let grown: Vec<Outcome> =
                parallel::map_on(threads, &seeds, |seed| simulation.run(*seed), |more| at(done + more as u64));
            for (seed, outcome) in seeds.iter().zip(&grown) {
                each(*seed, outcome)?;
                campaign.add(*seed, outcome);
            }
        }
        Ok(campaign)
    }

    fn add(&mut self, seed: u64, outcome: &Outcome) {
        let Outcome { grown, arrival, hung, among } = outcome;
        self.runs += 1;
        self.layers.add(grown.layers as f64);
        self.position_error_mm.add(arrival.position_error_mm);
        self.normalized_position_error.add(arrival.normalized_position_error);
        if let Some(heading) = arrival.heading_error_deg {
            self.heading_error_deg.add(heading);
        }
        self.pitch_error_deg.add(arrival.pitch_error_deg);
        self.direction_error_deg.add(arrival.direction_error_deg);
        let position_error_mm = arrival.position_error_mm;
        if self.farthest.is_none_or(|farthest| position_error_mm > farthest.position_error_mm) {
            self.farthest = Some(Farthest { seed, position_error_mm });
        }
        if let Some(among) = among {
            let none =
                ManyAmong { contacts: 0, first_contact: None, clearance: f64::INFINITY, with_detours: 0, pauses: 0 };
            self.among.get_or_insert(none).add(seed, among);
        }
        if let Some(hung) = *hung {
            let max = self.hung.get_or_insert(hung);
            max.deflection = max.deflection.max(hung.deflection);
            if hung.root.stress > max.root.stress {
                max.root = hung.root;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_client::plan::Plan;
    use growbot_client::pose_text::parse_pose;
    use growbot_client::robot_file;
    use growbot_core::plan::Planner;
    use growbot_core::slicing::Slicing;

    #[test]
    fn threads_do_not_show_and_each_run_can_be_had_alone() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,20,50,90,80").unwrap());
        let plan = Plan::make(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap();
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        simulation.disturbance.growth_noise = 0.1;
        simulation.sag = true;
        // More than a batch.
        let runs = BATCH + 100;
        let one = Campaign::run(&simulation, 7, runs, 1, |_| ());
        assert_eq!(one, Campaign::run(&simulation, 7, runs, 3, |_| ()));
        assert_eq!(one.runs, runs);
        let Farthest { seed, position_error_mm } = one.farthest.unwrap();
        assert_eq!(simulation.run(seed).arrival.position_error_mm, position_error_mm);
        assert_eq!(one.position_error_mm.max(), position_error_mm);
        assert_ne!(one, Campaign::run(&simulation, 8, runs, 1, |_| ()));
        assert_eq!(Campaign::run(&simulation, 7, 0, 1, |_| ()).runs, 0);
    }
}
