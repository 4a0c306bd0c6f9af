//! A trajectory from above and from the side, colored by an error along it.
//!
//! The world need not have its z axis up: "above" looks along the axis in which the trajectory extends
//! least, and the axes are named. Both pictures have one scale in both directions. A trajectory of very
//! many poses shows [`MOST_POSES`] of them, of each piece the one with the largest error. The errors
//! are the caller's.

use super::chart::{LEFT, RIGHT, Role, TOP, WIDTH, columns, path, rows};
use super::markup::Markup;
use super::number::number;
use super::picture::Picture;
use super::scale::{Kind, Scale};
use super::thin::thin;

/// Poses of a path.
const MOST_POSES: usize = 2000;
/// Points of the scene.
const MOST_POINTS: usize = 2500;
/// Links between positions.
const MOST_LINKS: usize = 500;
/// Links that are few enough to have dots, which hide the path where they are many.
const MOST_DOTS: usize = 100;
/// Colors of errors, by their classes in the style sheet.
const COLORS: [&str; 7] = ["e0", "e1", "e2", "e3", "e4", "e5", "e6"];
const AXES: [&str; 3] = ["x", "y", "z"];

const MOST_HEIGHT: f64 = 440.0;
const LEAST_HEIGHT: f64 = 90.0;

/// What is drawn of a trajectory.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    /// What the trajectory is, for titles: "Trajectory", "Vertices".
    pub name: &'a str,
    /// The positions, m, in their order.
    pub positions: &'a [[f64; 3]],
    /// An error at each of them, at least 0; empty where there is none.
    pub errors: &'a [f64],
    /// What the errors are, with their unit.
    pub error_name: &'a str,
    /// Whether the positions follow each other; otherwise they are dots.
    pub is_path: bool,
    /// What it is compared with: its name and its positions.
    pub reference: Option<(&'a str, &'a [[f64; 3]])>,
    /// Points of the scene; those far from the trajectory are left out.
    pub points: &'a [[f64; 3]],
    /// Positions that are linked.
    pub links: &'a [Link],
}

/// Several paths beside what they are compared with.
#[derive(Clone, Copy, Debug)]
pub struct Paths<'a> {
    /// What they are, for titles.
    pub name: &'a str,
    /// What they are, in a sentence without its end.
    pub description: &'a str,
    /// Their names, which are short, and positions, m.
    pub paths: &'a [(String, Vec<[f64; 3]>)],
    /// What they are compared with: its name and its positions, m.
    pub reference: (&'a str, &'a [[f64; 3]]),
}

/// The paths from above, and from the side unless all lies in a plane.
#[must_use]
pub fn overlay(paths: &Paths<'_>) -> Vec<Picture> {
    let estimates = paths.paths.iter().map(|(_, positions)| positions.as_slice());
    let canvases = canvases(estimates.chain([paths.reference.1]));
    canvases.into_iter().map(|(kind, canvas)| canvas.draw_paths(paths, kind)).collect()
}

/// Two positions that a closure ties.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// One end, m.
    pub from: [f64; 3],
    /// The other.
    pub to: [f64; 3],
    /// Whether it counts; otherwise it was found false.
    pub counts: bool,
}

/// The picture from above, and that from the side unless the trajectory lies in a plane.
#[must_use]
pub fn views(plan: &Plan<'_>) -> Vec<Picture> {
    let reference = plan.reference.map_or(&[][..], |(_, positions)| positions);
    let canvases = canvases([plan.positions, reference]);
    canvases.into_iter().map(|(kind, canvas)| canvas.draw(plan, kind)).collect()
}

/// What the views of positions are drawn on, with what each looks from: above, and the side unless all lies
/// in a plane.
fn canvases<'a>(sets: impl IntoIterator<Item = &'a [[f64; 3]]>) -> Vec<(&'static str, Canvas)> {
    let positions: Vec<&[[f64; 3]]> = sets.into_iter().collect();
    let ranges = [0, 1, 2].map(|axis| {
        Scale::range(Kind::Linear, positions.iter().copied().flatten().map(|p| p[axis]))
    });
    let extents = ranges.map(|(low, high)| if high >= low { high - low } else { 0.0 });
    let mut axes = [0, 1, 2];
    // Stable: axes of one extent stay in their order.
    axes.sort_by(|&a, &b| extents[b].total_cmp(&extents[a]));
    let [longest, middle, up] = axes;
    let (across, along) = (longest.min(middle), longest.max(middle));
    let bounds = [0, 1, 2].map(|axis| bounds(ranges[axis], extents[longest]));
    let canvas = |axes: [usize; 2]| Canvas::new(axes, axes.map(|a| bounds[a]));
    let from_above = ("from above", canvas([across, along]));
    if extents[up] <= 1e-9 * extents[longest].max(1e-300) {
        vec![from_above]
    } else {
        vec![from_above, ("from the side", canvas([longest, up]))]
    }
}

/// A range with a margin; as wide as a share of the longest one at least.
fn bounds((low, high): (f64, f64), longest: f64) -> (f64, f64) {
    if high < low {
        return (0.0, 1.0);
    }
    let longest = if longest > 0.0 { longest } else { 1.0 };
    let width = (high - low).max(0.12 * longest) + 0.06 * longest;
    let middle = low.midpoint(high);
    (middle - width / 2.0, middle + width / 2.0)
}

/// Scales of one picture and what is drawn with them.
struct Canvas {
    x: Scale,
    y: Scale,
    axes: [usize; 2],
    bottom: f64,
}

impl Canvas {
    fn new(axes: [usize; 2], [(left, right), (low, high)]: [(f64, f64); 2]) -> Self {
        let (wide, tall) = (right - left, high - low);
        // One scale: what is too tall for its width gets less of the width.
        let scale = ((RIGHT - LEFT) / wide).min(MOST_HEIGHT / tall);
        let height = (tall * scale).max(LEAST_HEIGHT);
        let middle = (LEFT + RIGHT) / 2.0;
        let bottom = TOP + height;
        let half = (RIGHT - LEFT) / 2.0 / scale;
        let around = |middle: f64, half: f64| (middle - half, middle + half);
        let values = around(left.midpoint(right), half);
        let x = Scale::new(Kind::Linear, values, around(middle, half * scale));
        let values = around(low.midpoint(high), height / scale / 2.0);
        let y = Scale::new(Kind::Linear, values, (bottom, TOP));
        Self { x, y, axes, bottom }
    }

    fn draw(&self, plan: &Plan<'_>, kind: &str) -> Picture {
        let mut body = self.axes();
        self.points(plan.points, &mut body);
        if let Some((_, reference)) = plan.reference {
            self.line(Role::Reference, reference, &mut body);
        }
        let worst = self.path(plan, &mut body);
        self.links(plan.links, &mut body);
        self.legend(plan, worst, &mut body);
        let title = format!("{} {kind}", plan.name);
        let description = self.description(plan, worst);
        Picture::new(&title, &description, (WIDTH, self.bottom + 76.0), body)
    }

    /// Paths in colors of their own beside a reference, and the colors with their names.
    fn draw_paths(&self, paths: &Paths<'_>, kind: &str) -> Picture {
        let (mut body, mut x) = (self.axes(), LEFT);
        let (reference_name, reference) = paths.reference;
        self.line(Role::Reference, reference, &mut body);
        let (y, baseline) = (self.bottom + 56.0, format!("{:.1}", self.bottom + 60.0));
        for (number, (name, positions)) in paths.paths.iter().enumerate() {
            let role = Role::Series(number);
            self.line(role, positions, &mut body);
            body.path(role.line(), &format!("M{x:.1} {y:.1}h16"));
            let text = format!("{:.1}", x + 22.0);
            body.element("text", &[("x", &text), ("y", &baseline)], name);
            // Text cannot be measured here: a character is 7 wide at most.
            x += 7.0 * name.chars().count() as f64 + 34.0;
        }
        let [a, b] = self.axes.map(|axis| AXES[axis]);
        let description = format!(
            "{} over {a} and {b} in meters; the gray line is {reference_name}.",
            paths.description
        );
        let title = format!("{} {kind}", paths.name);
        Picture::new(&title, &description, (WIDTH, self.bottom + 76.0), body)
    }

    fn description(&self, plan: &Plan<'_>, worst: f64) -> String {
        let [a, b] = self.axes.map(|axis| AXES[axis]);
        let mut text = format!(
            "{} positions over {a} and {b} in meters",
            super::number::count(plan.positions.len())
        );
        if !plan.errors.is_empty() {
            text.push_str(&format!(", colored by {} (0 to {})", plan.error_name, number(worst)));
        }
        if let Some((name, _)) = plan.reference {
            text.push_str(&format!("; the gray line is {name}"));
        }
        if !plan.links.is_empty() {
            let off = plan.links.iter().filter(|link| !link.counts).count();
            text.push_str(&format!(
                "; {} closures count (green), {off} were found false (red, dashed)",
                plan.links.len() - off
            ));
        }
        text.push('.');
        text
    }

    fn at(&self, position: &[f64; 3]) -> (f64, f64) {
        (self.x.at(position[self.axes[0]]), self.y.at(position[self.axes[1]]))
    }

    fn axes(&self) -> Markup {
        let (mut body, bottom) = (Markup::default(), self.bottom);
        columns(&mut body, &self.x, bottom, &format!("{:.1}", bottom + 17.0));
        rows(&mut body, &self.y);
        let [across, along] = self.axes.map(|axis| format!("{}, m", AXES[axis]));
        let below = format!("{:.1}", bottom + 36.0);
        body.label((&((LEFT + RIGHT) / 2.0), &below), "middle", across);
        body.element("text", &[("x", &4), ("y", &(TOP - 13.0))], along);
        body
    }

    /// Dots of the scene, those inside the picture.
    fn points(&self, points: &[[f64; 3]], body: &mut Markup) {
        let (mut data, low) = (String::new(), self.bottom);
        for index in thin(points.len(), MOST_POINTS, |_| 0.0) {
            let (x, y) = self.at(&points[index]);
            // What lies at the border is outside.
            if points[index].iter().all(|v| v.is_finite())
                && x > LEFT
                && x < RIGHT
                && y > TOP
                && y < low
            {
                data.push_str(&format!("M{x:.1} {y:.1}h1v1h-1z"));
            }
        }
        if !data.is_empty() {
            body.path("dots", &data);
        }
    }

    fn line(&self, role: Role, positions: &[[f64; 3]], body: &mut Markup) {
        let kept = thin(positions.len(), MOST_POSES, |_| 0.0);
        let inside =
            kept.iter().map(|&k| &positions[k]).filter(|p| p.iter().all(|v| v.is_finite()));
        body.path(role.line(), &path(inside.map(|position| self.at(position))));
    }

    /// The path, piece by piece of one color. Gives the error of the last color.
    fn path(&self, plan: &Plan<'_>, body: &mut Markup) -> f64 {
        let error = |index: usize| plan.errors.get(index).copied().unwrap_or(0.0);
        let worst = color_limit(plan.errors);
        let kept = thin(plan.positions.len(), MOST_POSES, error);
        let kept: Vec<usize> =
            kept.into_iter().filter(|&k| plan.positions[k].iter().all(|v| v.is_finite())).collect();
        let color = |index: usize| {
            let share = if worst > 0.0 { error(index) / worst } else { 0.0 };
            // An error that is no number is as bad as can be.
            let class =
                if share.is_nan() { COLORS.len() } else { (share * COLORS.len() as f64) as usize };
            class.min(COLORS.len() - 1)
        };
        if !plan.is_path {
            // One path a color: a dot is a line of no length with round ends.
            for (class, name) in COLORS.iter().enumerate() {
                let of_class = kept.iter().filter(|&&k| color(k) == class);
                let data: String = of_class
                    .map(|&k| self.at(&plan.positions[k]))
                    .map(|(x, y)| format!("M{x:.1} {y:.1}h0"))
                    .collect();
                if !data.is_empty() {
                    body.path(&format!("error dot {name}"), &data);
                }
            }
            return worst;
        }
        let mut start = 0;
        while start + 1 < kept.len() {
            let class = color(kept[start + 1]);
            let mut end = start + 1;
            while end + 1 < kept.len() && color(kept[end + 1]) == class {
                end += 1;
            }
            let data = path(kept[start..=end].iter().map(|&k| self.at(&plan.positions[k])));
            let class = if plan.errors.is_empty() {
                "line after".to_owned()
            } else {
                format!("error {}", COLORS[class])
            };
            body.path(&class, &data);
            start = end;
        }
        worst
    }

    /// Links; those that were found false are on top, however many there are.
    fn links(&self, links: &[Link], body: &mut Markup) {
        // Positions that are tied are near each other as a rule: a dot shows where.
        for (counts, line, dot) in [(true, "good", "good dot"), (false, "bad dashed", "bad dot")] {
            let of_kind: Vec<&Link> = links.iter().filter(|link| link.counts == counts).collect();
            let kept = thin(of_kind.len(), MOST_LINKS, |_| 0.0);
            let ends = kept.iter().map(|&k| [of_kind[k].from, of_kind[k].to]);
            let lines = ends.filter(|ends| ends.iter().flatten().all(|v| v.is_finite()));
            let (mut data, mut dots) = (String::new(), String::new());
            for ends in lines {
                data.push_str(&path(ends.iter().map(|end| self.at(end))));
                let (x, y) = self.at(&ends[1]);
                dots.push_str(&format!("M{x:.1} {y:.1}h0"));
            }
            if !data.is_empty() {
                body.path(line, &data);
            }
            if !dots.is_empty() && kept.len() <= MOST_DOTS {
                body.path(dot, &dots);
            }
        }
    }

    /// The colors with their errors, below the picture.
    fn legend(&self, plan: &Plan<'_>, worst: f64, body: &mut Markup) {
        const SWATCH: f64 = 26.0;
        if plan.errors.is_empty() {
            return;
        }
        let y = self.bottom + 56.0;
        let mut x = LEFT;
        for name in COLORS {
            let line = format!("M{:.1} {y:.1}h{:.1}", x + 2.0, SWATCH - 4.0);
            body.path(&format!("error dot {name}"), &line);
            x += SWATCH;
        }
        let (middle, baseline) = (format!("{:.1}", x + 10.0), format!("{:.1}", y + 4.0));
        // What the colors mean is in the description, which has the room.
        let text = format!("0 to {} and more", number(worst));
        body.element("text", &[("x", &middle), ("y", &baseline)], text);
    }
}

/// Where the last color begins: the 99 % quantile, so that one outlier does not make all else one color.
fn color_limit(errors: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = errors.iter().copied().filter(|error| error.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let index = (0.99 * sorted.len().saturating_sub(1) as f64).ceil() as usize;
    sorted.get(index).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::{Plan, color_limit, views};

    fn plan<'a>(positions: &'a [[f64; 3]], errors: &'a [f64]) -> Plan<'a> {
        Plan {
            name: "Trajectory",
            positions,
            errors,
            error_name: "error, m",
            is_path: true,
            reference: None,
            points: &[],
            links: &[],
        }
    }

    #[test]
    fn above_looks_along_the_axis_of_least_extent() {
        let positions: Vec<[f64; 3]> =
            (0..50).map(f64::from).map(|k| [k, 0.1 * k.sin(), 3.0 * k.cos()]).collect();
        let pictures = views(&plan(&positions, &[]));
        let texts: Vec<String> = pictures.iter().map(|picture| format!("{picture:?}")).collect();
        assert_eq!(texts.len(), 2);
        assert!(texts[0].contains("over x and z"), "{}", texts[0]);
        assert!(texts[1].contains("over x and y"), "{}", texts[1]);
        let flat: Vec<[f64; 3]> = positions.iter().map(|p| [p[0], p[2], 0.0]).collect();
        assert_eq!(views(&plan(&flat, &[])).len(), 1);
    }

    #[test]
    fn one_outlier_does_not_take_all_colors() {
        let mut errors = vec![0.01; 500];
        errors[250] = 90.0;
        assert_eq!(color_limit(&errors), 0.01);
        assert_eq!(color_limit(&[]), 0.0);
    }
}
