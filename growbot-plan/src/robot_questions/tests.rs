use super::*;

fn draft() -> Draft {
    let (text, file) = robot_file::text_of("growbot-a".as_ref()).unwrap();
    Draft::of(&text, &file, "mine").unwrap()
}

#[test]
fn default_answers_keep_the_base_robot() {
    for base in robot_file::names() {
        let (text, file) = robot_file::text_of(base.as_ref()).unwrap();
        let mut draft = Draft::of(&text, &file, "mine").unwrap();
        for path in ASKED_FIELDS {
            let default = draft.suggested_value(path).unwrap();
            assert_eq!(draft.apply_answer(path, &default).unwrap(), [], "{base}: {path}");
        }
        let (robot, written) = draft.file(&[]).unwrap();
        let begun = robot_file::load(base.as_ref()).unwrap();
        let mut description = begun.description().clone();
        description.name = robot.description().name.clone();
        assert_eq!(robot.description(), &description, "{base}");
        // The files have the same number of value lines and of assumptions.
        let settings = |text: &str| text.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).count();
        assert_eq!(settings(&written), settings(&text), "{base}");
        assert_eq!(written.matches("# assumed").count(), text.matches("# assumed").count(), "{base}");
    }
}

#[test]
fn defaults_follow_earlier_answers() {
    let mut draft = draft();
    for (path, answer, next, default) in [
        ("geometry.inner_radius_mm", "24", "geometry.tip_radius_mm", "44.0"),
        ("layer.height_mm", "0.2", "layer.height_min_mm", "0.0775"),
        ("heater.max_c", "190", "heater.target_c", "185.0"),
    ] {
        draft.apply_answer(path, answer).unwrap();
        assert_eq!(draft.suggested_value(next).as_deref(), Some(default));
        draft.apply_answer(next, default).unwrap();
    }
    // R_min is far smaller now, so the radius of plans stays valid.
    assert_eq!(draft.suggested_value(PLANNING_RADIUS).as_deref(), Some("100.0"));
    draft.apply_answer("heater.extrusion_min_c", &draft.suggested_value("heater.extrusion_min_c").unwrap()).unwrap();
    assert!(draft.file(&[]).is_ok());

    let mut draft = self::draft();
    draft.apply_answer("geometry.inner_length_mm", "90").unwrap();
    let radius: f64 = draft.suggested_value(PLANNING_RADIUS).unwrap().parse().unwrap();
    draft.apply_answer(PLANNING_RADIUS, &radius.to_string()).unwrap();
    let r_min = draft.robot().unwrap().min_radius();
    assert!(r_min > 100.0 && (r_min..r_min * 1.01).contains(&radius), "{radius} for {r_min}");
}

#[test]
fn dependent_fields_are_adapted_and_reported() {
    let mut draft = draft();
    let adapted = draft.apply_answer("head.steps_per_turn", "100").unwrap();
    assert_eq!(
        adapted.iter().map(|change| change.path.as_str()).collect::<Vec<_>>(),
        ["head.index_width_deg", "head.index_tolerance_deg"]
    );
    let (_, text) = draft.file(&["head.steps_per_turn"]).unwrap();
    assert!(text.contains("steps_per_turn = 100 # given; growbot-a has 3200, assumed: 200 full steps"), "{text}");
    assert!(text.contains("index_width_deg = 7.2 # adapted; growbot-a has 5.0, assumed"), "{text}");
}

#[test]
fn invalid_answers_are_refused_with_value_limit_and_remedy() {
    for (path, answer, part) in [
        ("geometry.tip_radius_mm", "10", "geometry.tip_radius_mm is 10, below 12: the tube (r_t) must be wider"),
        ("geometry.tip_radius_mm", "wide", "invalid value \"wide\" for geometry.tip_radius_mm: expected a number"),
        ("geometry.tip_radius_mm", "nan", "is NaN"),
        ("planning_radius_mm", "90", "planning_radius_mm is 90, below 98.2"),
        ("motion.tick_hz", "-1", "a whole number"),
        ("motion.strategy", "fead", "did you mean feed?"),
        ("heater.target_c", "500", "above 235"),
        (NAME, "My Robot", "lower-case letters"),
        (NAME, "growbot-b", "growbot-b is the name of a built-in robot"),
        (NAME, "", "not be empty"),
    ] {
        let mut draft = draft();
        let message = draft.apply_answer(path, answer).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
        assert_eq!(draft.document.to_string(), self::draft().document.to_string());
    }
}

#[test]
fn the_schema_line_stays_at_the_top() {
    let (text, file) = robot_file::text_of("growbot-a".as_ref()).unwrap();
    let text = format!("#:schema ./robot.json\n{text}");
    let (_, written) = Draft::of(&text, &file, "mine").unwrap().file(&[]).unwrap();
    assert!(written.starts_with("#:schema ./robot.json\n# mine: created by"), "{written}");
    assert_eq!(written.matches("#:schema").count(), 1);
}

#[test]
fn suggested_values_are_always_accepted() {
    for name in ["growbot-a", "growbot-b"] {
        let (text, file) = robot_file::text_of(name.as_ref()).unwrap();
        // Holds the suggested value of every field before `at`.
        let mut before = Draft::of(&text, &file, "ours").unwrap();
        for (at, field) in ASKED_FIELDS.iter().enumerate() {
            for factor in [0.5, 1.3, 2.0] {
                let mut draft = before.clone();
                let mut given = Vec::new();
                for (index, path) in ASKED_FIELDS.into_iter().enumerate().skip(at) {
                    let Some(proposed) = draft.suggested_value(path) else { break };
                    if index == at
                        && let Ok(number) = proposed.parse::<f64>()
                        && draft.apply_answer(path, &(number * factor).to_string()).is_ok()
                    {
                        given.push(path);
                        continue;
                    }
                    let taken = draft.apply_answer(path, proposed.trim_matches('"'));
                    assert!(taken.is_ok(), "{name}, {field} times {factor}: {path} = {proposed}: {taken:?}");
                }
                draft.file(&given).unwrap_or_else(|error| panic!("{name}, {field} times {factor}: {error}"));
            }
            let Some(proposed) = before.suggested_value(field) else { break };
            before.apply_answer(field, proposed.trim_matches('"')).unwrap();
        }
    }
}
