//! Compares the table of capabilities with the commands of growbot and with the OpenAPI document of the service.

use std::collections::BTreeSet;

use crate::lab::Lab;
use crate::running::growbot;

const TABLE: &str = include_str!("../../docs/capabilities.md");

/// Returns the texts in backticks of a cell.
fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

/// Returns the cells of each row of the table that begins with this heading.
fn rows(heading: &str) -> Vec<Vec<&'static str>> {
    let (_, rest) = TABLE.split_once(&format!("\n| {heading} |")).unwrap();
    let rows = rest.lines().skip(2).take_while(|line| line.starts_with('|'));
    rows.map(|row| row.trim_matches('|').split(" | ").map(str::trim).collect()).collect()
}

#[test]
fn each_command_and_each_route_has_a_row() {
    let help = growbot(&["--help"]).out;
    let is_command = |line: &&str| line.starts_with("  ") && line.as_bytes().get(2).is_some_and(u8::is_ascii_lowercase);
    let names = help.lines().filter(is_command).filter_map(|line| line.split_whitespace().next());
    // Leaves out the examples and `help`.
    let commands: BTreeSet<&str> = names.filter(|name| !["growbot", "help"].contains(name)).collect();
    assert!(commands.len() > 30, "{commands:?}");
    let of_commands = rows("command");
    let listed: BTreeSet<&str> = of_commands.iter().flat_map(|row| quoted(row[0])).collect();
    assert_eq!(listed, commands);

    // A simulated robot might still be starting at the end of this test.
    let lab = Lab::configured("[robots.lab]\nport = \"tcp:127.0.0.1:1\"\nrobot = \"growbot-a2\"\n");
    let (_, document) = lab.ask("GET", "/openapi.json", "");
    let mut routes: BTreeSet<String> = BTreeSet::from(["GET /openapi.json".to_owned()]);
    for (path, methods) in document["paths"].as_object().unwrap() {
        let path = path.strip_prefix("/api/v1").unwrap_or(path);
        routes.extend(methods.as_object().unwrap().keys().map(|method| format!("{} {path}", method.to_uppercase())));
    }
    let of_api = rows("API");
    let cells = of_commands.iter().map(|row| row[1]).chain(of_api.iter().map(|row| row[0]));
    let named: BTreeSet<String> = cells.flat_map(quoted).map(str::to_owned).collect();
    assert_eq!(named, routes);
    // A capability that the page does not have has a reason.
    for row in of_commands.iter().chain(&of_api) {
        assert!(row.last().is_some_and(|reason| reason.len() > 3), "{row:?}");
    }
}
