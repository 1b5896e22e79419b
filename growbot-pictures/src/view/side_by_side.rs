//! The numbers of two bodies, side by side.

use serde_json::{Value, json};

use super::Layers;
use super::info_panel::InfoGroup;

/// Returns the groups of two bodies, each `[heading, [[name, value, value], ...]]`. A missing value is null.
pub fn together(one: &[InfoGroup], other: &[InfoGroup]) -> Value {
    let groups = joined(one, other).into_iter().map(|(heading, a, b)| {
        let rows = joined(a.map_or(&[][..], Vec::as_slice), b.map_or(&[][..], Vec::as_slice));
        json!([heading, rows])
    });
    groups.collect()
}

/// Joins the entries of two lists by their names, in the order of the first list. An entry that only the second list
/// has is inserted after its predecessor in the second list.
fn joined<'a, T>(one: &'a [(String, T)], other: &'a [(String, T)]) -> Vec<(&'a str, Option<&'a T>, Option<&'a T>)> {
    let mut all: Vec<_> = one.iter().map(|(name, value)| (name.as_str(), Some(value), None)).collect();
    let mut at = 0;
    for (name, value) in other {
        match all.iter_mut().enumerate().find(|(_, (known, ..))| known == name) {
            Some((index, (.., second))) => {
                *second = Some(value);
                at = index + 1;
            }
            None => {
                all.insert(at, (name, None, Some(value)));
                at += 1;
            }
        }
    }
    all
}

/// Returns a text about the difference in length of two bodies with these names.
pub fn difference(pair: [(&str, &Layers); 2]) -> String {
    let [(one, a), (other, b)] = pair.map(|(name, layers)| (name, tenths(layers.length())));
    let (longer, long, shorter, short) = if a >= b { (one, a, other, b) } else { (other, b, one, a) };
    let by = long - short;
    if by < 0.05 {
        return format!("{one} and {other} have the same length");
    }
    let share = if short > 0.0 { format!(" ({:.1} %)", 100.0 * by / short) } else { String::new() };
    format!("{longer} is {by:.1} mm{share} longer than {shorter}")
}

/// Rounds a length to the precision of the texts, mm, so that the difference is that of the printed lengths.
fn tenths(length: f64) -> f64 {
    (10.0 * length).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(heading: &str, names: &[&str]) -> InfoGroup {
        (heading.to_owned(), names.iter().map(|name| ((*name).to_owned(), format!("{name} of {heading}"))).collect())
    }

    #[test]
    fn rows_of_only_one_file_keep_their_position() {
        let plan = [group("Plan", &["Length", "Clearance"]), group("Robot", &["Name"])];
        let run =
            [group("Arrived", &["From the goal"]), group("Plan", &["Length", "Path type"]), group("Robot", &["Name"])];
        let expected = json!([
            ["Arrived", [["From the goal", null, "From the goal of Arrived"]]],
            [
                "Plan",
                [
                    ["Length", "Length of Plan", "Length of Plan"],
                    ["Path type", null, "Path type of Plan"],
                    ["Clearance", "Clearance of Plan", null],
                ]
            ],
            ["Robot", [["Name", "Name of Robot", "Name of Robot"]]],
        ]);
        assert_eq!(together(&plan, &run), expected);
    }
}
