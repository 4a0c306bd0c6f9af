//! HTML and SVG as text: tags are literals of this program, everything else is escaped.
//!
//! The only place that writes `<` or `&`. No caller can put a string from outside into the markup, because
//! names of tags and attributes are `&'static str` and values go through [`escape`].

use std::fmt::{Display, Write};

/// Attributes of an element: name and value.
pub(super) type Attributes<'a> = [(&'static str, &'a dyn Display)];

/// Markup that grows.
#[derive(Clone, Debug, Default)]
pub(super) struct Markup(String);

impl Markup {
    /// `<tag …>`.
    pub(super) fn open(&mut self, tag: &'static str, attributes: &Attributes<'_>) {
        self.start(tag, attributes);
        self.0.push('>');
    }

    /// `</tag>` and the end of the line.
    pub(super) fn close(&mut self, tag: &'static str) {
        self.0.push_str("</");
        self.0.push_str(tag);
        self.0.push_str(">\n");
    }

    /// `<tag …/>`, for elements of SVG and for `meta`.
    pub(super) fn empty(&mut self, tag: &'static str, attributes: &Attributes<'_>) {
        self.start(tag, attributes);
        self.0.push_str("/>\n");
    }

    /// `<tag …>text</tag>`.
    pub(super) fn element(
        &mut self,
        tag: &'static str,
        attributes: &Attributes<'_>,
        text: impl Display,
    ) {
        self.open(tag, attributes);
        self.text(text);
        self.close(tag);
    }

    /// `<path …/>`.
    pub(super) fn path(&mut self, class: &str, data: &str) {
        self.empty("path", &[("class", &class), ("d", &data)]);
    }

    /// A text of a picture; `anchor` says which part of it is at `x`.
    pub(super) fn label(
        &mut self,
        (x, y): (&dyn Display, &dyn Display),
        anchor: &'static str,
        text: impl Display,
    ) {
        self.element("text", &[("x", x), ("y", y), ("text-anchor", &anchor)], text);
    }

    /// Text, escaped.
    pub(super) fn text(&mut self, text: impl Display) {
        escape(&text.to_string(), &mut self.0);
    }

    /// A part of the page that is written in this program, as it stands.
    pub(super) fn literal(&mut self, text: &'static str) {
        self.0.push_str(text);
    }

    /// Other markup, as it stands.
    pub(super) fn append(&mut self, other: &Self) {
        self.0.push_str(&other.0);
    }

    pub(super) fn into_string(self) -> String {
        self.0
    }

    fn start(&mut self, tag: &'static str, attributes: &Attributes<'_>) {
        self.0.push('<');
        self.0.push_str(tag);
        for (name, value) in attributes {
            // Writing to a string does not fail.
            let _ = write!(self.0, " {name}=\"");
            escape(&value.to_string(), &mut self.0);
            self.0.push('"');
        }
    }
}

/// Appends `text` so that a browser shows it and reads no markup in it. Control characters and those that
/// change the direction of the text, by which a name could pass for another one, become U+FFFD.
fn escape(text: &str, out: &mut String) {
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(character),
            '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
                out.push('\u{fffd}');
            }
            other if other.is_control() => out.push('\u{fffd}'),
            other => out.push(other),
        }
    }
}
