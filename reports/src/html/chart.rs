//! Charts: lines, histograms and bars over axes.
//!
//! Coordinates have one decimal. A chart of very many points shows [`MOST_POINTS`] of a line, those with
//! the largest values. The values are the caller's: none is smoothed or fitted.

use std::fmt::{Display, Write};

use super::markup::Markup;
use super::number::number;
use super::picture::Picture;
use super::scale::{Kind, Scale};
use super::thin::thin;

/// Points of a line.
const MOST_POINTS: usize = 800;
/// The largest over the smallest value from which an axis is by powers of ten.
const DECADE: f64 = 10.0;
/// Bins of a histogram.
const BINS: usize = 48;

pub(super) const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 300.0;
pub(super) const LEFT: f64 = 66.0;
pub(super) const RIGHT: f64 = 546.0;
pub(super) const TOP: f64 = 30.0;
const BOTTOM: f64 = 256.0;

/// The role of a line, an area or a path; it decides its color.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Role {
    /// What was there first.
    Before,
    /// What it became.
    #[default]
    After,
    /// What it is compared with.
    Reference,
    /// One of several of a kind, by its number from 0. Numbers from 6 on are dashed, and colors repeat
    /// after [`SERIES`].
    Series(usize),
}

/// The classes of [`Role::Series`].
const SERIES_LINES: [&str; SERIES] = [
    "line s0",
    "line s1",
    "line s2",
    "line s3",
    "line s4",
    "line s5",
    "line s0 dashed",
    "line s1 dashed",
    "line s2 dashed",
    "line s3 dashed",
    "line s4 dashed",
    "line s5 dashed",
];
/// How many lines of a kind can be told apart.
pub const SERIES: usize = 12;

impl Role {
    pub(super) fn line(self) -> &'static str {
        match self {
            Self::Before => "line before",
            Self::After => "line after",
            Self::Reference => "line reference",
            Self::Series(number) => SERIES_LINES[number % SERIES],
        }
    }
}

/// A line of a chart; by default without points, name and marks.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// Its name in the legend; none where there is one line only.
    pub name: Option<String>,
    /// Its role.
    pub role: Role,
    /// x and y, by increasing x. Points that are not finite are left out.
    pub points: Vec<(f64, f64)>,
    /// Points that are marked, for instance rejected steps.
    pub marked: Vec<(f64, f64)>,
}

/// The texts around a chart.
#[derive(Clone, Copy, Debug)]
pub struct Labels<'a> {
    /// The picture's title.
    pub title: &'a str,
    /// What the picture shows, in a sentence, for those who do not see it.
    pub description: &'a str,
    /// What is along x, with its unit.
    pub x: &'a str,
    /// What is along y, with its unit.
    pub y: &'a str,
}

/// What the axis of values of [`lines`] spans.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Span {
    /// From 0, so that heights compare as the values do.
    FromZero,
    /// The values alone.
    Linear,
    /// The same, but by powers of ten where the largest is ten times the smallest, which the
    /// description then says.
    OfValues,
}

/// Lines over x.
#[must_use]
pub fn lines(labels: Labels<'_>, span: Span, lines: &[Line]) -> Picture {
    let all = || lines.iter().flat_map(|line| line.points.iter().chain(&line.marked));
    let x = Scale::new(Kind::Linear, Scale::range(Kind::Linear, all().map(|p| p.0)), (LEFT, RIGHT));
    let (low, high) = Scale::range(Kind::Linear, all().map(|p| p.1));
    let positive = Scale::range(Kind::Log, all().map(|p| p.1));
    let (kind, range) = match span {
        Span::FromZero => (Kind::Linear, (low.min(0.0), high)),
        Span::OfValues if positive.1 >= DECADE * positive.0 => {
            (Kind::Log, Scale::whole_decades(positive))
        }
        Span::Linear | Span::OfValues => (Kind::Linear, (low, high)),
    };
    let y = Scale::new(kind, range, (BOTTOM, TOP));
    let mut body = axes(&x, &y, &labels);
    for line in lines {
        let points = finite(&line.points);
        let kept = thin(points.len(), MOST_POINTS, |index| points[index].1);
        let pixels = kept.iter().map(|&index| (x.at(points[index].0), y.at(points[index].1)));
        body.path(line.role.line(), &path(pixels));
        let marked = finite(&line.marked);
        for index in thin(marked.len(), MOST_POINTS, |_| 0.0) {
            let (cx, cy) = (x.at(marked[index].0), y.at(marked[index].1));
            let (cx, cy) = (format!("{cx:.1}"), format!("{cy:.1}"));
            body.empty("circle", &[("class", &"rejected"), ("cx", &cx), ("cy", &cy), ("r", &3)]);
        }
    }
    let named = lines.iter().filter_map(|line| Some((line.name.as_deref()?, line.role)));
    legend(&mut body, &named.collect::<Vec<_>>());
    let by_powers = if kind == Kind::Log { " The axis is logarithmic." } else { "" };
    let description = format!("{}{by_powers}", labels.description);
    Picture::new(labels.title, &description, (WIDTH, HEIGHT), body)
}

fn finite(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).collect()
}

/// How often each size occurs, over its logarithm: before and after, each as a share of its own count.
///
/// Sizes that are not finite are left out. Those that are next to nothing beside the others, as residuals of
/// what only one measurement determines, are not drawn but counted in the description.
#[must_use]
pub fn histogram(labels: Labels<'_>, before: Option<&[f64]>, after: &[f64]) -> Picture {
    let sets = [(Role::Before, before.unwrap_or_default()), (Role::After, after)];
    let ranges = sets.iter().filter_map(|(_, values)| range_of_sizes(values));
    let range = ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((1.0, 1.0));
    let x = Scale::new(Kind::Log, range, (LEFT, RIGHT));
    let mut tiny = 0_usize;
    let shares = sets.map(|(role, values)| {
        let mut bins = [0_usize; BINS];
        let mut count = 0_usize;
        for value in values.iter().filter(|value| value.is_finite()) {
            count += 1;
            if *value < range.0 {
                tiny += 1;
                continue;
            }
            let bin = (x.at(*value) - LEFT) / (RIGHT - LEFT) * BINS as f64;
            bins[(bin as usize).min(BINS - 1)] += 1;
        }
        (role, bins.map(|bin| 100.0 * bin as f64 / count.max(1) as f64), count)
    });
    let most = shares.iter().flat_map(|set| set.1).fold(0.0, f64::max);
    let y = Scale::new(Kind::Linear, (0.0, most), (BOTTOM, TOP));
    let mut body = axes(&x, &y, &labels);
    for (role, bins, count) in shares {
        if count == 0 {
            continue;
        }
        let left = |bin: usize| LEFT + (RIGHT - LEFT) * bin as f64 / BINS as f64;
        let steps = bins
            .iter()
            .enumerate()
            .flat_map(|(bin, share)| [(left(bin), y.at(*share)), (left(bin + 1), y.at(*share))]);
        let outline =
            std::iter::once((LEFT, BOTTOM)).chain(steps).chain(std::iter::once((RIGHT, BOTTOM)));
        body.path(&format!("area {}", role.line()), &path(outline));
    }
    if before.is_some_and(|before| !before.is_empty()) {
        legend(&mut body, &[("before", Role::Before), ("after", Role::After)]);
    }
    let all: usize = sets.iter().map(|(_, values)| values.len()).sum();
    let left_out = match 100.0 * tiny as f64 / all.max(1) as f64 {
        share if share < 0.5 => String::new(),
        share => format!(" {share:.0} % are below {} and not drawn.", number(range.0)),
    };
    let description = format!("{}{left_out}", labels.description);
    Picture::new(labels.title, &description, (WIDTH, HEIGHT), body)
}

/// The range of sizes that a histogram shows: all of them, but no tail that is a thousand times smaller than
/// nearly all others, nor the last 0.2 %. `None` where no size is positive.
fn range_of_sizes(values: &[f64]) -> Option<(f64, f64)> {
    const TINY: f64 = 1e-3;
    let mut sizes: Vec<f64> =
        values.iter().copied().filter(|v| v.is_finite() && *v > 0.0).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let at =
        |share: f64| sizes.get((share * sizes.len().saturating_sub(1) as f64) as usize).copied();
    Some((at(0.002)?.max(TINY * at(0.9)?), at(1.0)?))
}

/// A bar of [`bars`].
#[derive(Clone, Debug)]
pub struct Bar {
    /// Its name.
    pub name: String,
    /// Its length.
    pub value: f64,
    /// A mark further out, for instance a quantile.
    pub mark: Option<f64>,
}

/// Bars below each other. `labels.y` is not shown: each bar has its name.
#[must_use]
pub fn bars(labels: Labels<'_>, all: &[Bar]) -> Picture {
    const PITCH: f64 = 26.0;
    const NAMES: f64 = 110.0;
    let bottom = TOP + PITCH * all.len() as f64;
    let most = all.iter().flat_map(|bar| [Some(bar.value), bar.mark]).flatten();
    let (_, high) = Scale::range(Kind::Linear, most);
    let high = if high > 0.0 { high } else { 1.0 };
    let x = Scale::new(Kind::Linear, (0.0, high), (NAMES, RIGHT));
    let mut body = Markup::default();
    columns(&mut body, &x, bottom, &format!("{:.1}", bottom + 16.0));
    for (row, bar) in all.iter().enumerate() {
        let middle = TOP + PITCH * (row as f64 + 0.5);
        let (baseline, top) = (format!("{:.1}", middle + 4.0), format!("{:.1}", middle - 7.0));
        let name = shortened(&bar.name);
        let attributes: [(&str, &dyn Display); 4] = [
            ("class", &"strong"),
            ("x", &(NAMES - 8.0)),
            ("y", &baseline),
            ("text-anchor", &"end"),
        ];
        body.element("text", &attributes, name);
        let width = format!("{:.1}", (x.at(bar.value) - NAMES).max(1.0));
        let box_of: [(&str, &dyn Display); 5] = [
            ("class", &"fill-after"),
            ("x", &NAMES),
            ("y", &top),
            ("width", &width),
            ("height", &14),
        ];
        body.empty("rect", &box_of);
        if let Some(mark) = bar.mark.filter(|mark| mark.is_finite()) {
            let line = format!("M{:.1} {:.1}V{:.1}", x.at(mark), middle - 9.0, middle + 9.0);
            body.path("mark", &line);
        }
    }
    let (center, below) =
        (format!("{:.1}", (NAMES + RIGHT) / 2.0), format!("{:.1}", bottom + 34.0));
    body.label((&center, &below), "middle", labels.x);
    Picture::new(labels.title, labels.description, (WIDTH, bottom + 44.0), body)
}

/// A name that fits beside a bar.
fn shortened(name: &str) -> String {
    const MOST: usize = 16;
    if name.chars().count() <= MOST {
        name.to_owned()
    } else {
        name.chars().take(MOST - 1).chain(['…']).collect()
    }
}

/// Path data through points, one decimal each.
pub(super) fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut data = String::new();
    for (index, (x, y)) in points.enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        // Writing to a string does not fail.
        let _ = write!(data, "{command}{x:.1} {y:.1}");
    }
    data
}

/// Grid, ticks and labels.
fn axes(x: &Scale, y: &Scale, labels: &Labels<'_>) -> Markup {
    let mut body = Markup::default();
    columns(&mut body, x, BOTTOM, &(BOTTOM + 17.0));
    rows(&mut body, y);
    body.path("axis", &format!("M{LEFT:.1} {TOP:.1}V{BOTTOM:.1}H{RIGHT:.1}"));
    body.label((&((LEFT + RIGHT) / 2.0), &(BOTTOM + 37.0)), "middle", labels.x);
    body.element("text", &[("x", &4), ("y", &(TOP - 13.0))], labels.y);
    body
}

/// The ticks of `x`: lines down to `bottom`, texts at the height `below`.
pub(super) fn columns(body: &mut Markup, x: &Scale, bottom: f64, below: &dyn Display) {
    for (value, text) in x.ticks() {
        let at = format!("{:.1}", x.at(value));
        body.path("grid", &format!("M{at} {TOP:.1}V{bottom:.1}"));
        body.label((&at, below), "middle", text);
    }
}

/// The ticks of `y`: lines across, texts left of them.
pub(super) fn rows(body: &mut Markup, y: &Scale) {
    for (value, text) in y.ticks() {
        let at = y.at(value);
        body.path("grid", &format!("M{LEFT:.1} {at:.1}H{RIGHT:.1}"));
        body.label((&(LEFT - 7.0), &format!("{:.1}", at + 4.0)), "end", text);
    }
}

/// Names of lines and areas, at the top right.
fn legend(body: &mut Markup, entries: &[(&str, Role)]) {
    let mut right = RIGHT;
    for (name, role) in entries.iter().rev() {
        body.label((&format!("{right:.1}"), &(TOP - 13.0)), "end", name);
        // Text cannot be measured here: a character is 7 wide at most.
        right -= 7.0 * name.chars().count() as f64 + 6.0;
        body.path(role.line(), &format!("M{:.1} {:.1}h-16", right, TOP - 17.0));
        right -= 30.0;
    }
}
