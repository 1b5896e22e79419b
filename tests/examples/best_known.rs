//! Makes `tests/best_known.csv`, the table of the shortest known lengths. The same arguments produce the same table.
//!
//! ```text
//! cargo run --release -p growbot-tests --example best_known -- DATE SEED PASSES COUNT... \
//!     > tests/best_known.csv
//! ```
//!
//! DATE goes into the comments of the table. Each COUNT is the number of cases of a stratum, in the order of
//! `Stratum::ALL`. Every case is searched PASSES times with different random numbers, and the shortest curve is taken.
//! Improvements by each pass go to the standard error, and into the comments of the table.

use std::time::Instant;

use growbot_core::random::Rng;
use growbot_tests::reference_search::table::{COLUMNS, Row, Stratum};
use growbot_tests::reference_search::{Best, Effort, helicoid, shortest};

const USAGE: &str = "DATE, then whole numbers: SEED PASSES COUNT...";
/// Min difference by which a pass must shorten a case to count as an improvement, radii.
const IMPROVED: f64 = 1e-6;

fn effort(stratum: Stratum) -> Effort {
    let helicoid = helicoid::Effort { shots: 60, lines: 15, chains: 8, rounds: 2, max_rounds: 12, hits: 8 };
    match stratum {
        Stratum::Middle => Effort { csc_starts: 400, helicoid: Some(helicoid::Effort { rounds: 1, ..helicoid }) },
        Stratum::Far => Effort { csc_starts: 400, helicoid: None },
        _ => Effort { csc_starts: 400, helicoid: Some(helicoid) },
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [date, numbers @ ..] = arguments.as_slice() else { panic!("{USAGE}") };
    let numbers: Vec<u64> = numbers.iter().map(|text| text.parse().expect(USAGE)).collect();
    let [seed, passes, counts @ ..] = numbers.as_slice() else { panic!("{USAGE}") };
    assert_eq!(counts.len(), Stratum::ALL.len(), "{USAGE}");
    print_head(date, *passes, &arguments.join(" "));
    let mut rows = Vec::new();
    for (stratum, count) in Stratum::ALL.into_iter().zip(counts) {
        let began = Instant::now();
        let mut tally = Tally::new(*passes);
        rows.extend((0..*count).filter_map(|number| tally.case(stratum, *seed, number)));
        tally.print(stratum, *count);
        eprintln!("{}: {:.1} s", stratum.name(), began.elapsed().as_secs_f64());
    }
    println!("{COLUMNS}");
    rows.iter().for_each(|row| println!("{row}"));
}

fn print_head(date: &str, passes: u64, arguments: &str) {
    println!(
        "# The shortest lengths known of curves of curvature at most 1 from the origin along z; lengths in radii."
    );
    println!("# Made on {date} by: cargo run --release -p growbot-tests --example best_known -- {arguments}");
    println!(
        "# Every case was searched {passes} times; an improvement is one by more than {IMPROVED:e} over the passes before.\n\
         # The slack is by how much the shortest of all chains, which come from a search that knows nothing of path types,\n\
         # was longer than the best; chains end within 1e-4 of the goal. A case is left out where a chain is shorter by more\n\
         # than {:e}: its best is not known. Refused are curves that did not arrive when walked again.",
        helicoid::BEATEN
    );
}

/// Results of the cases of a stratum.
struct Tally {
    /// Number of cases that each pass improved.
    improved: Vec<u64>,
    helicoidal: u64,
    refused: u64,
    left_out: u64,
    slack: f64,
}

impl Tally {
    fn new(passes: u64) -> Self {
        Self { improved: vec![0; passes as usize], helicoidal: 0, refused: 0, left_out: 0, slack: f64::INFINITY }
    }

    /// Searches a case in all passes. `None` if the case is omitted, because a shortened chain shows that a shorter
    /// curve exists.
    fn case(&mut self, stratum: Stratum, seed: u64, number: u64) -> Option<Row> {
        let problem = stratum.case(seed, number);
        let mut best: Option<Best> = None;
        let mut min_chain = f64::INFINITY;
        for (pass, improved) in (0..).zip(&mut self.improved) {
            let mut random = Rng::new(&[seed, stratum as u64, number, pass + 1]);
            let found = shortest(&problem, &effort(stratum), &mut random);
            print_pass(&format!("{} {number} pass {pass} at {:.3}", stratum.name(), problem.goal.norm()), &found);
            min_chain = min_chain.min(found.helicoids.min_chain);
            self.refused += found.helicoids.refused as u64;
            match &best {
                Some(best) if found.curve.length() >= best.curve.length() - 1e-9 => continue,
                Some(best) if found.curve.length() < best.curve.length() - IMPROVED => {
                    *improved += 1;
                    eprintln!("improved by {:e}: {problem:?}", best.curve.length() - found.curve.length());
                }
                _ => {}
            }
            best = Some(found);
        }
        let Best { curve, path_type, .. } = best?;
        if min_chain < curve.length() - helicoid::BEATEN {
            self.left_out += 1;
            return None;
        }
        self.slack = self.slack.min(min_chain - curve.length());
        self.helicoidal += u64::from(path_type == "H");
        Some(Row {
            stratum: stratum.name().to_owned(),
            problem,
            length: curve.length(),
            path_type: path_type.to_owned(),
        })
    }

    fn print(&self, stratum: Stratum, count: u64) {
        let Self { improved, helicoidal, refused, left_out, slack } = self;
        let slack = if slack.is_finite() { format!("{slack:.1e}") } else { "unknown: no chains".to_owned() };
        println!(
            "# {}: {count} cases, {helicoidal} H; improvements by later passes {:?}; min slack {slack}; {refused} refused; \
             {left_out} left out.",
            stratum.name(),
            &improved[1..]
        );
    }
}

fn print_pass(what: &str, found: &Best) {
    let helicoids = &found.helicoids;
    eprintln!(
        "{what}: {} {:.12}; csc hits {}, H hits {} + {} + {} in {} rounds, {} refused; min chain {:+.6}",
        found.path_type,
        found.curve.length(),
        found.csc_hits,
        helicoids.by_shots,
        helicoids.by_lines,
        helicoids.by_chains,
        helicoids.rounds,
        helicoids.refused,
        helicoids.min_chain - found.curve.length()
    );
}
