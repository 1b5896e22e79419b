//! Draws the model as text and braille. This module depends neither on a terminal nor on a board.

use growbot_core::layer::Layer;
use growbot_core::link::message::{State, Status, celsius};
use growbot_pictures::clock_text::local_clock_text;
use growbot_pictures::duration::duration_text;
use growbot_plan::forecast::Forecast;
use growbot_plan::sanitize::is_control;
use growbot_plan::tracked_body::BodyPoint;
use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Position, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Points};
use ratatui::widgets::{Axis, Block, Chart, Clear, Dataset, GraphType, Paragraph, Wrap};
use time::OffsetDateTime;

use super::keys::KEYS;
use super::model::{ConsoleModel, explanation};
use crate::cli::console::commands::hint;
use crate::cli::remedies;

/// Smallest screen that has room for pictures: columns and rows.
const MIN_SIZE: (u16, u16) = (72, 20);
/// Distance between the dots of the planned body, in dots of braille.
const PLANNED_APART: f64 = 4.0;
/// Minimum height of the region that the pictures of the body show, mm.
const MIN_SEEN_MM: f64 = 50.0;

/// Help text in the command line while the line is empty.
const TYPING: &str = "a command, `help` lists them; Tab completes, Esc cancels, ^E EMERGENCY STOP";

const TITLE: Style = Style::new().fg(Color::Cyan).add_modifier(Modifier::BOLD);
const DIM: Style = Style::new().fg(Color::DarkGray);
const GOOD: Style = Style::new().fg(Color::Green).add_modifier(Modifier::BOLD);
const WORKING: Style = Style::new().fg(Color::Yellow).add_modifier(Modifier::BOLD);
const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);
const KEY: Style = Style::new().fg(Color::Cyan).add_modifier(Modifier::BOLD.union(Modifier::REVERSED));

/// Draws the whole screen. Names and messages of a board must not control the terminal, so control characters become
/// spaces.
pub fn screen(frame: &mut Frame, model: &ConsoleModel) {
    draw(frame, model);
    for cell in &mut frame.buffer_mut().content {
        if cell.symbol().contains(is_control) {
            cell.set_symbol(" ");
        }
    }
}

fn draw(frame: &mut Frame, model: &ConsoleModel) {
    let area = frame.area();
    let [head, state, trouble, heater, tip, pictures, log, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(1),
        Constraint::Length(problem_text(model).map_or(0, |text| rows(&text, area.width))),
        Constraint::Length(1),
        Constraint::Length(1),
        Constraint::Fill(1),
        Constraint::Length(if area.height >= 32 { 8 } else { 4 }),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(head_line(model, area.width), head);
    frame.render_widget(state_line(model), state);
    frame.render_widget(heater_line(model), heater);
    frame.render_widget(tip_line(model), tip);
    if let Some(text) = problem_text(model) {
        frame.render_widget(Paragraph::new(text).style(BAD).wrap(Wrap { trim: true }), trouble);
    }
    if area.width < MIN_SIZE.0 || area.height < MIN_SIZE.1 {
        let message = format!("terminal too small for pictures: {}x{} is needed", MIN_SIZE.0, MIN_SIZE.1);
        frame.render_widget(Paragraph::new(message).style(DIM), pictures);
    } else {
        draw_pictures(frame, pictures, model);
    }
    draw_log(frame, log, model);
    draw_keys(frame, keys, model);
    if let Some(sheet) = &model.popup {
        // Head, state and problem stay visible.
        let below = Rect { y: heater.y, height: area.bottom().saturating_sub(heater.y), ..area };
        let block = Block::bordered().title_bottom(Span::styled(" any key closes this ", DIM));
        frame.render_widget(Clear, below);
        frame.render_widget(Paragraph::new(sheet.as_str()).block(block), below);
    }
}

fn draw_pictures(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let [charts, body] = Layout::horizontal([Constraint::Percentage(54), Constraint::Fill(1)]).areas(area);
    let [above, below] = Layout::vertical([Constraint::Fill(1), Constraint::Fill(1)]).areas(charts);
    draw_temperature(frame, above, model);
    draw_layers(frame, below, model);
    draw_body(frame, body, model);
}

fn head_line(model: &ConsoleModel, width: u16) -> Line<'static> {
    let left = format!("{} on {}", model.robot.name(), model.port);
    let up = model.status.as_ref().map(|status| format!("up {}", clock(status.uptime_ms as f64 / 1000.0)));
    let speed = model.speed.map(|speed| format!("{speed} x real time (+ -)"));
    let right: Vec<String> = speed.into_iter().chain(up).collect();
    let right = right.join(", ");
    let gap = usize::from(width).saturating_sub(left.chars().count() + right.chars().count());
    Line::from(vec![Span::styled(left, TITLE), Span::raw(" ".repeat(gap.max(1))), Span::styled(right, DIM)])
}

fn state_line(model: &ConsoleModel) -> Line<'static> {
    let Some(status) = &model.status else { return Line::styled("waiting for the board", WORKING) };
    let style = match status.state {
        State::Fault | State::EmergencyStop => BAD,
        State::Heating | State::Homing | State::Growing | State::Tuning | State::Maintenance | State::Paused => WORKING,
        _ => GOOD,
    };
    let known = if model.link_error.is_some() { "last known: " } else { "" };
    let mut spans = vec![Span::raw(known), Span::styled(status.state.name().to_uppercase(), style)];
    spans.push(Span::raw(match status.state {
        State::Growing => format!("  {}", progress(model, status)),
        state => format!("  {}", explanation(state)),
    }));
    Line::from(spans)
}

/// Returns the progress of a job and its remaining time as text.
fn progress(model: &ConsoleModel, status: &Status) -> String {
    let share = 100.0 * f64::from(status.layers_laid) / f64::from(status.layer_count.max(1));
    let left =
        f64::from(status.layer_count.saturating_sub(status.layers_laid)) * model.robot.description().layer.period_s;
    let text =
        format!("layer {} of {} ({share:.0} %), {} left", status.layers_laid, status.layer_count, duration_text(left));
    // No finish time is shown for a simulated robot, because its time is not real time.
    let forecast = Forecast { period_s: model.robot.description().layer.period_s, pace: 1.0 };
    let finish = model.speed.is_none().then(|| forecast.finish_of(OffsetDateTime::now_utc(), status)).flatten();
    finish.map_or(text.clone(), |finish| format!("{text}, done at {}", local_clock_text(finish)))
}

fn heater_line(model: &ConsoleModel) -> Line<'static> {
    let Some(status) = &model.status else { return Line::default() };
    let nozzle = status.temperature_centi_c.map_or("no reading".to_owned(), |t| format!("{:.1} C", celsius(t)));
    let target = status.target_centi_c.map_or("heater off".to_owned(), |target| {
        format!("target {:.1} C, {:.0} % power", celsius(target), f64::from(status.duty) / 655.35)
    });
    let mut parts = vec![format!("nozzle {nozzle}, {target}")];
    if let Some(sensors) = &model.sensors {
        parts.extend(sensors.supply_mv.map(|millivolts| format!("supply {:.1} V", f64::from(millivolts) / 1000.0)));
        parts.extend((sensors.filament_present == Some(false)).then(|| "NO FILAMENT".to_owned()));
        let named = sensors
            .driver_problem
            .map(|trouble| format!("{} DRIVER {}", trouble.motor.name(), trouble.problem.code()).to_ascii_uppercase());
        parts.extend(named.or_else(|| (sensors.driver_fault == Some(true)).then(|| "DRIVER FAULT".to_owned())));
        parts.extend((sensors.emergency_stop == Some(true)).then(|| "EMERGENCY STOP PRESSED".to_owned()));
    }
    Line::raw(parts.join("; "))
}

/// Returns the line about the tip's pose.
fn tip_line(model: &ConsoleModel) -> Line<'static> {
    // The numbers have tenths, and zero has no sign.
    let [x, y, z, heading, pitch] = model.body.tip().to_degrees().map(|number| (number * 10.0).round() / 10.0 + 0.0);
    let late = match model.body.first() {
        0 => "",
        _ => " (without the layers laid earlier)",
    };
    let direction = match pitch {
        // A vertical tip has no heading.
        90.0 => "straight up".to_owned(),
        -90.0 => "straight down".to_owned(),
        _ => format!("heading {heading:.1}, pitch {pitch:.1} deg"),
    };
    Line::raw(format!("tip {x:.1}, {y:.1}, {z:.1} mm, {direction}{late}"))
}

/// Returns a text about a lost connection, or else about a fault of the board. `None` if there is neither.
fn problem_text(model: &ConsoleModel) -> Option<String> {
    if let Some(why) = &model.link_error {
        return Some(format!("NO RESPONSE: {why}"));
    }
    let fault = model.status.as_ref()?.fault?;
    Some(format!("{}: {}", fault.code(), remedies::fault_explanation(fault)))
}

/// Returns the number of rows that a text takes when it is wrapped to `width` columns, at most 3.
fn rows(text: &str, width: u16) -> u16 {
    let paragraph = Paragraph::new(text).wrap(Wrap { trim: true });
    (1..=3).find(|rows| fits(&paragraph, width, *rows)).unwrap_or(3)
}

/// Returns true if a paragraph that is wrapped to `width` columns fits into this many rows.
fn fits(paragraph: &Paragraph, width: u16, rows: u16) -> bool {
    use ratatui::buffer::Buffer;
    use ratatui::widgets::Widget;
    let area = Rect::new(0, 0, width.max(1), rows + 1);
    let mut buffer = Buffer::empty(area);
    paragraph.render(area, &mut buffer);
    (0..area.width).all(|x| buffer.cell((x, rows)).is_none_or(|cell| cell.symbol() == " "))
}

fn draw_temperature(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let block = Block::bordered().title(Span::styled(" nozzle, C ", TITLE));
    let readings = &model.readings;
    let (Some((from, to)), Some((min, max))) = (readings.span(), readings.range()) else {
        return nothing_yet(frame, area, block, "no reading yet");
    };
    let to = to.max(from + 10.0);
    let (low, high) = ((min / 10.0).floor() * 10.0, (max / 10.0).floor() * 10.0 + 10.0);
    let sets = vec![line(readings.targets(), DIM), line(readings.readings(), Style::new().fg(Color::Yellow))];
    let block = block.title_bottom(Span::styled(format!(" {} to {} ", clock(from), clock(to)), DIM));
    frame.render_widget(chart(sets, [from, to], [low, high], 0).block(block), area);
}

fn draw_layers(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let lost = match model.body.unreported() {
        0 => String::new(),
        lost => format!("({lost} not reported) "),
    };
    let block =
        Block::bordered().title(Span::styled(format!(" layers as built, mm: inner, mean, outer {lost}"), TITLE));
    let body = &model.body;
    if body.built().is_empty() {
        return nothing_yet(frame, area, block, "no layer yet");
    }
    let radius = model.robot.tip_radius();
    let heights = |of: &dyn Fn(&Layer) -> f64| -> Vec<(f64, f64)> {
        (body.first()..).map(f64::from).zip(body.built().iter().map(of)).collect()
    };
    let inner = heights(&|layer| layer.min_height(radius));
    let outer = heights(&|layer| layer.max_height(radius));
    let mean = heights(&|layer| layer.height);
    let sets = [(&inner, Color::Blue), (&outer, Color::Blue), (&mean, Color::Green)]
        .map(|(heights, color)| line(heights, Style::new().fg(color)));
    let (first, last) = (body.first(), body.next() - 1);
    let block = block.title_bottom(Span::styled(format!(" {first} to {last} "), DIM));
    let limits = &model.robot.description().layer;
    let numbers = [f64::from(first), f64::from(last.max(first + 10))];
    frame
        .render_widget(chart(sets.into(), numbers, [limits.height_min_mm, limits.height_max_mm], 2).block(block), area);
}

/// Returns a data set that is drawn as a line.
fn line(pairs: &[(f64, f64)], style: Style) -> Dataset<'_> {
    Dataset::default().marker(Marker::Braille).graph_type(GraphType::Line).style(style).data(pairs)
}

/// Returns a chart of the ranges `across` (horizontal) and `up` (vertical). Only the vertical axis has labels, with
/// `digits` decimals.
fn chart<'a>(sets: Vec<Dataset<'a>>, across: [f64; 2], up: [f64; 2], digits: usize) -> Chart<'a> {
    let labels = up.map(|end| format!("{end:.digits$}"));
    let up = Axis::default().style(DIM).bounds(up).labels(labels).labels_alignment(Alignment::Right);
    Chart::new(sets).x_axis(Axis::default().style(DIM).bounds(across)).y_axis(up).legend_position(None)
}

fn nothing_yet(frame: &mut Frame, area: Rect, block: Block, what: &'static str) {
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let middle = Rect { y: inner.y + inner.height / 2, height: inner.height.min(1), ..inner };
    frame.render_widget(Paragraph::new(what).style(DIM).centered(), middle);
}

/// Draws the body from the side twice, seen along y and along x, both at the same scale.
fn draw_body(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let [left, right] = Layout::horizontal([Constraint::Fill(1), Constraint::Fill(1)]).areas(area);
    let points = || model.body.points().iter().chain(model.body.planned_points());
    let range = |axis: usize, seen: f64| {
        let of = |point: &BodyPoint| point.get(axis).copied().unwrap_or_default();
        points().map(of).fold((0.0, seen), |(a, b): (f64, f64), v| (a.min(v), b.max(v)))
    };
    let (x, y, z) = (range(0, 0.0), range(1, 0.0), range(2, MIN_SEEN_MM));
    let reach = |(min, max): (f64, f64)| max - min;
    // A cell has two dots of braille across and four down, at about the same distance. The frame takes a cell on each
    // side.
    let dots = |cells: u16, each: f64| f64::from(cells.saturating_sub(2).max(1)) * each;
    let (across, down) = (dots(left.width.min(right.width), 2.0), dots(left.height, 4.0));
    // Millimetres from dot to dot. One dot is left free at each edge.
    let scale = (reach(x).max(reach(y)) / (across - 2.0).max(1.0)).max(reach(z) / (down - 2.0));
    let apart = (PLANNED_APART * scale / model.robot.description().layer.height_mm).ceil() as usize;
    for (part, axis, name, range) in [(left, 0, "x", x), (right, 1, "y", y)] {
        // The middle falls on a dot, because a straight body would flicker between two dots.
        let bounds = |(min, max): (f64, f64), dots: f64| {
            let low = f64::midpoint(min, max) - scale * (dots / 2.0 - 1.0);
            [low, low + scale * (dots - 1.0)]
        };
        let (wide, tall) = (bounds(range, dots(part.width, 2.0)), bounds(z, down));
        let flat = |point: &BodyPoint| (point.get(axis).copied().unwrap_or_default(), point[2]);
        let planned: Vec<(f64, f64)> = model.body.planned_points().iter().step_by(apart.max(1)).map(flat).collect();
        let built: Vec<(f64, f64)> = model.body.points().iter().map(flat).collect();
        let canvas = Canvas::default()
            .block(
                Block::bordered()
                    .title(Span::styled(format!(" {name}, z "), TITLE))
                    .title_bottom(Span::styled(format!(" {name} {} to {} mm ", whole(range.0), whole(range.1)), DIM)),
            )
            .marker(Marker::Braille)
            .x_bounds(wide)
            .y_bounds(tall)
            .paint(|context| {
                context.draw(&Points { coords: &planned, color: Color::DarkGray });
                context.layer();
                for (from, to) in built.iter().zip(built.iter().skip(1)) {
                    context.draw(&Stroke { x1: from.0, y1: from.1, x2: to.0, y2: to.1, color: Color::Green });
                }
                if let Some((x, z)) = built.last() {
                    let ([left, right], [low, high]) = (wide, tall);
                    let x = left + beside((x - left) / scale, 2.0, dots(part.width, 2.0)) * (right - left);
                    let z = high - beside((high - z) / scale, 4.0, down) * (high - low);
                    context.print(x.min(right), z.max(low), Span::styled("o", WORKING));
                }
            });
        frame.render_widget(canvas, part);
    }
}

/// Returns the position, 0 to 1 of the canvas, at which a letter must be printed so that it appears in the same
/// character cell as the dot with index `dot`. The canvas has `dots` dots along this axis, `each` of them per cell.
fn beside(dot: f64, each: f64, dots: f64) -> f64 {
    let last = (dots / each - 1.0).max(1.0);
    (((dot.round() / each).floor() + 0.5) / last).clamp(0.0, 1.0)
}

fn draw_log(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let shown = usize::from(area.height);
    let lines = model.log.iter().skip(model.log.len().saturating_sub(shown)).map(|line| {
        let style = if line.is_error { BAD } else { Style::new() };
        Line::from(vec![
            Span::styled(format!("{:>8}  ", clock(line.at_s)), DIM),
            Span::styled(line.text.clone(), style),
        ])
    });
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()), area);
}

fn draw_keys(frame: &mut Frame, area: Rect, model: &ConsoleModel) {
    let Some(prompt) = &model.prompt else {
        let spans = KEYS.iter().flat_map(|(key, what)| {
            let style = if what.chars().all(|c| !c.is_lowercase()) { BAD } else { Style::new() };
            [Span::styled(*key, KEY), Span::styled(format!(" {what}  "), style)]
        });
        return frame.render_widget(Line::from_iter(spans), area);
    };
    let text = prompt.text();
    // A line that is too long shows its end, because the user types there.
    let room = usize::from(area.width).saturating_sub(2);
    let hidden = prompt.cursor().saturating_sub(room);
    let visible: String = text.chars().skip(hidden).collect();
    let help = hint(&text).unwrap_or(if text.is_empty() { TYPING } else { "" });
    frame.render_widget(Line::from(vec![Span::styled(":", TITLE), Span::raw(visible), Span::styled(help, DIM)]), area);
    let column = u16::try_from(prompt.cursor() - hidden).unwrap_or(area.width);
    frame.set_cursor_position(Position::new(area.x + 1 + column, area.y));
}

/// Rounds a length to a whole number, without the sign of a zero.
fn whole(length: f64) -> f64 {
    length.round() + 0.0
}

/// Formats a time as hours, minutes and seconds.
fn clock(seconds: f64) -> String {
    let seconds = seconds as u64;
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

#[cfg(test)]
mod tests {
    use growbot_core::link::message::{DriverProblem, DriverReport, Fault, Motor, SensorReadings};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::super::commands::screen_help;
    use super::super::prompt::Prompt;
    use super::super::testing::{laid, model, status};
    use super::*;

    /// Returns the screen as text, line by line.
    fn drawn(model: &ConsoleModel, width: u16, height: u16) -> Vec<String> {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| screen(frame, model)).unwrap();
        let buffer = terminal.backend().buffer();
        (0..height)
            .map(|y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned())
            .collect()
    }

    /// Returns a model with 40 of 100 layers laid.
    fn growing() -> ConsoleModel {
        let mut model = model();
        for second in 0..60 {
            model.apply_status(Status {
                temperature_centi_c: Some(2_000 + 320 * second),
                ..status(State::Heating, f64::from(second))
            });
        }
        for index in 0..40 {
            model.apply_event(&laid(index));
        }
        model.apply_status(Status { layers_laid: 40, ..status(State::Growing, 780.0) });
        model.sensors = Some(SensorReadings { supply_mv: Some(12_040), ..SensorReadings::default() });
        model
    }

    #[test]
    fn a_driver_with_a_problem_is_named() {
        let mut model = growing();
        let driver_problem = Some(DriverReport { motor: Motor::Feed, problem: DriverProblem::Silent });
        model.sensors = Some(SensorReadings { driver_fault: Some(true), driver_problem, ..SensorReadings::default() });
        let lines = drawn(&model, 80, 24);
        assert!(lines[2].ends_with("; FEED DRIVER SILENT"), "{}", lines[2]);
    }

    #[test]
    fn a_growth_fills_80x24() {
        let lines = drawn(&growing(), 80, 24);
        assert_eq!(lines[0], "growbot-a on sim                                60 x real time (+ -), up 0:13:00");
        assert_eq!(lines[1], "GROWING  layer 40 of 100 (40 %), 18 min 0 s left");
        assert_eq!(lines[2], "nozzle 200.0 C, target 210.0 C, 50 % power; supply 12.0 V");
        assert!(lines[3].starts_with("tip ") && lines[3].ends_with(" deg"), "{}", lines[3]);
        assert_eq!(drawn(&model(), 80, 24)[3], "tip 0.0, 0.0, 0.0 mm, straight up");
        assert!(lines[4].starts_with("\u{250c} nozzle, C "), "{}", lines[4]);
        assert!(lines[5].starts_with("\u{2502}220\u{2502}"), "{}", lines[5]);
        assert!(lines[4].contains(" x, z ") && lines[4].contains(" y, z "), "{}", lines[4]);
        assert!(lines[11].contains(" 0:00:00 to 0:13:00 "), "{}", lines[11]);
        assert!(lines[12].contains(" layers as built, mm: inner, mean, outer "), "{}", lines[12]);
        assert!(lines[18].contains(" 0 to 39 "), "{}", lines[18]);
        assert_eq!(lines[19], " 0:00:00  heating");
        assert_eq!(lines[20], " 0:13:00  growing");
        assert_eq!(lines[23], "h pause  g start  s stop  e ^E EMERGENCY STOP  c clear  p plan  : type  q quit");
        // The tip, in both views.
        let views = lines[5..18].iter().flat_map(|line| line.chars().skip(43));
        assert_eq!(views.filter(|c| *c == 'o').count(), 2);
    }

    #[test]
    fn a_large_screen_has_larger_pictures_and_a_longer_log() {
        let lines = drawn(&growing(), 132, 43);
        assert!(lines[34].starts_with(" 0:00:00  heating"), "{}", lines[34]);
        let braille =
            |lines: &[String]| lines.concat().chars().filter(|c| ('\u{2801}'..='\u{28ff}').contains(c)).count();
        assert!(braille(&lines) > braille(&drawn(&growing(), 80, 24)));
        assert!(lines.iter().all(|line| line.chars().count() <= 132));
    }

    #[test]
    fn a_fault_is_explained_in_text() {
        let mut model = growing();
        model.apply_status(Status {
            fault: Some(Fault::FilamentJam),
            target_centi_c: None,
            layers_laid: 40,
            ..status(State::Fault, 800.0)
        });
        let lines = drawn(&model, 80, 24);
        assert_eq!(lines[1], "FAULT  heater and steppers are off; fix the cause, then c clears the fault");
        assert!(lines[2].starts_with("filament-jam: "), "{}", lines[2]);
        assert!(lines.iter().any(|line| line.starts_with("nozzle 200.0 C, heater off")), "{lines:?}");
        assert!(lines.iter().any(|line| line.contains("fault: filament-jam, ")), "{lines:?}");
    }

    #[test]
    fn every_fault_and_state_fits_the_screen() {
        for fault in Fault::ALL {
            let mut model = growing();
            model.apply_status(Status { fault: Some(fault), ..status(State::Fault, 800.0) });
            let text = drawn(&model, 80, 24).concat().replace(' ', "");
            assert!(text.contains(&remedies::fault_explanation(fault).replace(' ', "")), "{}", fault.code());
        }
        for state in State::ALL {
            let mut model = model();
            model.apply_status(status(state, 1.0));
            assert!(drawn(&model, 80, 24)[1].starts_with(&state.name().to_uppercase()), "{}", state.name());
            assert!(state.name().len() + 2 + explanation(state).len() <= 80);
        }
    }

    #[test]
    fn an_unresponsive_board_is_reported() {
        let mut model = growing();
        model.apply_loss(
            "the board at sim has not responded (4 requests, 1 s each): check power, cable and baud rate, and more",
        );
        let lines = drawn(&model, 80, 24);
        assert!(lines[1].starts_with("last known: GROWING"), "{}", lines[1]);
        assert!(lines[2].starts_with("NO RESPONSE: the board at sim") && lines[3].ends_with("more"), "{lines:?}");
    }

    #[test]
    fn commands_are_typed_in_the_last_line() {
        let mut model = growing();
        model.prompt = Some(Prompt::new("plan "));
        assert_eq!(drawn(&model, 80, 24)[23], ":plan X,Y,Z,HEADING,PITCH in mm and degrees");
        model.prompt = Some(Prompt::new(&"1".repeat(190)));
        assert_eq!(drawn(&model, 80, 24)[23].chars().count(), 79);
        model.prompt = None;
        model.popup = Some("one\ntwo".to_owned());
        let lines = drawn(&model, 80, 24);
        assert!(lines[3].contains("one") && lines[4].contains("two") && lines[23].contains("any key"), "{lines:?}");
    }

    #[test]
    fn the_help_fits_on_a_screen_of_80_by_24() {
        let mut model = growing();
        model.popup = Some(screen_help());
        let lines = drawn(&model, 80, 24);
        for (row, line) in screen_help().lines().enumerate() {
            assert!(lines[3 + row].contains(line), "{line}: {lines:?}");
        }
        assert!(lines[1].starts_with("GROWING") && lines[23].contains("any key"), "{lines:?}");
    }

    #[test]
    fn missing_data_and_small_screens_are_drawn() {
        assert_eq!(drawn(&model(), 80, 24)[1], "waiting for the board");
        for (width, height) in [(1, 1), (5, 3), (40, 8), (71, 30), (80, 10), (72, 20), (300, 100)] {
            drawn(&growing(), width, height);
            drawn(&model(), width, height);
        }
        assert!(drawn(&growing(), 60, 15)[4].starts_with("terminal too small"));
    }
}
