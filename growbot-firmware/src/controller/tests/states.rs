//! Tests of every event in every state: the board behaves as the state tables in the code and in SAFETY.md define.

use std::string::String;
use std::{env, format, fs};

use growbot_core::link::message::{
    Cancel, MaintenanceTask, Message, PlanRequest, PoseFields, Refusal, RefusalResponse, State,
};
use growbot_core::plan::Planner;

use super::bench::Bench;
use super::requests::{
    PLAN, amend, batch_of, begin, bends, clear, feed, maintain, pause, preheat, resume, start, stop, tune,
};
use crate::safety::transitions::{Event, next_state};

/// Returns the request that causes an event. `None` if the event occurs on the robot itself.
fn request(event: Event, bench: &mut Bench) -> Option<Message> {
    let next = bench.status().next_layer;
    Some(match event {
        Event::Begin => begin(&bench.robot.clone(), PLAN, 40),
        Event::Plan => {
            let pose =
                |z: f64| PoseFields { position: [0.0, 0.0, z], heading: 0.0, pitch: core::f64::consts::FRAC_PI_2 };
            Message::Plan(PlanRequest { start: pose(0.0), goal: pose(20.0), radius: 100.0, planner: Planner::TwoPlane })
        }
        Event::Layers => batch_of(next as usize, &bends(usize::from(next < 40))),
        Event::Resume => resume(bench.status().layers_laid),
        Event::Amend => amend(next, 50),
        Event::Cancel => Message::Cancel(Cancel { plan_id: bench.status().plan_id }),
        Event::Start => start(),
        Event::Pause => pause(),
        Event::Tune => tune(200.0),
        Event::Preheat => preheat(200.0),
        Event::CoolDown => maintain(MaintenanceTask::CoolDown),
        Event::MoveHead => maintain(MaintenanceTask::Rotate { centi_deg: 100 }),
        Event::MoveFilament => feed(1.0),
        Event::Stop => stop(),
        Event::Clear => clear(),
        _ => return None,
    })
}

#[test]
fn transitions_match_the_table_for_every_event_and_state() {
    for state in State::ALL {
        for event in Event::ALL {
            let mut bench = Bench::in_state(state);
            let expected = next_state(state, event);
            let status = bench.status();
            let Some(request) = request(event, &mut bench) else {
                // This event occurs on the robot itself.
                assert_eq!(bench.controller.apply_event(event), expected.is_some(), "{state:?}, {event:?}");
                assert_eq!(bench.controller.state(), expected.unwrap_or(state), "{state:?}, {event:?}");
                continue;
            };
            match (bench.ask(&request), expected) {
                (Message::Refused(RefusalResponse { refusal, .. }), None) => {
                    assert!(
                        matches!(refusal, Refusal::WrongState { .. } | Refusal::PlanMismatch { .. }),
                        "{state:?}, {event:?}: {refusal:?}"
                    );
                    assert_eq!(bench.status(), status, "{state:?}, {event:?}: refused and changed something");
                }
                (Message::Accepted(_) | Message::Planned(_), Some(to)) => {
                    assert_eq!(bench.controller.state(), to, "{state:?}, {event:?}");
                }
                (answer, _) => panic!("{state:?}, {event:?}: {answer:?}, and the table says {expected:?}"),
            }
        }
    }
}

/// Returns the table of states and events in the format of SAFETY.md, with states in the order of the table before it.
fn table() -> String {
    let (_, described) = include_str!("../../../../SAFETY.md").split_once("| state |").expect("SAFETY.md lists states");
    let mut states = State::ALL;
    states.sort_by_key(|state| described.find(state.name()));
    let mut text = String::from("| event | accepted in | leads to |\n|---|---|---|\n");
    for event in Event::ALL {
        let mut rows: std::vec::Vec<(Option<State>, std::vec::Vec<&str>)> = std::vec::Vec::new();
        for state in states {
            let Some(to) = next_state(state, event) else { continue };
            let to = (to != state).then_some(to);
            match rows.iter_mut().find(|(other, _)| *other == to) {
                Some((_, states)) => states.push(state.name()),
                None => rows.push((to, std::vec![state.name()])),
            }
        }
        for (to, states) in rows {
            let to = to.map_or("the same", State::name);
            text += &format!("| {} | {} | {to} |\n", event.name(), states.join(", "));
        }
    }
    text
}

#[test]
fn safety_md_has_the_current_state_table() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../SAFETY.md");
    let printed = fs::read_to_string(path).expect("SAFETY.md is there");
    let (from, to) = ("<!-- states: made by the tests -->\n", "<!-- end of states -->");
    let (before, rest) = printed.split_once(from).expect("SAFETY.md has a place for the table");
    let (now, after) = rest.split_once(to).expect("the table has an end");
    let made = table();
    if env::var_os("GROWBOT_WRITE_TABLES").is_some() {
        fs::write(path, [before, from, &made, to, after].concat()).expect("SAFETY.md can be written");
    } else {
        assert_eq!(now, made, "run the tests once with GROWBOT_WRITE_TABLES=1, and read what has changed");
    }
}
