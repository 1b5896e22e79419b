//! Tables: columns with a name and a number format, and rows that are written as CSV, JSON, text or HTML.

use std::borrow::Borrow;
use std::iter::once;

use csv::WriterBuilder;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::figures::shortest;

/// Content of a cell.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// No value: null in JSON.
    Empty,
    /// True or false.
    Flag(bool),
    /// Whole number.
    Count(u64),
    /// Number with a fraction, in the format of the table.
    Number(f64),
    /// Text.
    Text(String),
}

macro_rules! cell_from {
    ($($from:ty => $variant:ident),*) => {
        $(impl From<$from> for Cell {
            fn from(value: $from) -> Self {
                Self::$variant(value.into())
            }
        })*
    };
}
cell_from!(bool => Flag, u8 => Count, u32 => Count, u64 => Count, f64 => Number, &str => Text, String => Text);

impl From<usize> for Cell {
    fn from(value: usize) -> Self {
        Self::Count(value as u64)
    }
}

impl<T: Into<Self>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Empty, Into::into)
    }
}

/// Format of numbers with a fraction. All formats are exact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberFormat {
    /// The shortest text: `1`, `1e-14`.
    Shortest,
    /// Without an exponent: `1`, `0.00001`.
    Plain,
    /// With a decimal point: `1.0`, `1e-14`.
    Fraction,
}

impl NumberFormat {
    fn apply(self, cell: Cell) -> Cell {
        match (self, cell) {
            (Self::Shortest, Cell::Number(number)) => Cell::Text(shortest(number)),
            (Self::Plain, Cell::Number(number)) => Cell::Text(number.to_string()),
            (_, cell) => cell,
        }
    }
}

type Values<'a, R> = Box<dyn Fn(&R) -> Vec<Cell> + 'a>;

/// A row of a table as a JSON object, whose keys are the names of the columns.
pub type Row = Map<String, Value>;

/// Columns of a table with rows of type `R`. The name of a column contains its unit.
pub struct Table<'a, R> {
    numbers: NumberFormat,
    names: Vec<String>,
    values: Vec<Values<'a, R>>,
}

impl<'a, R> Table<'a, R> {
    /// Returns a table without columns.
    pub fn new(numbers: NumberFormat) -> Self {
        Self { numbers, names: Vec::new(), values: Vec::new() }
    }

    /// Adds a column.
    pub fn column<V: Into<Cell>>(self, name: impl Into<String>, value: impl Fn(&R) -> V + 'a) -> Self {
        self.columns([name], move |row| [value(row)])
    }

    /// Adds columns whose values are computed together. There are as many values as names.
    pub fn columns<V: Into<Cell>, I: IntoIterator<Item = V>>(
        mut self,
        names: impl IntoIterator<Item = impl Into<String>>,
        values: impl Fn(&R) -> I + 'a,
    ) -> Self {
        self.names.extend(names.into_iter().map(Into::into));
        self.values.push(Box::new(move |row| values(row).into_iter().map(Into::into).collect()));
        self
    }

    fn cells(&self, row: &R) -> Vec<Cell> {
        self.values.iter().flat_map(|values| values(row)).map(|cell| self.numbers.apply(cell)).collect()
    }

    /// Returns the cells of a row as text.
    fn texts(&self, row: &R) -> impl Iterator<Item = String> {
        self.cells(row).into_iter().map(|cell| match cell {
            Cell::Empty => String::new(),
            Cell::Flag(flag) => flag.to_string(),
            Cell::Count(count) => count.to_string(),
            Cell::Number(number) => format!("{number:?}"),
            Cell::Text(text) => text,
        })
    }

    fn header(&self) -> Vec<Cell> {
        self.names.iter().map(|name| name.as_str().into()).collect()
    }

    /// Returns the header as a line of CSV.
    pub fn csv_header(&self) -> String {
        csv_of(once(self.header()))
    }

    /// Returns a row as a line of CSV.
    pub fn csv_row(&self, row: &R) -> String {
        csv_of(once(self.cells(row)))
    }

    /// Returns the header and rows as CSV.
    pub fn csv<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>) -> String {
        csv_of(once(self.header()).chain(rows.into_iter().map(|row| self.cells(row.borrow()))))
    }

    /// Returns the rows as JSON objects, whose keys are the names of the columns.
    pub fn json<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>) -> Vec<Row> {
        let object = |row: T| -> Row {
            let cells = self.values.iter().flat_map(|values| values(row.borrow()));
            self.names.iter().cloned().zip(cells.map(|cell| serde_json::json!(cell))).collect()
        };
        rows.into_iter().map(object).collect()
    }

    /// Returns the names of the columns as a line of text. The first column is aligned left, and the others right.
    pub fn text_header(&self, widths: &[usize]) -> String {
        line(self.names.iter().cloned(), widths)
    }

    /// Returns the rows as lines of text. The first column is aligned left, and the others right.
    pub fn text_rows<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>, widths: &[usize]) -> String {
        rows.into_iter().map(|row| line(self.texts(row.borrow()), widths)).collect()
    }

    /// Returns the names of the columns and the rows as lines of text.
    pub fn text<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>, widths: &[usize]) -> String {
        self.text_header(widths) + &self.text_rows(rows, widths)
    }

    /// Returns an HTML table. Names and cells contain HTML. The first `left` columns are aligned left.
    pub fn html<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>, left: usize) -> String {
        let rows = rows.into_iter().map(|row| html_row("<tr>", "td", self.texts(row.borrow()), left));
        self.html_of(rows, left)
    }

    /// Like [`Self::html`], but neighbouring rows with the same text in the first column form a group, which shows this
    /// text only once.
    pub fn grouped_html<T: Borrow<R>>(&self, rows: impl IntoIterator<Item = T>, left: usize) -> String {
        let mut before = None;
        let rows = rows.into_iter().map(|row| {
            let mut texts = self.texts(row.borrow());
            let group = texts.next();
            let shown = group.clone().filter(|_| group != before).unwrap_or_default();
            let start = if group == before { "<tr class=\"\">" } else { "<tr class=\"first\">" };
            before = group;
            html_row(start, "td", once(shown).chain(texts), left)
        });
        self.html_of(rows, left)
    }

    fn html_of(&self, rows: impl Iterator<Item = String>, left: usize) -> String {
        let header = html_row("<tr>", "th", self.names.iter().cloned(), left);
        format!("<div class=\"wide\"><table>\n{header}{}</table></div>\n", rows.collect::<String>())
    }
}

/// Returns the names of the five columns of a pose, in the order of `Pose::to_degrees`.
pub fn pose_columns(name: &str) -> [String; 5] {
    ["x_mm", "y_mm", "z_mm", "heading_deg", "pitch_deg"].map(|part| format!("{name}_{part}"))
}

fn html_row(start: &str, tag: &str, texts: impl Iterator<Item = String>, left: usize) -> String {
    let cell = |(column, text): (usize, String)| {
        let class = if column < left { " class=\"l\"" } else { "" };
        format!("<{tag}{class}>{text}</{tag}>")
    };
    format!("{start}{}</tr>\n", texts.enumerate().map(cell).collect::<String>())
}

fn line(texts: impl Iterator<Item = String>, widths: &[usize]) -> String {
    let mut line = String::new();
    for (text, width) in texts.zip(widths) {
        line += &if line.is_empty() { format!("{text:<width$}") } else { format!("{text:>width$}") };
    }
    line + "\n"
}

fn csv_of(records: impl Iterator<Item = Vec<Cell>>) -> String {
    let mut writer = WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    for record in records {
        // Writing to memory cannot fail, and all records have the same length.
        let _ = writer.serialize(record);
    }
    writer.into_inner().ok().and_then(|csv| String::from_utf8(csv).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    type Row = (&'static str, f64, Option<usize>);

    fn table(numbers: NumberFormat) -> Table<'static, Row> {
        Table::new(numbers)
            .column("name", |(name, ..): &Row| *name)
            .columns(["once_mm", "twice_mm"], |(_, length, _)| [*length, 2.0 * length])
            .column("layers", |(.., layers)| *layers)
    }

    const ROWS: [Row; 2] = [("a, b", 1.0, Some(3)), ("c", 1e-7, None)];

    #[test]
    fn numbers_have_the_format_of_the_table() {
        let rows = |numbers| table(numbers).csv(ROWS).split_once('\n').unwrap().1.to_owned();
        assert_eq!(rows(NumberFormat::Shortest), "\"a, b\",1,2,3\nc,1e-7,2e-7,\n");
        assert_eq!(rows(NumberFormat::Plain), "\"a, b\",1,2,3\nc,0.0000001,0.0000002,\n");
        assert_eq!(rows(NumberFormat::Fraction), "\"a, b\",1.0,2.0,3\nc,1e-7,2e-7,\n");
    }

    #[test]
    fn all_formats_have_the_same_cells() {
        let table = table(NumberFormat::Shortest);
        assert_eq!(table.csv(ROWS), table.csv_header() + &table.csv_row(&ROWS[0]) + &table.csv_row(&ROWS[1]));
        assert_eq!(table.csv_header(), "name,once_mm,twice_mm,layers\n");
        let json = serde_json::json!([
            { "name": "a, b", "once_mm": 1.0, "twice_mm": 2.0, "layers": 3 },
            { "name": "c", "once_mm": 1e-7, "twice_mm": 2e-7, "layers": null },
        ]);
        assert_eq!(Value::from_iter(table.json(ROWS)), json);
        let widths = [6, 8, 9, 7];
        let text = "name   once_mm twice_mm layers\na, b         1        2      3\nc         1e-7     2e-7       \n";
        assert_eq!(table.text(ROWS, &widths), text);
        let header = "<div class=\"wide\"><table>\n<tr><th class=\"l\">name</th><th>once_mm</th><th>twice_mm</th>\
                      <th>layers</th></tr>\n";
        let row = "<td class=\"l\">c</td><td>1e-7</td><td>2e-7</td><td></td></tr>\n";
        assert_eq!(table.html([ROWS[1]], 1), format!("{header}<tr>{row}</table></div>\n"));
        let again = row.replace(">c<", "><");
        assert_eq!(
            table.grouped_html([ROWS[1]; 2], 1),
            format!("{header}<tr class=\"first\">{row}<tr class=\"\">{again}</table></div>\n")
        );
    }
}
