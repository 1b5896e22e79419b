//! A new robot from one that there is: what is asked, which answers can be, and the file that comes of them.
//!
//! The file begun with is kept with its comments. Each answer goes into it and the whole is checked as any robot file
//! is ([`robot_file::parse`]); what the check finds wrong with the answer, or with one given before, refuses it.

mod toml_values;

use growbot_client::robot_file::{self, RobotFileError};
use growbot_core::robot::{Robot, RobotError};
use toml_edit::{DocumentMut, Item, Value};

use crate::robot_explained::{is_assumed, opening_comment};
use toml_values::{comment, look_up, look_up_mut, paths, remark, remove, shown};

/// What is asked, in this order: a field comes after those that bound it.
pub const QUESTIONS: [&str; 24] = [
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
    RADIUS,
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

/// The field that says what the robot is called.
pub const NAME: &str = "name";
/// The field whose remark tells `R_min`.
const RADIUS: &str = "planning_radius_mm";

/// What is as good as no limit, as TOML.
pub const UNLIMITED: &str = "1000000000.0";
/// How people say so.
pub const NO_LIMIT: &str = "no limit";

/// What grows with what: where a value cannot stay, it is changed as the other one was.
const IN_PROPORTION: [(&str, &str); 3] = [
    ("geometry.tip_radius_mm", "geometry.inner_radius_mm"),
    ("layer.height_min_mm", "layer.height_mm"),
    ("layer.height_max_mm", "layer.height_mm"),
];

/// Why an answer was not taken.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// No value of this kind.
    #[error("{path} cannot be {text:?}: give {kind}")]
    Kind {
        /// The field.
        path: &'static str,
        /// What was answered.
        text: String,
        /// What it must be.
        kind: &'static str,
    },
    /// The name is taken.
    #[error("{name} is built in, and plans tell robots apart by name: choose another name")]
    BuiltIn {
        /// The name.
        name: String,
    },
    /// A robot like that cannot be.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
}

/// A value that was changed so that others can be.
#[derive(Debug, PartialEq)]
pub struct Adapted {
    /// The field.
    pub path: String,
    /// What it was.
    pub from: String,
    /// What it is.
    pub to: String,
}

/// A robot that is being described.
#[derive(Debug, Clone)]
pub struct Draft {
    document: DocumentMut,
    /// What it began as: the file, with what it leaves out of what is asked.
    first: DocumentMut,
    left_out: Vec<&'static str>,
    /// The robot that it began as.
    base: String,
    about: String,
    /// Lines at the top that are for tools, such as `#:schema`.
    directives: String,
}

impl Draft {
    /// Begins with this robot file, called so in messages, under another name.
    ///
    /// # Errors
    /// What is no robot file.
    pub fn of(text: &str, file: &str, name: &str) -> Result<Self, RobotFileError> {
        let robot = robot_file::parse(text, file)?;
        let mut draft = Self {
            // Parses: it has just been read as a robot file.
            document: text.parse().unwrap_or_default(),
            first: DocumentMut::new(),
            left_out: Vec::new(),
            base: robot.name().to_owned(),
            about: opening_comment(text),
            directives: text.split_inclusive('\n').filter(|line| line.starts_with("#:")).collect(),
        };
        // What the file leaves out is asked for too, and may be given.
        let written = toml::to_string(robot.description()).unwrap_or_default();
        let whole: DocumentMut = written.parse().unwrap_or_default();
        for path in QUESTIONS {
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

    /// The value of a field, as TOML.
    #[must_use]
    pub fn shown(&self, path: &str) -> String {
        self.value(path).map(shown).unwrap_or_default()
    }

    /// Takes an answer; gives what had to be changed that is not asked for.
    ///
    /// # Errors
    /// Why not; the draft is then as it was.
    pub fn answer(&mut self, path: &'static str, text: &str) -> Result<Vec<Adapted>, Refused> {
        let value = self.understood(path, text)?;
        if path == NAME && value.as_str().is_some_and(robot_file::is_built_in) {
            return Err(Refused::BuiltIn { name: text.to_owned() });
        }
        let mut changed = self.clone();
        changed.put(path, value);
        let adapted = changed.settle(path)?;
        *self = changed;
        Ok(adapted)
    }

    /// Changes what is not asked for so that it goes with the answers up to this field.
    fn settle(&mut self, path: &str) -> Result<Vec<Adapted>, Refused> {
        self.refused_at(path)?;
        let adapted = self.adapt();
        match self.robot() {
            // Nobody asks for it any more: it would be refused when the file is written.
            Err(RobotFileError::Robot { file, error }) if !QUESTIONS.contains(&field_of(&error)) => {
                Err(RobotFileError::Robot { file, error }.into())
            }
            _ => Ok(adapted),
        }
    }

    /// What is taken where nothing is answered: the value that the field has if it can stay, else one near it that can
    /// be. None where no value goes with the answers before.
    #[must_use]
    pub fn default(&self, path: &'static str) -> Option<String> {
        self.possible(path, |draft| draft.clone().settle(path).is_ok()).map(|value| shown(&value))
    }

    /// The robot, if all is well.
    ///
    /// # Errors
    /// What is not.
    pub fn robot(&self) -> Result<Robot, RobotFileError> {
        robot_file::parse(&self.document.to_string(), &self.shown(NAME).replace('"', ""))
    }

    /// The file: the one begun with, with its comments, and what was given or changed marked as such.
    ///
    /// # Errors
    /// As [`Draft::robot`].
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
            if path == NAME || !(changed || given || path == RADIUS) {
                continue;
            }
            let old = remark(value);
            let mut said = match (given, changed) {
                (true, _) => "given".to_owned(),
                (false, true) => "adapted".to_owned(),
                (false, false) if is_assumed(&old) => old.clone(),
                (false, false) => format!("as {}", self.base),
            };
            if path == RADIUS {
                said += &format!("; R_min is {:.2}", robot.min_radius());
            } else if let (true, Some(was)) = (changed, was) {
                let old = if old.is_empty() { old } else { format!(", {old}") };
                said += &format!("; {} has {was}{old}", self.base);
            }
            value.decor_mut().set_suffix(format!(" # {said}"));
        }
        let body = document.to_string();
        // The comment at the top tells of the robot begun with.
        let body: String = body.split_inclusive('\n').skip_while(|line| line.starts_with('#')).collect();
        let name = robot.name();
        let mut text = self.directives.clone();
        text += &comment(&format!(
            "{name}: begun by `growbot new-robot` from {}. \"given\" marks what was answered, \"adapted\" what had to \
             follow from it, \"assumed\" what nobody has measured: measure it before you rely on it. Other remarks \
             are those of {}:",
            self.base, self.base
        ));
        text += "#\n";
        text += &comment(&self.about);
        if !body.starts_with('\n') {
            text.push('\n');
        }
        text += &body;
        // What is written is what is read: the file is checked as it is.
        let robot = robot_file::parse(&text, name)?;
        Ok((robot, text))
    }

    fn value(&self, path: &str) -> Option<&Value> {
        look_up(self.document.as_item(), path)
    }

    /// Sets a field; its comment stays.
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

    /// A text as a value of the kind that the field has.
    fn understood(&self, path: &'static str, text: &str) -> Result<Value, Refused> {
        let text = text.trim();
        let refused = |kind| Refused::Kind { path, text: text.to_owned(), kind };
        match self.value(path) {
            Some(Value::Integer(_)) => {
                let whole: u32 = text.parse().map_err(|_| refused("a whole number, 0 or more"))?;
                Ok(i64::from(whole).into())
            }
            Some(Value::Float(_)) if text == NO_LIMIT => Ok(1e9.into()),
            Some(Value::Float(_)) => {
                let number: f64 = text.parse().map_err(|_| refused("a number, say 1.5"))?;
                Ok(number.into())
            }
            _ => Ok(text.trim_matches('"').into()),
        }
    }

    /// Whether this field, or one asked for before it, is refused.
    fn refused_at(&self, path: &str) -> Result<(), Refused> {
        let place = |path: &str| QUESTIONS.iter().position(|question| *question == path);
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

    /// Changes what is not asked for until nothing of it is refused.
    fn adapt(&mut self) -> Vec<Adapted> {
        let mut adapted = Vec::new();
        // Each field once: what cannot be mended that way is refused when the file is written.
        while let Err(RobotFileError::Robot { error, .. }) = self.robot() {
            let path = field_of(&error);
            if QUESTIONS.contains(&path) || adapted.iter().any(|done: &Adapted| done.path == path) {
                break;
            }
            let mended = |draft: &Self| match draft.robot() {
                Err(RobotFileError::Robot { error, .. }) => field_of(&error) != path,
                _ => true,
            };
            let from = self.shown(path);
            let Some(value) = self.possible(path, mended) else { break };
            adapted.push(Adapted { path: path.to_owned(), from, to: shown(&value) });
            self.put(path, value);
        }
        adapted
    }

    /// The value of this field if it is good, else the limit that it broke, or else the nearest good value by steps of
    /// a quarter.
    fn possible(&self, path: &str, good: impl Fn(&Self) -> bool) -> Option<Value> {
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

/// To three digits, by this way of rounding.
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

/// The field that an error is about: of those that are about several, the one that is asked for last.
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
