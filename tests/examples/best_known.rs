//! Makes `tests/best_known.csv`, the table of the shortest known lengths: the same numbers, the same table.
//!
//! ```text
//! cargo run --release -p growbot-tests --example best_known -- DATE SEED PASSES COUNT... \
//!     > tests/best_known.csv
//! ```
//!
//! DATE goes into the comments; each COUNT is how many cases of a stratum there shall be, in the order of `Stratum::ALL`. Every case is searched PASSES times, each time with
//! random numbers of its own, and the shortest curve is kept; what each pass added to those before goes to the standard
//! error, and into the table's comments.

use std::time::Instant;

use growbot_core::random::Random;
use growbot_tests::slow_shortest::table::{COLUMNS, Row, Stratum};
use growbot_tests::slow_shortest::{Best, Effort, helicoid, shortest};

const USAGE: &str = "DATE, then whole numbers: SEED PASSES COUNT...";
/// A pass improved a case if it is shorter than all before by more than this, radii.
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
    println!("# The least lengths known of curves of curvature at most 1 from the origin along z; lengths in radii.");
    println!(
        "# Made on {date} by: cargo run --release -p growbot-tests --example best_known -- {}",
        arguments.join(" ")
    );
    println!(
        "# Every case was searched {passes} times; an improvement is one by more than {IMPROVED:e} over the passes before."
    );
    println!(
        "# The slack is by how much the shortest of all chains, which come from a search that knows nothing of words, was"
    );
    println!(
        "# longer than the best; chains end within 1e-4 of the goal. A case is left out where a chain is shorter by more than"
    );
    println!(
        "# {:e}: its best is not known. Refused are curves that did not arrive when walked again.",
        helicoid::BEATEN
    );
    let mut rows = Vec::new();
    for (stratum, count) in Stratum::ALL.into_iter().zip(counts) {
        let began = Instant::now();
        let mut improved = vec![0; *passes as usize];
        let mut helicoidal = 0;
        let mut refused = 0;
        let mut left_out = 0;
        let mut slack = f64::INFINITY;
        for number in 0..*count {
            let problem = stratum.case(*seed, number);
            let mut best: Option<Best> = None;
            let mut min_chain = f64::INFINITY;
            for pass in 0..*passes {
                let mut random = Random::new(&[*seed, stratum as u64, number, pass + 1]);
                let found = shortest(&problem, &effort(stratum), &mut random);
                let helicoids = found.helicoids;
                eprintln!(
                    "{} {number} pass {pass} at {:.3}: {} {:.12}; csc hits {}, H hits {} + {} + {} in {} rounds, {} refused; min chain {:+.6}; {:.1} s",
                    stratum.name(),
                    problem.goal.norm(),
                    found.word,
                    found.curve.length(),
                    found.csc_hits,
                    helicoids.by_shots,
                    helicoids.by_lines,
                    helicoids.by_chains,
                    helicoids.rounds,
                    helicoids.refused,
                    helicoids.min_chain - found.curve.length(),
                    began.elapsed().as_secs_f64()
                );
                min_chain = min_chain.min(helicoids.min_chain);
                refused += helicoids.refused;
                match &best {
                    Some(best) if found.curve.length() >= best.curve.length() - 1e-9 => continue,
                    Some(best) if found.curve.length() < best.curve.length() - IMPROVED => {
                        improved[pass as usize] += 1;
                        eprintln!("improved by {:e}: {problem:?}", best.curve.length() - found.curve.length());
                    }
                    _ => {}
                }
                best = Some(found);
            }
            let Some(Best { curve, word, .. }) = best else { continue };
            if min_chain < curve.length() - helicoid::BEATEN {
                left_out += 1;
                continue;
            }
            slack = slack.min(min_chain - curve.length());
            helicoidal += u64::from(word == "H");
            let (stratum, word) = (stratum.name().to_owned(), word.to_owned());
            rows.push(Row { stratum, problem, length: curve.length(), word });
        }
        let slack = if slack.is_finite() { format!("{slack:.1e}") } else { "unknown: no chains".to_owned() };
        println!(
            "# {}: {count} cases, {helicoidal} H; improvements by later passes {:?}; min slack {slack}; {refused} refused; {left_out} left out.",
            stratum.name(),
            &improved[1..]
        );
        eprintln!("{}: {:.1} s", stratum.name(), began.elapsed().as_secs_f64());
    }
    println!("{COLUMNS}");
    rows.iter().for_each(|row| println!("{row}"));
}
