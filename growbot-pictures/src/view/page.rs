//! Fills the HTML page with data. The page and its script, which is bundled at development time, are in
//! growbot-pictures/viewer/.

use growbot_scene::obstacle_selection::SelectionLimits;
use serde_json::{Value, json};

use super::scene_view::SceneView;
use super::side_by_side::{difference, together};
use super::{Subject, ViewError, info_panel, page_data};
use crate::drawing::canvas::escape;
use crate::drawing::colours::HEIGHTS;

const PAGE: &str = include_str!("../../viewer/src/page.html");
const SCRIPT: &str = include_str!("../../viewer/dist/viewer.js");

/// Value of `connect-src` in the content security policy of a page that may not send requests. `HOME` permits requests
/// to the page's own origin.
const NOWHERE: &str = "'none'";
const HOME: &str = "'self'";

/// Maximum numbers of obstacles on a page. They take 2 MB.
const LIMITS: SelectionLimits = SelectionLimits { shapes: 1000, triangles: 12_000, points: 20_000 };

/// Returns the HTML page that shows a body.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn render(subject: &Subject) -> Result<String, ViewError> {
    let layers = subject.layers()?;
    let around = SceneView::of(subject, &layers, &LIMITS);
    let mut data = page_data::page_data(subject, &layers, around.as_ref());
    data["numbers"] = json!(info_panel::of(subject, &layers, around.as_ref()));
    Ok(filled(subject.name, data, NOWHERE))
}

/// Kind of page that shows a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PageAccess {
    /// Page that only shows the growth.
    View,
    /// Page that can also send commands.
    Control,
}

/// Returns the HTML page of a running growth, which requests updates from its own origin.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn render_live(subject: &Subject, access: PageAccess) -> Result<String, ViewError> {
    let layers = subject.layers()?;
    let around = SceneView::of(subject, &layers, &LIMITS);
    let mut data = page_data::page_data(subject, &layers, around.as_ref());
    data["about"] = json!(format!("growth of {}", subject.plan.robot));
    data["numbers"] = json!(info_panel::of(subject, &layers, around.as_ref()));
    data["live"] = json!({ "control": access == PageAccess::Control });
    Ok(filled(subject.name, data, HOME))
}

/// Returns the HTML page that shows two bodies side by side.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn render_pair([one, other]: [&Subject; 2]) -> Result<String, ViewError> {
    let layers = [one.layers()?, other.layers()?];
    let [a, b] = &layers;
    let around = [(one, a), (other, b)].map(|(subject, layers)| SceneView::of(subject, layers, &LIMITS));
    let [around_one, around_other] = around.each_ref().map(Option::as_ref);
    let data = json!({
        "compared": [page_data::page_data(one, a, around_one), page_data::page_data(other, b, around_other)],
        "difference": difference([(one.name, a), (other.name, b)]),
        "numbers": together(&info_panel::of(one, a, around_one), &info_panel::of(other, b, around_other)),
    });
    Ok(filled(&format!("{} and {}", one.name, other.name), data, NOWHERE))
}

fn filled(title: &str, data: Value, connects: &str) -> String {
    let mut data = data;
    data["height_colours"] = json!(HEIGHTS);
    // Nothing in the data can end the script element that contains it.
    let data = data.to_string().replace('<', "\\u003c");
    fill(PAGE, &[("{{CONNECT}}", connects), ("{{TITLE}}", &escape(title)), ("{{DATA}}", &data), ("{{SCRIPT}}", SCRIPT)])
}

/// Returns the page with each mark replaced by its text. Inserted texts are not searched for further marks.
fn fill(page: &str, marks: &[(&str, &str)]) -> String {
    let mut filled = String::with_capacity(page.len() + marks.iter().map(|(_, text)| text.len()).sum::<usize>());
    let mut rest = page;
    while let Some((at, (mark, text))) =
        marks.iter().filter_map(|pair| Some((rest.find(pair.0)?, pair))).min_by_key(|(at, _)| *at)
    {
        filled += &rest[..at];
        filled += text;
        rest = &rest[at + mark.len()..];
    }
    filled + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inserted_text_is_not_substituted_again() {
        let filled = fill("<b>{{A}}</b>{{B}}{{A}}", &[("{{A}}", "{{B}}"), ("{{B}}", "x")]);
        assert_eq!(filled, "<b>{{B}}</b>x{{B}}");
    }

    #[test]
    fn the_embedded_script_is_complete_and_has_its_licence() {
        assert!(!SCRIPT.to_lowercase().contains("</script") && !SCRIPT.contains("<!--"));
        assert!(SCRIPT.starts_with("/*!") && SCRIPT.contains("The MIT License"));
        for mark in ["{{CONNECT}}", "{{TITLE}}", "{{DATA}}", "{{SCRIPT}}"] {
            assert!(PAGE.contains(mark) && !SCRIPT.contains(mark), "{mark}");
        }
    }
}
