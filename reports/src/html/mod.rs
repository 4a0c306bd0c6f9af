//! A report as one HTML file: text, tables and pictures (inline SVG), without scripts and with nothing from
//! elsewhere. Light and dark by the reader's setting, and for paper.
//!
//! | file | role |
//! |---|---|
//! | this | the page: its head, sections, tables |
//! | `chart` | lines, histograms, bars |
//! | `plan` | a trajectory from above and from the side |
//! | `picture` | a drawing with title and description |
//! | `scale`, `number`, `thin` | axes, digits, fewer points |
//! | `markup` | the only place that writes tags, and where text is escaped |
//!
//! Pure: numbers and text in, a string out. It knows no other room, no clock and no files, so that the same
//! input gives the same bytes: a report has no date of its own.

mod chart;
mod markup;
mod number;
mod picture;
mod plan;
mod scale;
#[cfg(test)]
mod tests;
mod thin;

pub use chart::{Bar, Labels, Line, Role, SERIES, Span, bars, histogram, lines};
use markup::Markup;
pub use number::{count, number, quantiles};
pub use picture::Picture;
pub use plan::{Link, Paths, Plan, overlay, views};

/// Rows that a table shows; what is beyond is counted below it.
const MOST_ROWS: usize = 200;

/// A table. Cells that begin with a digit, a sign or a dash for none stand at the right.
#[derive(Clone, Debug)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// The names of its columns.
    pub head: Vec<String>,
    /// Its rows, a cell a column.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table of text.
    #[must_use]
    pub fn new(caption: &str, head: &[&str], rows: Vec<Vec<String>>) -> Self {
        let head = head.iter().map(|&name| name.to_owned()).collect();
        Self { caption: caption.to_owned(), head, rows }
    }
}

/// A page that is being written.
#[derive(Clone, Debug)]
pub struct Page {
    body: Markup,
    pictures: usize,
}

impl Page {
    /// Starts a page: its title, the command line that made it, what came out of it in a sentence, and facts
    /// as name and value.
    #[must_use]
    pub fn new(title: &str, command: &str, verdict: &str, facts: &[(&str, String)]) -> Self {
        let mut body = Markup::default();
        body.literal("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
        // Nothing can be loaded and nothing can run, whatever a name in here may try.
        body.literal(
            "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src \
             'unsafe-inline'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<style>\n",
        );
        body.literal(include_str!("style.css"));
        body.literal("</style>\n");
        body.element("title", &[], title);
        body.literal("</head>\n<body>\n<main>\n");
        body.element("h1", &[], title);
        if !verdict.is_empty() {
            body.element("p", &[("class", &"verdict")], verdict);
        }
        body.element("code", &[], command);
        let mut page = Self { body, pictures: 0 };
        if !facts.is_empty() {
            page.section("Summary");
            let rows = facts.iter().map(|(name, value)| vec![(*name).to_owned(), value.clone()]);
            page.table(&Table { caption: String::new(), head: Vec::new(), rows: rows.collect() });
        }
        page
    }

    /// Begins a section.
    pub fn section(&mut self, heading: &str) {
        self.body.element("h2", &[], heading);
    }

    /// A paragraph.
    pub fn note(&mut self, text: &str) {
        self.body.element("p", &[], text);
    }

    /// Pictures beside each other, and tables beside them, as far as there is room.
    pub fn row(&mut self, pictures: &[Picture], tables: &[Table]) {
        self.body.open("div", &[("class", &"row")]);
        for picture in pictures {
            picture.write(self.pictures, &mut self.body);
            self.pictures += 1;
        }
        for table in tables {
            self.body.open("div", &[]);
            self.table(table);
            self.body.close("div");
        }
        self.body.close("div");
    }

    /// A long table, which the reader opens.
    pub fn folded(&mut self, table: &Table) {
        self.body.open("details", &[]);
        let rows = count(table.rows.len());
        self.body.element("summary", &[], format_args!("{}: {rows} rows", table.caption));
        self.table(&Table { caption: String::new(), ..table.clone() });
        self.body.close("details");
    }

    /// A table.
    pub fn table(&mut self, table: &Table) {
        let body = &mut self.body;
        body.open("div", &[("class", &"scroll")]);
        let kind = if table.head.is_empty() { "facts" } else { "figures" };
        body.open("table", &[("class", &kind)]);
        if !table.caption.is_empty() {
            body.element("caption", &[], &table.caption);
        }
        let is_number = |column: usize| {
            let mut cells = table.rows.iter().filter_map(|row| row.get(column));
            column > 0 && !table.head.is_empty() && cells.all(|cell| looks_like_a_number(cell))
        };
        let numbers: Vec<bool> = (0..table.head.len()).map(is_number).collect();
        let class =
            |column: usize| if numbers.get(column) == Some(&true) { "number" } else { "text" };
        if !table.head.is_empty() {
            body.open("thead", &[]);
            body.open("tr", &[]);
            for (column, name) in table.head.iter().enumerate() {
                body.element("th", &[("scope", &"col"), ("class", &class(column))], name);
            }
            body.close("tr");
            body.close("thead");
        }
        body.open("tbody", &[]);
        for row in table.rows.iter().take(MOST_ROWS) {
            body.open("tr", &[]);
            for (column, cell) in row.iter().enumerate() {
                match column {
                    0 => body.element("th", &[("scope", &"row")], cell),
                    _ => body.element("td", &[("class", &class(column))], cell),
                }
            }
            body.close("tr");
        }
        body.close("tbody");
        body.close("table");
        if table.rows.len() > MOST_ROWS {
            let more = count(table.rows.len() - MOST_ROWS);
            body.element("p", &[("class", &"soft")], format_args!("and {more} more"));
        }
        body.close("div");
    }

    /// Ends the page; `maker` is the program with its version.
    #[must_use]
    pub fn finish(mut self, maker: &str) -> String {
        self.body.literal("</main>\n");
        self.body.element("footer", &[], maker);
        self.body.literal("</body>\n</html>\n");
        self.body.into_string()
    }
}

fn looks_like_a_number(cell: &str) -> bool {
    cell.starts_with(|c: char| c.is_ascii_digit() || ['-', '−', '–', '+'].contains(&c))
        || cell.is_empty()
}
