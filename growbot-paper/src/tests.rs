//! Tests of whole reproductions: the paper's numbers, equal bytes on any number of threads, valid files.

use experiments::ErrorQuantity;
use growbot_core::plan::Planner;
use table2::Verdicts;

use super::*;

const COMMAND: &str = "growbot reproduce -o DIR";

fn run(request: ReproduceRequest, threads: usize) -> Reproduction {
    Reproduction::run(request, threads, |_, _| ()).unwrap()
}

/// Returns a request for everything, with few repetitions.
fn small() -> ReproduceRequest {
    ReproduceRequest { repeat: 2, repeat_noise: 3, ..ReproduceRequest::default() }
}

fn csv_rows(file: &ResultFile) -> Vec<csv::StringRecord> {
    // The reader rejects rows whose length differs from the first.
    csv::Reader::from_reader(file.contents.as_bytes()).into_records().collect::<Result<_, _>>().unwrap()
}

/// Checks that every tag is closed, in order. Returns the number of elements.
fn elements(markup: &str) -> usize {
    const VOID: [&str; 3] = ["meta", "!DOCTYPE", "br"];
    let (mut open, mut count) = (Vec::new(), 0);
    for tag in markup.split('<').skip(1) {
        let (inside, _) = tag.split_once('>').expect("a tag is closed");
        assert!(!inside.starts_with(char::is_whitespace), "a bare < before {inside:?}");
        let name = inside.trim_matches('/').split_whitespace().next().unwrap();
        if inside.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "closed where another is open");
        } else if !inside.ends_with('/') && !VOID.contains(&name) {
            open.push(name);
        }
        count += 1;
    }
    assert_eq!(open, [""; 0], "left open");
    count
}

#[test]
fn goal_errors_of_robot_a_match_the_paper() {
    let done = run(ReproduceRequest { tables: vec![], figures: vec![5], ..ReproduceRequest::default() }, 2);
    let cells = done.comparison.table2.iter().filter(|cell| {
        (cell.robot, cell.planner, cell.slicing) == (paper::ROBOT_A, Planner::TwoPlane, slicing_rule::SlicingRule::Text)
    });
    assert_eq!(cells.clone().count(), paper::GROUPS.len());
    for cell in cells {
        // Each mean is not only within a standard deviation, but also equivalent by test.
        let tests = cell.tests.unwrap();
        assert!(tests.is_equivalent() && !tests.differs(), "{} R: {cell:?}", paper::GROUPS[cell.group]);
        assert!(cell.is_within() && (cell.ours.n, cell.comparisons) == (50, 4), "{cell:?}");
    }
    // As in the paper, no test finds that heading and pitch depend on the distance.
    let quoted = done.comparison.questions.iter().filter(|question| question.paper.is_some());
    assert!(quoted.clone().count() > 0);
    for question in quoted {
        assert!(question.kruskal_wallis.unwrap().p > 0.01, "{question:?}");
    }
}

/// An independent check of these 36 means found 9 that differ at 5 %, and 4 after a correction for 36 comparisons.
#[test]
fn table_2_has_the_expected_differing_and_equivalent_means() {
    let done = run(ReproduceRequest { tables: vec![2], figures: vec![], ..ReproduceRequest::default() }, 2);
    let by_text = Verdicts::of(&done.comparison.table2, Planner::TwoPlane, slicing_rule::SlicingRule::Text);
    let found = (by_text.cells, by_text.differ_uncorrected, by_text.differ, by_text.equivalent);
    assert_eq!(found, (36, 9, 4, 29));
    let by_table = Verdicts::of(&done.comparison.table2, Planner::TwoPlane, slicing_rule::SlicingRule::Table);
    assert_eq!((by_table.cells, by_table.differ, by_table.equivalent), (36, 36, 0));
    let files = done.files(COMMAND);
    let page = &files.iter().find(|file| file.name == "report.html").unwrap().contents;
    assert!(
        page.contains("9 of 36 means differ by Welch's test at 5 %, 4 after Holm's correction, and 29 are"),
        "{page}"
    );
}

#[test]
fn growth_rows_contain_start_and_goal() {
    let done = run(ReproduceRequest { tables: vec![], figures: vec![7], ..small() }, 2);
    let files = done.files(COMMAND);
    let file = files.iter().find(|file| file.name == "growths.csv").unwrap();
    let mut reader = csv::Reader::from_reader(file.contents.as_bytes());
    let names = reader.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|found| found == name).unwrap_or_else(|| panic!("no {name}"));
    for row in reader.records() {
        let row = row.unwrap();
        let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
        let between = |axis: &str| number(&format!("goal_{axis}_mm")) - number(&format!("start_{axis}_mm"));
        let distance = libm::sqrt(["x", "y", "z"].map(|axis| between(axis) * between(axis)).iter().sum());
        let radius = number("path_length_mm") / number("path_length_over_radius");
        assert!((distance / radius - number("group_radii")).abs() < 1e-9, "{row:?}");
        assert!(number("start_heading_deg").abs() <= 180.0 && number("goal_pitch_deg").abs() <= 90.0);
    }
}

#[test]
fn every_robot_reaches_the_goal_with_exact_slicing_and_no_noise() {
    let done = run(ReproduceRequest { figures: vec![8], ..small() }, 2);
    let comparison::ExactErrors { max_position, max_direction, growths } = done.comparison.exact.unwrap();
    assert_eq!(growths, 11 * 4 * 2 * 2);
    assert!(max_position <= 1e-9 && max_direction <= 1e-9, "{max_position:e} of the length, {max_direction:e} rad");
}

#[test]
fn feedback_reduces_the_goal_error_with_noise() {
    let done = run(ReproduceRequest { tables: vec![], figures: vec![4], repeat: 10, ..ReproduceRequest::default() }, 2);
    let mean = |group: usize, feedback: bool| {
        let noisy = |set: &&experiments::GrowthSet| {
            set.group == group
                && set.condition.noise > 0.0
                && set.condition.feedback == feedback
                && set.condition.planner == Planner::TwoPlane
        };
        done.experiments.sets.iter().find(noisy).unwrap().summary(ErrorQuantity::Position).mean
    };
    for group in 0..paper::GROUPS.len() {
        assert!(mean(group, true) < 0.7 * mean(group, false), "{} R", paper::GROUPS[group]);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let [one, three] = [1, 3].map(|threads| run(small(), threads).files(COMMAND));
    for (a, b) in one.iter().zip(&three) {
        assert!(a == b, "{} differs", a.name);
    }
    let other = run(ReproduceRequest { seed: 7, ..small() }, 2).files(COMMAND);
    assert!(one.iter().zip(&other).any(|(a, b)| a != b));
}

#[test]
fn every_table_and_figure_exists_and_is_readable() {
    let done = run(ReproduceRequest { repeat: 5, ..small() }, 2);
    let files = done.files(COMMAND);
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "table1.csv",
            "table3.csv",
            "table2.csv",
            "summary.csv",
            "tests.csv",
            "growths.csv",
            "paths.csv",
            "figure4.svg",
            "figure5.svg",
            "figure6.svg",
            "figure7.svg",
            "figure8.svg",
            "report.html"
        ]
    );
    let file = |name: &str| files.iter().find(|file| file.name == name).unwrap();
    assert_eq!((csv_rows(file("table1.csv")).len(), csv_rows(file("table3.csv")).len()), (9, 3));
    let growths: usize = done.experiments.sets.iter().chain(&done.experiments.noise).map(|set| set.growths.len()).sum();
    assert_eq!(csv_rows(file("growths.csv")).len(), growths);
    assert!(csv_rows(file("paths.csv")).len() > 1000 && csv_rows(file("tests.csv")).len() > 50);
    for number in FIGURES {
        assert!(elements(&file(&format!("figure{number}.svg")).contents) > 100, "Figure {number}");
    }
    let page = &file("report.html").contents;
    elements(page);
    assert!(page.contains("p &lt; 0.0001"), "a small p is written so that it is no tag");
    for id in ["differences", "table1", "table2", "table3", "tests", "feedback", "figure4", "figure8"] {
        assert!(page.contains(&format!("id=\"{id}\"")), "{id}");
    }
    assert_eq!(page.matches("<svg").count(), 5);
    // The page fetches nothing. Its only address is the name of SVG's namespace.
    let without_names = page.replace("http://www.w3.org/2000/svg", "");
    for fetched in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
        assert!(!without_names.contains(fetched), "{fetched}");
    }
    for file in &files {
        for wrong in ["NaN", "inf,", ",inf"] {
            assert!(!file.contents.contains(wrong), "{} has {wrong}", file.name);
        }
    }
}

#[test]
fn the_summary_fits_a_terminal_and_has_only_requested_parts() {
    let text = summary::summary(&run(small(), 2));
    for line in text.lines() {
        assert!(line.chars().count() <= 80, "{line}");
    }
    for part in ["Table 1", "Table 2", "Table 3", "Figure 6", "seed 2019", "ANOVA", "Exact slicing"] {
        assert!(text.contains(part), "{part}");
    }
    let parameters = run(ReproduceRequest { tables: vec![3], figures: vec![], ..small() }, 2);
    assert!(parameters.experiments.sets.is_empty());
    let names: Vec<String> = parameters.files(COMMAND).into_iter().map(|file| file.name).collect();
    assert_eq!(names, ["table3.csv", "report.html"]);
    let paths = run(ReproduceRequest { tables: vec![], figures: vec![7], ..small() }, 2);
    assert!(paths.experiments.sets.iter().all(|set| matches!(set.robot, paper::B | paper::C)));
    assert_eq!(paths.experiments.examples.len(), 2);
}
