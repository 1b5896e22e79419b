//! Orders given while a body grows on the simulated robot: it holds, goes on and stops, and lays each layer once.

use growbot_core::link::message::{Silence, State};
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::client::Client;
use growbot_host::growth::{Grown, Job, News, Order, Orders, Outcome, grow_job};
use growbot_host::port::sim::Sim;

/// Grows 20 upright layers; `order` sees all news and gives orders. Also what was told.
fn grow(mut order: impl FnMut(&News, &Orders)) -> (Grown, Vec<News>) {
    let robot: Robot = growbot_host::robot_file::load("growbot-a".as_ref()).unwrap();
    let path = [Segment::Straight { length: 20.0 * 0.774 }];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let mut client = Client::new(Box::new(Sim::new(robot.clone())), "sim");
    let (orders, mut told) = (Orders::default(), Vec::new());
    let grown = grow_job(&mut client, &job, Silence::Hold, &orders, &mut |news| {
        order(news, &orders);
        told.push(news.clone());
    });
    (grown.unwrap(), told)
}

fn tells(told: &[News], wanted: &News) -> usize {
    told.iter().filter(|news| *news == wanted).count()
}

#[test]
fn a_growth_holds_and_goes_on_as_ordered_and_each_layer_is_laid_once() {
    let (grown, told) = grow(|news, orders| match news {
        News::Laid(4, ..) => orders.give(Order::Hold),
        News::State(State::Hold) => orders.give(Order::GoOn),
        _ => {}
    });
    assert_eq!(grown.outcome, Outcome::Done);
    assert_eq!((grown.body.len(), tells(&told, &News::State(State::Hold))), (20, 1));
    assert_eq!((tells(&told, &News::Ordered(Order::Hold)), tells(&told, &News::Ordered(Order::GoOn))), (1, 1));
    assert_eq!(told.iter().filter(|news| matches!(news, News::Laid(..))).count(), 20);
}

#[test]
fn a_growth_stops_as_ordered_and_at_once_where_it_must() {
    for order in [Order::Stop, Order::EmergencyStop] {
        let (grown, told) = grow(|news, orders| {
            if let News::Laid(4, ..) = news {
                orders.give(order);
            }
        });
        assert_eq!(grown.outcome, Outcome::Stopped);
        assert!((5..=6).contains(&grown.as_built.len()), "{order:?}: {}", grown.as_built.len());
        assert_eq!(tells(&told, &News::Ordered(order)), 1);
    }
}

#[test]
fn an_order_in_any_state_leaves_the_body_whole() {
    for (state, order) in [(State::Heating, Order::Hold), (State::Homing, Order::Hold), (State::Growing, Order::GoOn)] {
        let (grown, told) = grow(|news, orders| match news {
            News::State(now) if *now == state => orders.give(order),
            News::State(State::Hold) | News::NotObeyed(_) => orders.give(Order::GoOn),
            _ => {}
        });
        assert_eq!((grown.outcome, grown.body.len()), (Outcome::Done, 20), "{state:?}, {order:?}");
        assert_eq!(tells(&told, &News::State(State::Hold)) > 0, order == Order::Hold, "{state:?}, {order:?}");
    }
}
