//! `covis eval mask`: which masks belong together, what is counted, and what is refused.

use std::path::Path;

use serde_json::{Value, json};

use crate::cli_support::{Workspace, number};

/// Writes a 10 × 10 mask of which the first `count` pixels are masked.
fn mask(path: &Path, count: usize) {
    let pixels: Vec<u8> = (0..100).map(|k| if k < count { 255 } else { 0 }).collect();
    png(path, (10, 10), (png::ColorType::Grayscale, png::BitDepth::Eight), &pixels);
}

fn png(
    path: &Path,
    size: (u32, u32),
    (color, depth): (png::ColorType, png::BitDepth),
    pixels: &[u8],
) {
    fs_err::create_dir_all(path.parent().unwrap()).unwrap();
    let mut encoder = png::Encoder::new(fs_err::File::create(path).unwrap(), size.0, size.1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
}

/// A truth of four frames in TUM's form; the estimate has three of them and one more.
fn sequence() -> Workspace {
    let workspace = Workspace::new();
    let mut index = "# time path\n".to_owned();
    for (time, count) in [("100.000000", 40), ("100.033333", 1), ("100.066667", 20), ("100.1", 0)] {
        mask(&workspace.path(&format!("truth/mask/{time}.png")), count);
        index.push_str(&format!("{time} mask/{time}.png\n"));
    }
    workspace.file("truth/mask.txt", &index);
    // Names may differ in digits, not in time.
    for (time, count) in [("100.000012", 20), ("100.033333", 11), ("100.0667", 25), ("101", 5)] {
        mask(&workspace.path(&format!("masks/{time}.png")), count);
    }
    fs_err::write(workspace.path("masks/notes.txt"), "not a mask").unwrap();
    workspace
}

#[test]
fn masks_of_the_same_time_are_compared() {
    let workspace = sequence();
    let report = workspace.json("eval mask truth masks --json --report masks.html", &[]);
    let page = fs_err::read_to_string(workspace.path("masks.html")).unwrap();
    assert!(page.contains("Intersection over union") && page.contains("0.65</td>"), "mean IoU");
    let count = |key: &str| report[key].as_u64().unwrap();
    assert_eq!((count("frames"), count("truth_only"), count("estimate_only")), (3, 1, 1));
    // 20 of 40 and 20 of 25; the frame of which 1 % moves has no IoU.
    let close = |part: &Value, name: &str, expected: f64| {
        let value = number(part, name);
        assert!((value - expected).abs() < 1e-12, "{name}: {value}, not {expected}");
    };
    assert_eq!(report["iou"]["values"], 2);
    close(&report["iou"], "mean", (0.5 + 0.8) / 2.0);
    close(&report["false_share"], "mean", (0.0 + 0.10 + 0.05) / 3.0);
    close(&report["masked_share"], "mean", (0.20 + 0.11 + 0.25) / 3.0);
    // A plain folder is as good as one with an index.
    let plain = workspace.json("eval mask truth/mask masks --json", &[]);
    assert_eq!(plain, report);

    let ran = workspace.run("eval mask truth masks", &[]);
    for part in ["masks of 3 frames", "1 true ones have no estimate", "IoU", "0.6500", "0.0500"] {
        assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
    }
}

#[test]
fn in_a_static_sequence_all_that_is_masked_is_false() {
    let workspace = sequence();
    let report = workspace.json("eval mask --static masks --json", &[]);
    assert_eq!((&report["frames"], &report["iou"]), (&json!(4), &Value::Null));
    assert_eq!(report["false_share"], report["masked_share"]);
    assert!((number(&report["false_share"], "mean") - 0.1525).abs() < 1e-12);
    assert!(!workspace.run("eval mask --static masks", &[]).stdout.contains("IoU"));
}

#[test]
fn a_bad_mask_is_a_failure_that_names_the_file() {
    let workspace = sequence();
    let failure = |folder: &str, parts: &[&str]| {
        workspace.run(&format!("eval mask truth {folder}"), &[]).expect_failure(parts);
    };
    let path = |name: &str| workspace.path(name);
    let gray = (png::ColorType::Grayscale, png::BitDepth::Eight);
    png(&path("small/100.0.png"), (10, 9), gray, &[0; 90]);
    failure("small", &["100.000000.png", "small/100.0.png", "10 x 10 and 10 x 9"]);
    png(&path("color/100.0.png"), (2, 2), (png::ColorType::Rgb, png::BitDepth::Eight), &[0; 12]);
    failure("color", &["color/100.0.png", "8-bit gray"]);
    png(
        &path("deep/100.0.png"),
        (2, 2),
        (png::ColorType::Grayscale, png::BitDepth::Sixteen),
        &[0; 8],
    );
    failure("deep", &["deep/100.0.png", "8-bit gray", "16 bits"]);
    let whole = fs_err::read(path("masks/101.png")).unwrap();
    fs_err::create_dir_all(path("cut")).unwrap();
    fs_err::write(path("cut/100.0.png"), &whole[..whole.len() / 2]).unwrap();
    failure("cut", &["cut/100.0.png"]);
    mask(&path("named/first.png"), 0);
    failure("named", &["named/first.png", "time in seconds"]);
    mask(&path("twice/100.00001.png"), 0);
    mask(&path("twice/100.00002.png"), 0);
    failure("twice", &["100.00001.png", "100.00002.png", "same time"]);
    mask(&path("late/200.png"), 0);
    failure("late", &["truth and late"]);
    fs_err::create_dir_all(path("empty")).unwrap();
    failure("empty", &["empty has no masks"]);
    failure("nowhere", &["nowhere"]);
    workspace.file("empty/mask.txt", "# time path\n100.0\n");
    failure("empty", &["mask.txt, line 2"]);
    workspace.file("empty/mask.txt", "100.0 mask/gone.png\n");
    failure("empty", &["gone.png"]);
    workspace.run("eval mask truth", &[]).expect_failure(&["two folders"]);
    workspace.run("eval mask --static truth masks", &[]).expect_failure(&["--static"]);
    assert_eq!(workspace.run("eval mask", &[]).code, Some(2));
    assert_eq!(workspace.run("eval mask a b c", &[]).code, Some(2));
}
