//! A body as one HTML page that opens without a network: the tube in three dimensions and the numbers beside it.
//!
//! - [`Subject`]: what is looked at, a plan or a run log;
//! - `data`: what the page is given of it, as JSON;
//! - `self_clearance`: how near the wall comes to itself;
//! - growbot-host/viewer/: the page itself and its script, which is bundled there at development time.

mod data;
mod numbers;
mod self_clearance;

use growbot_core::job::job_layers;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use crate::plan::Plan;
use crate::plan_check::pose;
use crate::plan_file::WrittenPose;
use crate::run_log::RunRecord;

/// A page shows no more layers, of a body of some 150 m: beyond, browsers give up.
pub const MOST_LAYERS: usize = 200_000;

const PAGE: &str = include_str!("../../viewer/src/page.html");
const SCRIPT: &str = include_str!("../../viewer/dist/viewer.js");

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// More layers than a browser can show.
    #[error("{name} has {found} layers; a view shows {MOST_LAYERS} at most: split the plan")]
    TooManyLayers {
        /// What was to be shown.
        name: String,
        /// Layers that it has.
        found: usize,
    },
}

/// What is looked at.
#[derive(Debug)]
pub struct Subject<'a> {
    /// How it is called, say by its file.
    pub name: &'a str,
    /// The robot.
    pub robot: &'a Robot,
    /// The plan.
    pub plan: &'a Plan,
    /// The log of its growth, where there is one.
    pub run: Option<&'a RunRecord>,
}

impl Subject<'_> {
    /// The page.
    ///
    /// # Errors
    /// [`ViewError::TooManyLayers`].
    pub fn page(&self) -> Result<String, ViewError> {
        self.filled(None)
    }

    /// The page of a growth under way, which asks where it comes from for news; `control`: whether it may give orders.
    ///
    /// # Errors
    /// As [`Self::page`].
    pub fn live_page(&self, control: bool) -> Result<String, ViewError> {
        self.filled(Some(control))
    }

    fn filled(&self, live: Option<bool>) -> Result<String, ViewError> {
        let found = self.plan.needs.layers.max(self.run.map_or(0, |run| run.as_built.len()));
        if found > MOST_LAYERS {
            return Err(ViewError::TooManyLayers { name: self.name.to_owned(), found });
        }
        let planned: Vec<LayerBytes> = job_layers(&self.plan.path, self.robot).collect();
        let data = data::of(self, &planned, live);
        let connects = if live.is_some() { "'self'" } else { "'none'" };
        Ok(fill(
            PAGE,
            &[
                ("{{CONNECT}}", connects),
                ("{{TITLE}}", &escape(self.name)),
                ("{{DATA}}", &data),
                ("{{SCRIPT}}", SCRIPT),
            ],
        ))
    }
}

/// Layers as built of a run, as far as it went; those of which nothing is known as planned, as `growbot replay` has them.
fn built_layers(run: &RunRecord) -> Vec<LayerBytes> {
    run.as_built.iter().zip(&run.layers).map(|(as_built, planned)| as_built.unwrap_or(*planned)).collect()
}

/// Where the tip arrived and what that was measured by, as the log of a run that ended says.
fn measured_end(run: &RunRecord) -> Option<(Pose, &str)> {
    let result = run.result.as_ref()?;
    let by = result.get("measured_by")?.as_str()?;
    let written: WrittenPose = serde_json::from_value(result.get("final")?.clone()).ok()?;
    Some((pose("final", &written).ok()?, by))
}

/// The page with each mark replaced; what is put in is not looked into for further marks.
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

/// Text as HTML shows it.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_in_is_put_in_once() {
        let filled = fill("<b>{{A}}</b>{{B}}{{A}}", &[("{{A}}", "{{B}}"), ("{{B}}", "x")]);
        assert_eq!(filled, "<b>{{B}}</b>x{{B}}");
        assert_eq!(escape("</script><b a=\"&\">"), "&lt;/script&gt;&lt;b a=&quot;&amp;&quot;&gt;");
    }

    #[test]
    fn the_script_that_is_built_in_ends_where_it_should_and_has_its_licence() {
        assert!(!SCRIPT.to_lowercase().contains("</script") && !SCRIPT.contains("<!--"));
        assert!(SCRIPT.starts_with("/*!") && SCRIPT.contains("The MIT License"));
        for mark in ["{{CONNECT}}", "{{TITLE}}", "{{DATA}}", "{{SCRIPT}}"] {
            assert!(PAGE.contains(mark) && !SCRIPT.contains(mark), "{mark}");
        }
    }
}
