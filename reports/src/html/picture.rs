//! A picture with the texts that stand for it where it is not seen.
//!
//! It draws nothing: charts and plans bring the drawing.

use super::markup::Markup;

/// A drawing with its title and its description.
#[derive(Clone, Debug)]
pub struct Picture {
    title: String,
    description: String,
    size: (f64, f64),
    body: Markup,
}

impl Picture {
    pub(super) fn new(title: &str, description: &str, size: (f64, f64), body: Markup) -> Self {
        Self { title: title.to_owned(), description: description.to_owned(), size, body }
    }

    /// Appends it as a figure; `id` tells it from the other pictures of the page.
    pub(super) fn write(&self, id: usize, out: &mut Markup) {
        let (title_id, description_id) = (format!("t{id}"), format!("d{id}"));
        let view_box = format!("0 0 {:.0} {:.0}", self.size.0, self.size.1);
        let named_by = format!("{title_id} {description_id}");
        out.open("figure", &[]);
        let attributes: [(&'static str, &dyn std::fmt::Display); 4] = [
            ("viewBox", &view_box),
            ("role", &"img"),
            ("aria-labelledby", &named_by),
            ("xmlns", &"http://www.w3.org/2000/svg"),
        ];
        out.open("svg", &attributes);
        out.element("title", &[("id", &title_id)], &self.title);
        out.element("desc", &[("id", &description_id)], &self.description);
        out.append(&self.body);
        out.close("svg");
        out.element("figcaption", &[], format_args!("{}. {}", self.title, self.description));
        out.close("figure");
    }
}
