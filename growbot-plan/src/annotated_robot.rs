//! Explanation of a robot's description: each field with its value, its meaning, and the comment in the file.
//!
//! Meanings come from the [schema](robot_schema), that is, from the doc comments of the description. Comments come from the ends of
//! the lines in the file. A comment that begins with "assumed" marks a value that has not been measured.

use std::path::Path;

use growbot_core::robot::Robot;
use toml_edit::{DocumentMut, Item};

use crate::robot_file::{self, RobotFileError};
use crate::robot_schema;

/// A robot, and an explanation of each field of its description.
#[derive(Debug)]
pub struct AnnotatedRobot {
    /// The robot.
    pub robot: Robot,
    /// Comment at the start of the file, as one line.
    pub about: String,
    /// Sections of the description, in its order. The first section contains the fields outside all tables, and its
    /// name is empty.
    pub sections: Vec<Section>,
}

/// A section of a file, for example `[geometry]`.
#[derive(Debug)]
pub struct Section {
    /// Name of the section.
    pub name: String,
    /// Meaning of the section, from the schema.
    pub description: String,
    /// Fields of the section.
    pub fields: Vec<AnnotatedField>,
}

/// A field of a description.
#[derive(Debug)]
pub struct AnnotatedField {
    /// Full name of the field, for example `geometry.tip_radius_mm`.
    pub path: String,
    /// Value as TOML.
    pub value: String,
    /// Meaning of the field, with its unit.
    pub description: String,
    /// True if the file sets the field. False if the value is the default.
    pub in_file: bool,
    /// Comment after the field in the file. Empty if there is none.
    pub comment: String,
}

impl AnnotatedField {
    /// Returns true if the field's comment begins with "assumed", which marks a value that has not been measured.
    pub fn is_assumed(&self) -> bool {
        is_assumed(&self.comment)
    }
}

/// Returns true if a field's comment begins with "assumed", which marks a value that has not been measured.
pub fn is_assumed(remark: &str) -> bool {
    remark.starts_with("assumed")
}

impl AnnotatedRobot {
    /// Reads, checks and explains the robot with this built-in name or in this file.
    ///
    /// # Errors
    /// Errors of [`robot_file::load`].
    pub fn load(name_or_file: &Path) -> Result<Self, RobotFileError> {
        let (text, file) = robot_file::text_of(name_or_file)?;
        let robot = robot_file::parse(&text, &file)?;
        // Neither can fail. The text has been read as a description, and the other one is written from a description.
        let written = toml::to_string(robot.description()).unwrap_or_default();
        let whole: DocumentMut = written.parse().unwrap_or_default();
        let file: DocumentMut = text.parse().unwrap_or_default();
        let schema = robot_schema::robot_file_schema_without_bounds();
        let mut sections = vec![Section { name: String::new(), description: String::new(), fields: Vec::new() }];
        for (key, item) in whole.iter() {
            if item.is_table() {
                let description = robot_schema::meaning(&schema, key).to_owned();
                sections.push(Section { name: key.to_owned(), description, fields: Vec::new() });
            }
            let section = if item.is_table() { sections.last_mut() } else { sections.first_mut() };
            if let Some(section) = section {
                collect(item, key, &file, &schema, &mut section.fields);
            }
        }
        Ok(Self { robot, about: opening_comment(&text), sections })
    }

    /// Returns the fields of all sections.
    pub fn fields(&self) -> impl Iterator<Item = &AnnotatedField> {
        self.sections.iter().flat_map(|section| &section.fields)
    }

    /// Returns the first sentence of the comment at the start of the file, which describes the robot, and the next
    /// sentence that cites a publication ("et al."). If the first sentence already cites one, it is returned alone.
    pub fn what_and_source(&self) -> String {
        let sentences = sentences(&self.about);
        let source = sentences.iter().skip(1).find(|sentence| sentence.contains(" et al. "));
        let first = sentences.first().copied().unwrap_or_default();
        match source {
            Some(source) if !first.contains(" et al. ") => format!("{first} {source}"),
            _ => first.to_owned(),
        }
    }
}

/// Adds the fields of a TOML item, and of all tables in the item, to `fields`. `path` is the item's full name.
fn collect(item: &Item, path: &str, file: &DocumentMut, schema: &serde_json::Value, fields: &mut Vec<AnnotatedField>) {
    if let Some(table) = item.as_table_like() {
        for (key, item) in table.iter() {
            collect(item, &format!("{path}.{key}"), file, schema, fields);
        }
        return;
    }
    let (in_file, remark) = trailing_comment(file, path);
    let value = item.to_string().trim().to_owned();
    let mut description = robot_schema::meaning(schema, path).to_owned();
    if let Some((parent, _)) = path.rsplit_once('.').filter(|(parent, _)| parent.contains('.')) {
        description = format!("{} {description}", robot_schema::meaning(schema, parent));
    }
    let choices = robot_schema::choices(schema, path);
    if let Some((word, meaning)) = choices.iter().find(|(word, _)| value.trim_matches('"') == *word) {
        description += &format!(" {word}: {meaning}");
    }
    fields.push(AnnotatedField { path: path.to_owned(), value, description, in_file, comment: remark });
}

/// Returns true if the file sets the field at `path`, and the comment after the field or after the inline table
/// around it.
fn trailing_comment(file: &DocumentMut, path: &str) -> (bool, String) {
    let mut item = file.as_item();
    let mut remark = String::new();
    for key in path.split('.') {
        let Some(below) = item.get(key) else { return (false, String::new()) };
        item = below;
        let behind = item.as_value().and_then(|value| value.decor().suffix()?.as_str());
        if let Some((_, comment)) = behind.and_then(|behind| behind.split_once('#')) {
            comment.trim().clone_into(&mut remark);
        }
    }
    (true, remark)
}

/// Returns the comment at the start of a file, as one line.
pub fn opening_comment(text: &str) -> String {
    let lines = text.lines().map_while(|line| line.strip_prefix('#')).filter(|line| !line.starts_with(":schema"));
    lines.map(str::trim).collect::<Vec<_>>().join(" ")
}

/// Splits a text into sentences. The full stops of "et al. 2019" and "Front. Robot. AI" do not end a sentence.
fn sentences(text: &str) -> Vec<&str> {
    let mut sentences = Vec::new();
    let mut rest = text;
    let mut from = 0;
    while let Some(stop) = rest.get(from..).and_then(|part| part.find(". ")).map(|stop| from + stop) {
        let (before, after) = rest.split_at(stop + 1);
        let abbreviated = ["al.", "Front.", "Robot."].iter().any(|word| before.ends_with(word));
        if abbreviated {
            from = stop + 2;
        } else {
            sentences.push(before.trim());
            rest = after.trim_start();
            from = 0;
        }
    }
    sentences.push(rest.trim());
    sentences
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_of_every_robot_is_explained() {
        for name in robot_file::names() {
            let explained = AnnotatedRobot::load(name.as_ref()).unwrap();
            assert!(explained.fields().count() > 50, "{name}");
            for field in explained.fields() {
                assert!(!field.description.is_empty(), "{name}: {}", field.path);
            }
            assert!(explained.what_and_source().contains(" et al. "), "{name}");
        }
    }

    #[test]
    fn assumed_fields_match_the_comments_of_the_file() {
        for name in robot_file::names() {
            let (text, _) = robot_file::text_of(name.as_ref()).unwrap();
            let explained = AnnotatedRobot::load(name.as_ref()).unwrap();
            let count = explained.fields().filter(|field| field.is_assumed()).count();
            let inner = |line: &str| line.matches(" = ").count().saturating_sub(1).max(1);
            let lines = text.lines().filter(|line| line.contains("# assumed"));
            assert_eq!(count, lines.map(inner).sum::<usize>(), "{name}");
        }
        let explained = AnnotatedRobot::load("growbot-a".as_ref()).unwrap();
        let field = |path| explained.fields().find(|field| field.path == path).unwrap();
        assert_eq!(field("geometry.tip_radius_mm").comment, "r_t");
        assert!(field("sensors.filament_motion.jam_mm").is_assumed());
        assert!(!field("layer.tilt_max_deg").is_assumed());
        assert!(
            !AnnotatedRobot::load("growbot-b".as_ref())
                .unwrap()
                .fields()
                .find(|f| f.path == "pause.standby_c")
                .unwrap()
                .in_file
        );
    }

    #[test]
    fn sentences_are_split_at_their_ends() {
        let text = "One of Sadeghi et al. 2017, Front. Robot. AI 6:45, so. Two";
        assert_eq!(sentences(text), ["One of Sadeghi et al. 2017, Front. Robot. AI 6:45, so.", "Two"]);
    }
}
