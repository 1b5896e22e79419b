//! Creation of a robot file from an existing one: the questions, the allowed answers, and the resulting file.
//!
//! The existing file is kept with its comments. Each answer is inserted, and the whole is checked like any robot file
//! ([`robot_file::parse`]). An answer is rejected if the check finds an error in it or in an earlier answer.

mod toml_values;

use growbot_core::robot::{Robot, RobotError};
use toml_edit::{DocumentMut, Item, Value};
use toml_values::{comment, look_up, look_up_mut, paths, remove, shown, trailing_comment};

use crate::annotated_robot::{is_assumed, opening_comment};
use crate::robot_file::{self, RobotFileError};

/// Fields with a question, in the order of the questions. A field comes after the fields that limit it.
pub const ASKED_FIELDS: [&str; 24] = [
    NAME,
    "geometry.inner_radius_mm",
    "geometry.inner_length_mm",
    "geometry.tip_radius_mm",
    "wall.width_mm",
    "layer.height_mm",
    "layer.height_min_mm",
    "layer.height_max_mm",
    "layer.tilt_max_deg",
    "layer.period_s",
    PLANNING_RADIUS,
    "motion.tick_hz",
    "motion.strategy",
    "motion.turning",
    "head.steps_per_turn",
    "head.acceleration_turns_per_s2",
    "feed.filament_diameter_mm",
    "feed.steps_per_mm",
    "feed.acceleration_mm_per_s2",
    "filament.spool_mm",
    "heater.max_c",
    "heater.target_c",
    "heater.extrusion_min_c",
    "heater.power_w",
];

/// Field of the robot's name.
pub const NAME: &str = "name";
/// Field whose comment in the written file reports `R_min`, the minimum radius of bends.
const PLANNING_RADIUS: &str = "planning_radius_mm";

/// Value of a limit that has no effect, as TOML.
pub const UNLIMITED: &str = "1000000000.0";
/// Answer that sets a limit to [`UNLIMITED`].
pub const NO_LIMIT: &str = "no limit";

/// Pairs of a dependent field and the field that it is proportional to. If an answer makes the value of the dependent
/// field invalid, it is scaled with the value of the other field.
const IN_PROPORTION: [(&str, &str); 3] = [
    ("geometry.tip_radius_mm", "geometry.inner_radius_mm"),
    ("layer.height_min_mm", "layer.height_mm"),
    ("layer.height_max_mm", "layer.height_mm"),
];

/// Errors of an answer.
#[derive(Debug, thiserror::Error)]
pub enum AnswerError {
    /// The answer has the wrong type.
    #[error("invalid value {text:?} for {path}: expected {kind}")]
    Kind {
        /// Path of the field.
        path: &'static str,
        /// The answer.
        text: String,
        /// Description of the required type.
        kind: &'static str,
    },
    /// The name is that of a built-in robot.
    #[error("{name} is the name of a built-in robot, and plans identify robots by name: choose another name")]
    BuiltIn {
        /// The name.
        name: String,
    },
    /// A robot with this value is not valid.
    #[error("{0}")]
    Robot(#[from] RobotFileError),
}

/// A value that was changed so that other values are valid.
#[derive(Debug, PartialEq)]
pub struct Adjustment {
    /// Path of the field.
    pub path: String,
    /// Old value, as TOML.
    pub from: String,
    /// New value, as TOML.
    pub to: String,
}

/// A robot description that is being edited.
#[derive(Debug, Clone)]
pub struct Draft {
    document: DocumentMut,
    /// Document at the start: the file, with values for fields that it omits and that have a question.
    first: DocumentMut,
    left_out: Vec<&'static str>,
    /// Name of the existing robot.
    base: String,
    about: String,
    /// Lines at the top that are for tools, such as `#:schema`.
    directives: String,
}

impl Draft {
    /// Starts with the text of a robot file, under a new name. Messages refer to the text as `file`.
    ///
    /// # Errors
    /// A text that is not a robot file.
    pub fn of(text: &str, file: &str, name: &str) -> Result<Self, RobotFileError> {
        let robot = robot_file::parse(text, file)?;
        let mut draft = Self {
            // This cannot fail, because the text has just been read as a robot file.
            document: text.parse().unwrap_or_default(),
            first: DocumentMut::new(),
            left_out: Vec::new(),
            base: robot.name().to_owned(),
            about: opening_comment(text),
            directives: text.split_inclusive('\n').filter(|line| line.starts_with("#:")).collect(),
        };
        // Fields that the file omits have a question, too, and can be set.
        let written = toml::to_string(robot.description()).unwrap_or_default();
        let whole: DocumentMut = written.parse().unwrap_or_default();
        for path in ASKED_FIELDS {
            if draft.value(path).is_none()
                && let Some(value) = look_up(whole.as_item(), path)
            {
                draft.put(path, value.clone());
                draft.left_out.push(path);
            }
        }
        draft.first = draft.document.clone();
        draft.put(NAME, name.into());
        Ok(draft)
    }

    /// Returns the present value of a field, as TOML. Empty if the draft does not set the field.
    pub fn shown(&self, path: &str) -> String {
        self.value(path).map(shown).unwrap_or_default()
    }

    /// Inserts an answer. Returns the fields without a question that had to be changed.
    ///
    /// # Errors
    /// The reason why the answer is rejected. The draft is then unchanged.
    pub fn apply_answer(&mut self, path: &'static str, text: &str) -> Result<Vec<Adjustment>, AnswerError> {
        let value = self.parse_answer(path, text)?;
        if path == NAME && value.as_str().is_some_and(robot_file::is_built_in) {
            return Err(AnswerError::BuiltIn { name: text.to_owned() });
        }
        let mut changed = self.clone();
        changed.put(path, value);
        let adapted = changed.settle(path)?;
        *self = changed;
        Ok(adapted)
    }

    /// Changes fields without a question so that they fit the answers up to this field.
    fn settle(&mut self, path: &str) -> Result<Vec<Adjustment>, AnswerError> {
        self.check_up_to(path)?;
        let adapted = self.adapt();
        match self.robot() {
            // No later question can correct this field, so the error would only appear when the file is written.
            Err(RobotFileError::Robot { file, error }) if !ASKED_FIELDS.contains(&field_of(&error)) => {
                Err(RobotFileError::Robot { file, error }.into())
            }
            _ => Ok(adapted),
        }
    }

    /// Returns the default answer: the current value if it is valid, otherwise a valid value near it. `None` if no
    /// value is valid with the earlier answers.
    pub fn suggested_value(&self, path: &'static str) -> Option<String> {
        self.nearest_valid(path, |draft| draft.clone().settle(path).is_ok()).map(|value| shown(&value))
    }

    /// Returns the robot if the draft is valid.
    ///
    /// # Errors
    /// The first error in the draft.
    pub fn robot(&self) -> Result<Robot, RobotFileError> {
        robot_file::parse(&self.document.to_string(), &self.shown(NAME).replace('"', ""))
    }

    /// Returns the robot and the text of its file: the existing file with its comments and the new values. Comments
    /// mark the values that the user gave (`given`), and values that were changed.
    ///
    /// # Errors
    /// Errors of [`Draft::robot`].
    pub fn file(&self, given: &[&'static str]) -> Result<(Robot, String), RobotFileError> {
        let robot = self.robot()?;
        let mut document = self.document.clone();
        for path in paths(self.document.as_item(), "") {
            let was = look_up(self.first.as_item(), &path).map(shown);
            let Some(value) = look_up_mut(document.as_item_mut(), &path) else { continue };
            let (given, changed) = (given.contains(&path.as_str()), was.as_ref() != Some(&shown(value)));
            if !given && !changed && self.left_out.contains(&path.as_str()) {
                remove(document.as_item_mut(), &path);
                continue;
            }
            if path == NAME || !(changed || given || path == PLANNING_RADIUS) {
                continue;
            }
            let old = trailing_comment(value);
            let mut comment = match (given, changed) {
                (true, _) => "given".to_owned(),
                (false, true) => "adapted".to_owned(),
                (false, false) if is_assumed(&old) => old.clone(),
                (false, false) => format!("as {}", self.base),
            };
            if path == PLANNING_RADIUS {
                comment += &format!("; R_min is {:.2}", robot.min_radius());
            } else if let (true, Some(was)) = (changed, was) {
                let old = if old.is_empty() { old } else { format!(", {old}") };
                comment += &format!("; {} has {was}{old}", self.base);
            }
            value.decor_mut().set_suffix(format!(" # {comment}"));
        }
        let body = document.to_string();
        // The comment at the top describes the existing robot.
        let body: String = body.split_inclusive('\n').skip_while(|line| line.starts_with('#')).collect();
        let name = robot.name();
        let mut text = self.directives.clone();
        text += &comment(&format!(
            "{name}: created by `growbot new-robot` from {}. \"given\" marks an answer, \"adapted\" a value adjusted \
             to the answers, \"assumed\" a value that has not been measured: measure it before relying on it. Other \
             remarks are from {}:",
            self.base, self.base
        ));
        text += "#\n";
        text += &comment(&self.about);
        if !body.starts_with('\n') {
            text.push('\n');
        }
        text += &body;
        // The written text is checked as it will be read.
        let robot = robot_file::parse(&text, name)?;
        Ok((robot, text))
    }

    fn value(&self, path: &str) -> Option<&Value> {
        look_up(self.document.as_item(), path)
    }

    /// Sets a field and keeps its comment.
    fn put(&mut self, path: &str, mut value: Value) {
        if let Some(old) = look_up_mut(self.document.as_item_mut(), path) {
            *value.decor_mut() = old.decor().clone();
            *old = value;
            return;
        }
        *value.decor_mut() = toml_edit::Decor::new(" ", "");
        let mut item = self.document.as_item_mut();
        for key in path.split('.') {
            item = &mut item[key];
        }
        *item = Item::Value(value);
    }

    /// Converts an answer to a value of the field's type.
    fn parse_answer(&self, path: &'static str, text: &str) -> Result<Value, AnswerError> {
        let text = text.trim();
        let refused = |kind| AnswerError::Kind { path, text: text.to_owned(), kind };
        match self.value(path) {
            Some(Value::Integer(_)) => {
                let whole: u32 = text.parse().map_err(|_| refused("a whole number, 0 or more"))?;
                Ok(i64::from(whole).into())
            }
            Some(Value::Float(_)) if text == NO_LIMIT => Ok(1e9.into()),
            Some(Value::Float(_)) => {
                let number: f64 = text.parse().map_err(|_| refused("a number such as 1.5"))?;
                Ok(number.into())
            }
            _ => Ok(text.trim_matches('"').into()),
        }
    }

    /// Returns the error of the draft if it concerns the field `path`, or a field whose question comes earlier. Other
    /// errors are ignored.
    fn check_up_to(&self, path: &str) -> Result<(), AnswerError> {
        let place = |path: &str| ASKED_FIELDS.iter().position(|question| *question == path);
        match self.robot() {
            Ok(_) => Ok(()),
            Err(RobotFileError::Robot { file, error }) => {
                let at = place(field_of(&error));
                if at.is_some_and(|at| Some(at) <= place(path)) {
                    return Err(RobotFileError::Robot { file, error }.into());
                }
                Ok(())
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Changes fields without a question until none of them has an error.
    fn adapt(&mut self) -> Vec<Adjustment> {
        let mut adapted = Vec::new();
        // Each field is changed once. An error that remains is reported when the file is written.
        while let Err(RobotFileError::Robot { error, .. }) = self.robot() {
            let path = field_of(&error);
            if ASKED_FIELDS.contains(&path) || adapted.iter().any(|done: &Adjustment| done.path == path) {
                break;
            }
            let mended = |draft: &Self| match draft.robot() {
                Err(RobotFileError::Robot { error, .. }) => field_of(&error) != path,
                _ => true,
            };
            let from = self.shown(path);
            let Some(value) = self.nearest_valid(path, mended) else { break };
            adapted.push(Adjustment { path: path.to_owned(), from, to: shown(&value) });
            self.put(path, value);
        }
        adapted
    }

    /// Returns the present value of a field if `good` accepts the draft with it, otherwise a value near it that
    /// `good` accepts. The candidates are the value scaled as in `IN_PROPORTION`, the violated limit, and steps of a
    /// quarter.
    fn nearest_valid(&self, path: &str, good: impl Fn(&Self) -> bool) -> Option<Value> {
        let value = self.value(path)?.clone();
        let (number, whole) = match &value {
            Value::Float(number) => (*number.value(), false),
            Value::Integer(number) => (*number.value() as f64, true),
            _ => return good(self).then_some(value),
        };
        let mut candidates = vec![number];
        if let Some((_, other)) = IN_PROPORTION.iter().find(|(of, _)| *of == path) {
            let number_in = |document: &DocumentMut| look_up(document.as_item(), other).and_then(Value::as_float);
            if let (Some(was), Some(is)) = (number_in(&self.first), number_in(&self.document)) {
                candidates.push(rounded(number * is / was, f64::round));
            }
        }
        if let Err(RobotFileError::Robot {
            error: RobotError::TooSmall { limit, .. } | RobotError::TooLarge { limit, .. },
            ..
        }) = self.robot()
        {
            candidates.extend([rounded(limit, f64::ceil), rounded(limit, f64::floor)]);
        }
        candidates.extend((1..60).flat_map(|step| {
            let factor = libm::pow(1.25, f64::from(step));
            [rounded(number * factor, f64::round), rounded(number / factor, f64::round)]
        }));
        candidates.into_iter().find_map(|candidate| {
            let candidate = if whole { (candidate.round() as i64).into() } else { candidate.into() };
            let mut draft = self.clone();
            draft.put(path, candidate);
            if good(&draft) { draft.value(path).cloned() } else { None }
        })
    }
}

/// Rounds to three significant digits, by the function `round`.
fn rounded(number: f64, round: fn(f64) -> f64) -> f64 {
    if number == 0.0 || !number.is_finite() {
        return number;
    }
    let digits = 2 - libm::floor(libm::log10(number.abs())) as i32;
    if digits >= 0 {
        let scale = libm::pow(10.0, f64::from(digits));
        round(number * scale) / scale
    } else {
        let scale = libm::pow(10.0, f64::from(-digits));
        round(number / scale) * scale
    }
}

/// Returns the field that an error is about. If it is about several fields, the one whose question comes last.
fn field_of(error: &RobotError) -> &'static str {
    let field = match error {
        RobotError::NotFinite { field, .. }
        | RobotError::TooSmall { field, .. }
        | RobotError::TooLarge { field, .. } => field,
        RobotError::Name | RobotError::TooLong | RobotError::Unreadable | RobotError::VersionMismatch { .. } => NAME,
        RobotError::ThermistorEquation => "thermistor",
        RobotError::Pins(_) | RobotError::Drivers(_) => "board",
    };
    match field {
        "layer.period_s * motion.tick_hz" => "motion.tick_hz",
        "head steps in the busiest sector" => "head.steps_per_turn",
        "feed steps in the busiest sector" => "feed.steps_per_mm",
        "head acceleration within a layer" => "head.acceleration_turns_per_s2",
        "feed acceleration within a layer" => "feed.acceleration_mm_per_s2",
        field => field,
    }
}

#[cfg(test)]
mod tests;
