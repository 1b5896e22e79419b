//! Tests of the bodies that wait for a robot of the service.

use serde_json::{Value, json};

use crate::lab::Lab;
use crate::running::command;

fn queue(lab: &Lab) -> Value {
    lab.ask("GET", "/robots/lab/queue", "").1
}

/// Adds a body to the queue. Returns the status and the response.
fn push(lab: &Lab, body: &Value) -> (u16, Value) {
    lab.ask("POST", "/robots/lab/queue", &body.to_string())
}

/// Orders to grow a queued body. Returns the status and the response.
fn grow(lab: &Lab, body: &Value, is_removed: bool) -> (u16, Value) {
    let path = format!("/robots/lab/queue/{}/grow", body["id"].as_str().unwrap());
    lab.ask("POST", &path, &json!({ "last_body_removed": is_removed }).to_string())
}

#[test]
fn a_queued_body_grows_only_after_a_person_has_removed_the_last_one() {
    let mut lab = Lab::new(300.0);
    lab.wait_until_ready();
    assert_eq!(queue(&lab), json!([]));
    let (status, first) = push(&lab, &json!({ "to": "0,0,60,0,90", "name": "first" }));
    assert!(status == 201 && first["name"] == "first" && first["layers"].as_u64() > Some(10), "{first}");
    let (status, second) = push(&lab, &json!({ "to": "0,0,40,0,90" }));
    assert!(status == 201 && second["name"] == "0,0,40,0,90" && second["id"] != first["id"], "{second}");
    // Neither the queue nor a restart of the service begins anything.
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    assert_eq!(queue(&lab), json!([first, second]));
    assert_eq!(lab.ask("GET", "/jobs", "").1, json!([]));
    let (status, problem) = grow(&lab, &first, false);
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("last body"), "{problem}");
    let (status, job) = grow(&lab, &first, true);
    assert!(status == 201 && job["name"] == "first", "{job}");
    // The next body waits while the first one grows, also if a person confirms. The first one does not end meanwhile,
    // because its robot does not run.
    let signal = |name: &str| assert!(command("kill").args([name, &lab.robot_process()]).status().unwrap().success());
    signal("-STOP");
    let (status, problem) = grow(&lab, &second, true);
    signal("-CONT");
    assert_eq!(status, 409, "{problem}");
    assert_eq!(queue(&lab), json!([second]));
    assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done");
    assert_eq!(queue(&lab), json!([second]), "nothing takes a body from the queue by itself");
    assert_eq!(grow(&lab, &first, true).0, 404);
    let (status, job) = grow(&lab, &second, true);
    assert!(status == 201, "{job}");
    assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done");
    assert_eq!(queue(&lab), json!([]));
}

#[test]
fn a_body_is_queued_and_removed_under_the_rules_of_a_job() {
    let lab = Lab::new(300.0);
    lab.wait_until_ready();
    let (status, problem) = push(&lab, &json!({ "to": "0,0,4000,0,90" }));
    assert_eq!((status, &problem["code"]), (409, &json!("plan-warnings")), "{problem}");
    let (status, problem) = push(&lab, &json!({ "to": "0,0,30,0,90", "scene": "/tmp/scene.toml" }));
    assert!(status == 422 && problem["detail"].as_str().unwrap().contains("/scenes"), "{problem}");
    assert_eq!(lab.ask("POST", "/robots/none/queue", r#"{"to":"0,0,30,0,90"}"#).0, 404);
    let reader = format!("/{}/api/v1/robots/lab/queue", lab.pages.as_ref().unwrap().1[1]);
    assert_eq!(lab.ask_page(&reader, &["content-type: application/json"], "POST", r#"{"to":"0,0,30,0,90"}"#), 403);
    for count in 0..50 {
        let (status, body) = push(&lab, &json!({ "to": format!("0,0,{},0,90", 30 + count) }));
        assert_eq!(status, 201, "{body}");
    }
    let (status, problem) = push(&lab, &json!({ "to": "0,0,30,0,90" }));
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("50 bodies"), "{problem}");
    let bodies = queue(&lab);
    let path = |index: usize| format!("/robots/lab/queue/{}/remove", bodies[index]["id"].as_str().unwrap());
    let (status, left) = lab.ask("POST", &path(1), "");
    assert_eq!((status, left.as_array().unwrap().len(), &left[1]), (200, 49, &bodies[2]));
    assert_eq!(lab.ask("POST", &path(1), "").0, 404);
    let front = path(5).replace("remove", "front");
    let (status, moved) = lab.ask("POST", &front, "");
    assert_eq!((status, moved.as_array().unwrap().len(), &moved[0]), (200, 49, &bodies[5]));
    assert_eq!((&moved[1], queue(&lab)), (&bodies[0], moved.clone()));
    assert_eq!(lab.ask("POST", &path(1).replace("remove", "front"), "").0, 404);
}
