//! Makes `tests/best_known.csv`, the table of the least known lengths: the same numbers, the same table.
//!
//! ```text
//! cargo run --release -p growbot-tests --example best_known -- SEED PASSES NEAR MIDDLE FAR COPLANAR > tests/best_known.csv
//! ```
//!
//! NEAR to COPLANAR are how many cases of each stratum there shall be. Every case is searched PASSES times, each time with
//! random numbers of its own, and the shortest curve is kept; what each pass added to those before goes to the standard
//! error, and into the table's comments.

use std::time::Instant;

use growbot_tests::slow_shortest::random::Random;
use growbot_tests::slow_shortest::table::{COLUMNS, Row, Stratum};
use growbot_tests::slow_shortest::{Best, Effort, helicoid, shortest};

/// A pass improved a case if it is shorter than all before by more than this, radii.
const IMPROVED: f64 = 1e-6;

fn effort(stratum: Stratum) -> Effort {
    let helicoid = helicoid::Effort { shots: 60, lines: 15, chains: 8, rounds: 2, most_rounds: 12, hits: 8 };
    match stratum {
        Stratum::Near | Stratum::Coplanar => Effort { csc_starts: 400, helicoid: Some(helicoid) },
        Stratum::Middle => Effort { csc_starts: 400, helicoid: Some(helicoid::Effort { rounds: 1, ..helicoid }) },
        Stratum::Far => Effort { csc_starts: 400, helicoid: None },
    }
}

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).map(|text| text.parse().expect("whole numbers")).collect();
    let [seed, passes, counts @ ..] = numbers.as_slice() else { panic!("SEED PASSES NEAR MIDDLE FAR COPLANAR") };
    println!("# The least lengths known of curves of curvature at most 1 from the origin along z; lengths in radii.");
    println!("# Made by: cargo run --release -p growbot-tests --example best_known -- {}", {
        numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(" ")
    });
    let mut rows = Vec::new();
    for (stratum, count) in Stratum::ALL.into_iter().zip(counts) {
        let began = Instant::now();
        let mut improved = vec![0; *passes as usize];
        let mut helicoidal = 0;
        for number in 0..*count {
            let problem = stratum.case(*seed, number);
            let mut best: Option<Best> = None;
            for pass in 0..*passes {
                let mut random = Random::new(&[*seed, stratum as u64, number, pass + 1]);
                let found = shortest(&problem, &effort(stratum), &mut random);
                let helicoids = found.helicoids;
                eprintln!(
                    "{} {number} pass {pass} at {:.3}: {} {:.12}; csc hits {}, H hits {} + {} + {} in {} rounds, {} refused; least chain {:+.6}; {:.1} s",
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
                    helicoids.least_chain - found.curve.length(),
                    began.elapsed().as_secs_f64()
                );
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
            helicoidal += u64::from(word == "H");
            let (stratum, word) = (stratum.name().to_owned(), word.to_owned());
            rows.push(Row { stratum, problem, length: curve.length(), word });
        }
        println!(
            "# {}: {count} cases, {helicoidal} of them H; later passes improved {:?} of them by more than {IMPROVED:e}.",
            stratum.name(),
            &improved[1..]
        );
        eprintln!("{}: {:.1} s", stratum.name(), began.elapsed().as_secs_f64());
    }
    println!("{COLUMNS}");
    rows.iter().for_each(|row| println!("{row}"));
}
