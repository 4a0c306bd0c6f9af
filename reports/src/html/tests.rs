//! What the page promises whatever it is given: nothing is loaded, nothing runs, sizes are bounded, the
//! same input gives the same bytes.

use super::*;

const HOSTILE: &str = "</title><script>alert(1)</script>\"' onload='x' & \u{202e}map\u{7}";

fn labels<'a>(title: &'a str) -> Labels<'a> {
    Labels { title, description: "what it shows", x: "x", y: "y" }
}

#[test]
fn text_from_outside_never_becomes_markup() {
    let facts = [("map", HOSTILE.to_owned())];
    let mut page = Page::new(HOSTILE, HOSTILE, HOSTILE, &facts);
    page.section(HOSTILE);
    page.note(HOSTILE);
    let line = Line {
        name: Some(HOSTILE.to_owned()),
        role: Role::After,
        points: vec![(0.0, 1.0), (1.0, 2.0)],
        marked: Vec::new(),
    };
    let bar = Bar { name: HOSTILE.to_owned(), value: 1.0, mark: None };
    let named = Labels { title: HOSTILE, description: HOSTILE, x: HOSTILE, y: HOSTILE };
    let positions = [[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]];
    let plan = Plan {
        name: HOSTILE,
        positions: &positions,
        errors: &[0.1, 0.2],
        error_name: HOSTILE,
        is_path: true,
        reference: Some((HOSTILE, &positions)),
        points: &[],
        links: &[],
    };
    let mut pictures = vec![lines(named, Span::OfValues, &[line]), bars(named, &[bar])];
    pictures.push(histogram(named, Some(&[1.0]), &[2.0]));
    pictures.extend(views(&plan));
    let paths = [(HOSTILE.to_owned(), positions.to_vec())];
    let reference = (HOSTILE, &positions[..]);
    pictures.extend(overlay(&Paths {
        name: HOSTILE,
        description: HOSTILE,
        paths: &paths,
        reference,
    }));
    let table = Table::new(HOSTILE, &[HOSTILE], vec![vec![HOSTILE.to_owned()]]);
    page.row(&pictures, &[table]);
    let html = page.finish(HOSTILE);
    for text in ["<script", "onload='", "\u{202e}", "\u{7}", "\"' on"] {
        assert!(!html.contains(text), "{text:?} is in the page");
    }
    assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
    // Every tag that opens closes: a name broke none of them.
    for tag in
        ["table", "svg", "figure", "tr", "td", "th", "text", "desc", "title", "h2", "p", "div"]
    {
        let opened =
            html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
        assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
    }
}

#[test]
fn nothing_is_loaded_from_elsewhere_and_nothing_runs() {
    let mut page = Page::new("title", "covis solve", "", &[]);
    page.row(&[lines(labels("Cost"), Span::OfValues, &[])], &[]);
    let html = page.finish("covis");
    for text in ["<script", "<link", "<img", "<iframe", "url(", "@import", "javascript:", "href"] {
        assert!(!html.contains(text), "{text}");
    }
    // The name of a namespace is the only address, and nobody fetches it.
    let addresses = html.matches("http").count();
    assert_eq!(
        addresses,
        html.matches("http://www.w3.org/2000/svg").count() + html.matches("http-equiv").count()
    );
    assert!(html.contains("default-src 'none'"));
    assert!(html.contains("prefers-color-scheme: dark") && html.contains("@media print"));
}

#[test]
fn every_picture_has_a_title_and_a_description_of_its_own() {
    let mut page = Page::new("title", "covis solve", "", &[]);
    let picture = histogram(labels("Residuals"), None, &[1.0, 2.0]);
    page.row(&[picture.clone(), picture], &[]);
    let html = page.finish("covis");
    for id in 0..2 {
        assert!(html.contains(&format!("aria-labelledby=\"t{id} d{id}\"")));
        assert!(html.contains(&format!("<title id=\"t{id}\">Residuals</title>")));
        assert!(html.contains(&format!("<desc id=\"d{id}\">what it shows</desc>")));
    }
}

#[test]
fn a_million_poses_make_a_small_page_that_shows_the_worst_of_them() {
    let count = 1_000_000;
    let positions: Vec<[f64; 3]> = (0..count)
        .map(|k| f64::from(k) * 1e-4)
        .map(|t| [t.cos() * 50.0, t.sin() * 50.0, 0.01 * t])
        .collect();
    let mut errors = vec![0.02; positions.len()];
    errors[123_456] = 7.0;
    // Many enough that the last color begins there.
    errors[500_000..520_000].fill(3.0);
    let links = vec![Link { from: positions[0], to: positions[9], counts: true }; 100_000];
    let plan = Plan {
        name: "Trajectory",
        positions: &positions,
        errors: &errors,
        error_name: "error, m",
        is_path: true,
        reference: Some(("the truth", &positions)),
        points: &positions,
        links: &links,
    };
    let mut page = Page::new("title", "covis eval", "", &[]);
    page.row(&views(&plan), &[]);
    let points: Vec<(f64, f64)> = errors.iter().enumerate().map(|(k, &e)| (k as f64, e)).collect();
    let line = Line { name: None, role: Role::After, points, marked: Vec::new() };
    page.row(
        &[
            lines(labels("Errors"), Span::FromZero, &[line]),
            histogram(labels("All"), None, &errors),
        ],
        &[],
    );
    let rows = vec![vec!["1".to_owned(); 4]; 100_000];
    page.table(&Table::new("Closures", &["a", "b", "c", "d"], rows));
    let html = page.finish("covis");
    assert!(html.len() < 700_000, "{} bytes", html.len());
    assert!(html.contains("error e6") && html.contains("99\u{2009}800 more"));
    // The one worst error stands at the top of its chart.
    assert!(html.contains(" 30.0L"), "the largest error is not drawn");
}

#[test]
fn numbers_that_are_none_and_empty_sets_draw_without_harm() {
    let none = [f64::NAN, f64::INFINITY, -1.0, 0.0];
    let points = none.iter().map(|&v| (v, v)).collect();
    let line = Line { name: None, role: Role::Before, points, marked: vec![(f64::NAN, 1.0)] };
    let bar = |value| Bar { name: "a".to_owned(), value, mark: Some(f64::NAN) };
    let positions = [[f64::NAN, 0.0, 1.0], [1.0, 1.0, 1.0], [2.0, f64::INFINITY, 1.0]];
    let plan = |positions| Plan {
        name: "Trajectory",
        positions,
        errors: &none,
        error_name: "error, m",
        is_path: false,
        reference: None,
        points: positions,
        links: &[],
    };
    let mut page = Page::new("title", "covis", "", &[]);
    page.row(
        &[
            lines(labels("a"), Span::OfValues, std::slice::from_ref(&line)),
            lines(labels("b"), Span::FromZero, &[line]),
        ],
        &[],
    );
    page.row(
        &[histogram(labels("c"), Some(&none), &[]), histogram(labels("d"), None, &[0.0; 9])],
        &[],
    );
    page.row(&[bars(labels("e"), &[bar(f64::NAN), bar(0.0)]), bars(labels("f"), &[])], &[]);
    page.row(&views(&plan(&positions)), &[]);
    page.row(&views(&plan(&[])), &[]);
    let html = page.finish("covis");
    assert!(!html.contains("NaN") && !html.contains("inf "), "a coordinate is no number");
}

/// The y of the points of a picture's first line, and the texts of its ticks beside y.
fn drawn(picture: &Picture) -> (Vec<f64>, Vec<String>) {
    let mut page = Page::new("title", "covis", "", &[]);
    page.row(std::slice::from_ref(picture), &[]);
    let html = page.finish("covis");
    let (_, line) = html.split_once("class=\"line after\" d=\"M").unwrap();
    let points = line.split_once('"').unwrap().0.split('L');
    let heights = points.map(|point| point.split_once(' ').unwrap().1.parse().unwrap()).collect();
    let ticks = html.split("text-anchor=\"end\">").skip(1);
    (heights, ticks.map(|text| text.split_once('<').unwrap().0.to_owned()).collect())
}

fn falling(values: &[f64]) -> Picture {
    let points = values.iter().enumerate().map(|(k, &v)| (k as f64, v)).collect();
    lines(labels("Cost"), Span::OfValues, &[Line { points, ..Line::default() }])
}

#[test]
fn an_axis_by_powers_of_ten_says_so_and_has_its_ticks_there() {
    for values in
        [vec![4e5, 3e4, 7e3, 5.2e3], vec![95.0, 9.4], vec![1000.0, 1.0], vec![3e-7, 2e9, 0.0]]
    {
        let picture = falling(&values);
        assert!(format!("{picture:?}").contains("logarithmic"), "{values:?}");
        let (_, ticks) = drawn(&picture);
        let powers: Vec<f64> =
            ticks.iter().map(|text| text.parse::<f64>().unwrap().log10()).collect();
        assert!(powers.len() >= 2, "{ticks:?}");
        assert!(powers.iter().all(|power| (power - power.round()).abs() < 1e-9), "{ticks:?}");
    }
}

#[test]
fn a_cost_that_falls_by_a_percent_or_less_falls_over_the_whole_picture() {
    for last in [990.0, 999.9, 999.999_9, 150.0] {
        let picture = falling(&[1000.0, last + 0.2 * (1000.0 - last), last]);
        assert!(!format!("{picture:?}").contains("logarithmic"), "{last}");
        let (heights, ticks) = drawn(&picture);
        assert_eq!((heights[0], heights[2]), (30.0, 256.0), "{last}");
        assert!(
            (heights[1] - (256.0 - 0.2 * 226.0)).abs() < 0.11,
            "as far as the cost: {heights:?}"
        );
        assert!(ticks.len() >= 2 && ticks.windows(2).all(|pair| pair[0] != pair[1]), "{ticks:?}");
    }
    // One that stays is a line in the middle.
    assert_eq!(drawn(&falling(&[7.0, 7.0])).0, [143.0, 143.0]);
}

#[test]
fn numbers_have_few_digits() {
    let all = [
        (0.0, "0"),
        (3.0, "3"),
        (-12.5, "-12.5"),
        (0.012_345_6, "0.01235"),
        (1234.567, "1235"),
        (1.5e-7, "1.500e-7"),
        (2.5e9, "2.500e9"),
    ];
    for (value, text) in all {
        assert_eq!(number(value), text);
    }
    assert_eq!(count(1_234_567), "1\u{2009}234\u{2009}567");
    assert_eq!(count(12), "12");
}

#[test]
fn residuals_that_are_next_to_nothing_are_counted_and_not_drawn() {
    let bars = |tiny: usize| {
        let mut values = vec![1e-9; tiny];
        values.extend((1..=80).map(|k| f64::from(k) * 0.01));
        let mut page = Page::new("title", "covis", "", &[]);
        page.row(&[histogram(labels("Residuals"), None, &values)], &[]);
        page.finish("covis")
    };
    let (html, without) = (bars(20), bars(0));
    assert!(html.contains("20 % are below") && !without.contains("are below"), "{html}");
    // The axis begins where the others do.
    assert!(!html.contains("1e-9") && !html.contains("1e-8"), "{html}");
}

#[test]
fn a_page_begins_with_its_verdict_and_folds_long_tables() {
    let mut page = Page::new("title", "covis solve", "Converged & done.", &[]);
    let rows = (0..30).map(|k| vec![k.to_string(), "x".to_owned()]).collect();
    page.folded(&Table::new("Iterations", &["iteration", "cost"], rows));
    let html = page.finish("covis");
    let at = |part: &str| html.find(part).unwrap_or_else(|| panic!("`{part}` in {html}"));
    assert!(at("Converged &amp; done.") < at("covis solve</code>"));
    assert!(at("<details>") < at("Iterations: 30 rows") && at("</table>") < at("</details>"));
    let plain = Page::new("title", "covis", "", &[]).finish("covis");
    assert!(!plain.contains("class=\"verdict\""), "{plain}");
}
