//! Tests of `growbot view` as a user runs it: pages of plans and run logs, and refusals of all other files.

use crate::running;

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use running::{Ran, growbot, growbot_reading};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Returns the JSON data that an HTML page contains.
fn data(page: &Path) -> Value {
    let page = fs::read_to_string(page).unwrap();
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    let (data, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(data).unwrap()
}

fn number<'a>(data: &'a Value, heading: &str, name: &str) -> &'a str {
    let groups = data["numbers"].as_array().unwrap();
    let group = groups.iter().find(|group| group[0] == heading).unwrap_or_else(|| panic!("no {heading}: {groups:?}"));
    let rows = group[1].as_array().unwrap();
    rows.iter().find(|row| row[0] == name).unwrap_or_else(|| panic!("no {name}: {rows:?}"))[1].as_str().unwrap()
}

/// Checks that the command ended with exit code 2, printed one message of one line that contains `parts`, and wrote no
/// page.
fn assert_refused(ran: &Ran, parts: &[&str], page: &Path) {
    assert_eq!(ran.code, Some(2), "{}", ran.err);
    assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "{part:?} is not in {:?}", ran.err);
    }
    assert!(ran.out.is_empty() && !page.exists(), "{}", ran.out);
}

/// Returns a directory with a plan of 50 layers, and the path of the plan.
fn plan_of_50_layers(name: &str) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let plan = directory.path().join(name);
    assert_eq!(growbot(&["plan", "--to", "0,0,38.7,0,90", "-o", text(&plan)]).code, Some(0));
    (directory, plan)
}

#[test]
fn a_plan_becomes_one_self_contained_page() {
    let directory = tempfile::tempdir().unwrap();
    let (plan, page) = (directory.path().join("plan.json"), directory.path().join("plan.html"));
    let to = ["plan", "--to", "550,345,610,120,-25", "--planner", "two-plane", "-o", text(&plan)];
    assert_eq!(growbot(&to).code, Some(0));
    let ran = growbot(&["view", text(&plan)]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(ran.out.is_empty() && ran.err.contains("plan.html"), "{}", ran.err);

    let html = fs::read_to_string(&page).unwrap();
    // The size in book/src/see-it.md is right.
    let (_, answer) =
        include_str!("../../book/src/see-it.md").split_once("one HTML file of about ").expect("the page says so");
    let megabytes: f64 = answer.split(' ').next().unwrap_or_default().parse().unwrap();
    assert!(
        (html.len() as f64 / 1e6 - megabytes).abs() < 0.1,
        "{} bytes, and see-it.md says {megabytes} MB",
        html.len()
    );
    assert!(html.contains("default-src 'none'") && !html.contains("src=\"") && !html.contains("{{"));
    let data = data(&page);
    let layers: usize = number(&data, "Plan", "Layers").parse().unwrap();
    assert!(layers > 1300);
    assert_eq!(data["planned"].as_str().unwrap().len(), 24 * layers);
    assert_eq!(data["built"], Value::Null);
    assert_eq!(number(&data, "Plan", "Length"), "1006.4 mm");
    assert_eq!(number(&data, "Plan", "From the goal"), "0.000 mm");
    assert_eq!(number(&data, "Plan", "Clearance to itself"), "not near itself anywhere");
    // The z axis of the start's frame points upwards.
    assert_eq!(data["start"].as_array().unwrap().len(), 12);
    assert!((data["start"][8].as_f64().unwrap() - 1.0).abs() < 1e-12);
}

#[test]
fn a_growth_with_a_truncated_log_is_displayed_beside_its_plan() {
    let (directory, plan) = plan_of_50_layers("plan.json");
    let path = |name: &str| directory.path().join(name);
    let (log, page) = (path("run.jsonl"), path("out.html"));
    let ran = growbot(&["grow", text(&plan), "--log", text(&log), "--noise", "10", "--seed", "1", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(growbot(&["view", text(&log), "-o", text(&page)]).code, Some(0));
    let whole = data(&page);
    assert_eq!(whole["about"], "growth of growbot-a: done");
    assert_eq!(number(&whole, "Laid (simulated)", "Layers"), "50 of 50");
    assert_eq!(number(&whole, "Commanded, computed from the steps that the board reports", "Layers"), "50 of 50");
    assert_eq!(whole["built_name"], "Laid (simulated)");
    assert_eq!(whole["built"].as_str().unwrap().len(), 24 * 50);
    // By its steps the body arrived. The tip, which had noise, shows the true error.
    let result: Value = serde_json::from_str(ran.out.lines().last().unwrap()).unwrap();
    let error = result["position_error_mm"].as_f64().unwrap();
    assert!(error > 0.01, "{error}");
    assert_eq!(number(&whole, "Arrived, as the tip says", "From the goal"), format!("{error:.3} mm"));
    assert_eq!(whole["reached"][2], result["final"]["z_mm"]);
    // The body ends at this distance from the goal, and the commanded line ends at the goal.
    assert_eq!(number(&whole, "Laid (simulated)", "From the goal"), format!("{error:.3} mm"));
    let commanded = whole["commanded"].as_array().unwrap().last().unwrap()[2].as_f64().unwrap();
    assert!((commanded - 38.7).abs() < 1e-3, "{commanded}");

    let lines = fs::read_to_string(&log).unwrap();
    let laid = lines.match_indices("\"event\":\"laid\"").nth(10).unwrap().0;
    fs::write(&log, &lines[..laid + 10]).unwrap();
    let ran = growbot(&["view", text(&log), "-o", text(&page)]);
    assert!(ran.code == Some(0) && ran.err.contains("cut off"), "{}", ran.err);
    let cut = data(&page);
    assert_eq!(cut["about"], "growth of growbot-a: unfinished");
    assert_eq!(number(&cut, "Laid (simulated)", "Layers"), "10 of 50");
    assert_eq!(cut["planned"], whole["planned"]);
    assert_eq!(cut["reached"], Value::Null);
}

#[test]
fn a_growth_with_feedback_shows_the_estimated_path() {
    let (directory, plan) = plan_of_50_layers("plan.json");
    let path = |name: &str| directory.path().join(name);
    let log = path("run.jsonl");
    let ran = growbot(&["grow", text(&plan), "--bias", "10", "--feedback", "--log", text(&log), "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(growbot(&["view", text(&log)]).code, Some(0));
    let grown = data(&path("run.html"));
    let estimated = grown["estimated"].as_array().unwrap();
    assert_eq!(estimated[0], serde_json::json!([0.0, 0.0, 0.0]));
    // The commanded steps are a tenth shorter than the body. The estimate includes this.
    let result: Value = serde_json::from_str(ran.out.lines().last().unwrap()).unwrap();
    let last = estimated.last().unwrap()[2].as_f64().unwrap();
    assert!((last - result["final"]["z_mm"].as_f64().unwrap()).abs() < 0.5, "{last}, {result}");

    assert_eq!(growbot(&["view", text(&plan)]).code, Some(0));
    assert_eq!(data(&path("plan.html"))["estimated"], Value::Null);
}

#[test]
fn a_file_that_is_neither_plan_nor_log_gives_no_page() {
    let (directory, plan) = plan_of_50_layers("plan.json");
    let path = |name: &str| directory.path().join(name);
    let page = path("page.html");
    let view = |file: &Path| growbot(&["view", text(file), "-o", text(&page)]);
    let whole = fs::read_to_string(&plan).unwrap();
    for (name, contents, parts) in [
        ("cut.json", &whole[..whole.len() / 2], &["cut.json", "middle"][..]),
        ("cube.stl", "solid cube", &["cube.stl", "neither a run log nor a plan"]),
        ("empty", "", &["empty"]),
        ("other.json", &whole.replace("growbot-plan/1", "growbot-plan/9"), &["growbot-plan/9"]),
        ("robot.json", &whole.replace("\"growbot-a\"", "\"mine\""), &["mine", "--robot"]),
    ] {
        fs::write(path(name), contents).unwrap();
        assert_refused(&view(&path(name)), parts, &page);
    }
    assert_refused(&view(&path("none.json")), &["none.json", "cannot read"], &page);
    assert_refused(&view(directory.path()), &["cannot read"], &page);
    assert_refused(&growbot(&["view", text(&plan), "-o", text(&path("no/page.html"))]), &["does not exist"], &page);
    assert_refused(&growbot_reading(&["view", "-"], &whole), &["-o"], &page);
    assert_refused(&growbot(&["view", text(&plan), "-o", text(&plan)]), &["use .html"], &page);
    assert_eq!(fs::read_to_string(&plan).unwrap(), whole);

    let ran = growbot_reading(&["view", "-", "-o", text(&page)], &whole);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(number(&data(&page), "Plan", "Layers"), "50");
}

#[test]
fn file_contents_and_names_are_escaped_in_the_page() {
    let (directory, plan) = plan_of_50_layers("a<b>&{{DATA}}.json");
    let bad = "</script><script>alert(1)</script>";
    let contents = fs::read_to_string(&plan).unwrap();
    let warning = serde_json::json!([{ "code": "mine", "message": bad, "value": 1, "limit": 0 }]).to_string();
    let (head, _) = contents.split_once("\"warnings\": []").unwrap();
    fs::write(&plan, format!("{head}\"warnings\": {warning}}}")).unwrap();
    let page = directory.path().join("page.html");
    let ran = growbot(&["view", text(&plan), "-o", text(&page)]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let html = fs::read_to_string(&page).unwrap();
    assert!(!html.contains(bad) && html.contains("<title>a&lt;b&gt;&amp;{{DATA}}.json</title>"));
    assert_eq!(data(&page)["warnings"][0], bad);
}

#[test]
fn two_files_are_compared_on_one_page() {
    let (directory, plan) = plan_of_50_layers("a.json");
    let path = |name: &str| directory.path().join(name);
    let other = path("b.json");
    let to = ["plan", "--from", "10,0,0,0,90", "--to", "10,0,77.4,0,90", "-o", text(&other)];
    assert_eq!(growbot(&to).code, Some(0));
    let ran = growbot(&["view", "--compare", text(&plan), text(&other)]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let pair = data(&path("a-b.html"));
    assert_eq!(pair["difference"], "b.json is 38.7 mm (100.0 %) longer than a.json");
    let [a, b] = [0, 1].map(|index| &pair["compared"][index]);
    assert_eq!((a["name"].as_str(), b["name"].as_str()), (Some("a.json"), Some("b.json")));
    assert_eq!((a["caption"].as_str(), &b["start"][9]), (Some("shortest (S) · 38.7 mm · 50 layers"), &10.0.into()));
    let groups = pair["numbers"].as_array().unwrap();
    let plan_group = groups.iter().find(|group| group[0] == "Plan").unwrap();
    assert_eq!(plan_group[1][0], serde_json::json!(["Length", "38.7 mm", "77.4 mm"]));

    // A growth beside its plan.
    let log = path("run.jsonl");
    assert_eq!(growbot(&["grow", text(&plan), "--log", text(&log)]).code, Some(0));
    let ran = growbot(&["view", text(&plan), text(&log), "--compare", "-o", text(&path("c.html"))]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let pair = data(&path("c.html"));
    assert_eq!(pair["difference"], "a.json and run.jsonl have the same length");
    assert_eq!(pair["numbers"][1][0], "Laid (simulated)");
}

#[test]
fn a_comparison_needs_two_body_files() {
    let (directory, plan) = plan_of_50_layers("a.json");
    let path = |name: &str| directory.path().join(name);
    let page = path("page.html");
    fs::write(path("cube.stl"), "solid cube").unwrap();
    let view = |args: &[&str]| growbot(&[&["view", "-o", text(&page)], args].concat());
    assert_refused(&view(&["--compare", text(&plan)]), &["two plans"], &page);
    assert_refused(&view(&[text(&plan), text(&plan)]), &["--compare"], &page);
    assert_refused(
        &view(&["--compare", text(&plan), text(&path("cube.stl"))]),
        &["cube.stl", "neither a run log nor a plan"],
        &page,
    );
    assert_refused(&view(&["--compare", "-", "-"]), &["standard input"], &page);
    assert_refused(&growbot(&["view", "--compare", text(&plan), "-"]), &["-o"], &page);
    assert_refused(&growbot(&["view", "--compare", "-o", text(&plan), "-", text(&plan)]), &["use .html"], &page);
}
