//! Tests of tuning the heater through the service.

use serde_json::{Value, json};

use crate::lab::{Lab, wait_for};
use crate::running::in_lines;

fn tune(lab: &Lab, body: &Value) -> (u16, Value) {
    lab.ask("POST", "/robots/lab/tuning", &body.to_string())
}

fn robot(lab: &Lab) -> Value {
    lab.ask("GET", "/robots/lab", "").1
}

/// The gains are in the status until the next tuning, and both programs find the same ones.
#[test]
fn the_service_tunes_and_shows_the_gains() {
    let lab = Lab::new(300.0);
    lab.wait_until_ready();
    assert_eq!(robot(&lab)["tuning"], Value::Null);
    let (status, response) = tune(&lab, &json!({ "target_c": 210.0 }));
    assert_eq!(status, 200, "{response}");
    let message = "the simulated robot tunes its heater at 210 C, which takes some minutes: the nozzle gets hot, and \
                   no motor moves";
    assert_eq!(response["message"], message);
    lab.wait_for_state("tuning");
    // Nothing else begins meanwhile.
    let (status, problem) = lab.ask("POST", "/robots/lab/jobs", r#"{"to":"0,0,60,0,90"}"#);
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("robot lab tunes its heater"), "{problem}");
    let (code, text) = lab.run(&["tune", "--port", "sim:lab"]);
    assert!(code == Some(1) && in_lines(&text).contains("tunes its heater"), "{text}");
    let found = wait_for("the gains", || Some(robot(&lab)["tuning"].clone()).filter(|tuning| !tuning.is_null()));
    assert!(found["kp"].as_f64().unwrap() > 0.0 && found["simulated"] == true, "{found}");
    lab.wait_for_state("idle");
    let (code, text) = lab.run(&["status", "--json", "--port", "sim:lab"]);
    assert_eq!((code, &serde_json::from_str::<Value>(&text).unwrap()["tuning"]), (Some(0), &found), "{text}");
    let (code, text) = lab.run(&["tune", "--target", "210", "--json", "--port", "sim:lab"]);
    assert_eq!(code, Some(0), "{text}");
    let line = text.lines().find(|line| line.starts_with('{')).unwrap();
    let by_command: Value = serde_json::from_str(line).unwrap();
    assert_eq!(by_command.as_object().unwrap().keys().len(), found.as_object().unwrap().keys().len());
    let ratio = by_command["kp"].as_f64().unwrap() / found["kp"].as_f64().unwrap();
    assert!((0.5..2.0).contains(&ratio), "{by_command} {found}");
}

/// The time of this robot passes only while the service waits for it.
#[test]
fn each_tuning_of_a_robot_with_a_virtual_clock_has_its_own_gains() {
    let lab = Lab::configured("[robots.lab]\nport = \"sim\"\nrobot = \"growbot-a2\"\n");
    lab.wait_until_ready();
    let mut found = Vec::new();
    for target_c in [200.0, 150.0] {
        let (status, response) = tune(&lab, &json!({ "target_c": target_c }));
        assert_eq!(status, 200, "{response}");
        assert_eq!(response["tuning"], Value::Null, "the gains of an earlier tuning are not those of this one");
        found.push(wait_for("the gains", || Some(robot(&lab)["tuning"].clone()).filter(|tuning| !tuning.is_null())));
        assert_eq!(robot(&lab)["state"], "idle");
    }
    assert_ne!(found[0], found[1]);
}

#[test]
fn a_stop_ends_a_tuning() {
    let lab = Lab::new(60.0);
    lab.wait_until_ready();
    for (stop, state) in [("stop", "stopped"), ("emergency-stop", "emergency-stop")] {
        assert_eq!(tune(&lab, &json!({})).0, 200);
        lab.wait_for_state("tuning");
        let (status, response) = lab.ask("POST", "/robots/lab/commands", &json!({ "command": stop }).to_string());
        assert_eq!(status, 200, "{response}");
        lab.wait_for_state(state);
        assert_eq!(robot(&lab)["tuning"], Value::Null, "a tuning that was stopped has found nothing");
    }
    let (status, problem) = tune(&lab, &json!({}));
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("emergency-stop"), "{problem}");
    let (status, problem) = tune(&lab, &json!({ "target_c": 900.0 }));
    assert!(status == 409, "{problem}");
}

#[test]
fn a_growth_is_not_disturbed_by_a_tuning() {
    let lab = Lab::new(60.0);
    lab.wait_until_ready();
    assert_eq!(lab.ask("POST", "/robots/lab/jobs", r#"{"to":"0,0,300,0,90"}"#).0, 201);
    lab.wait_for_state("growing");
    let (status, problem) = tune(&lab, &json!({}));
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("stop the job first"), "{problem}");
    let reader = format!("/{}/api/v1/robots/lab/tuning", lab.pages.as_ref().unwrap().1[1]);
    assert_eq!(lab.ask_page(&reader, &["content-type: application/json"], "POST", "{}"), 403);
}
