//! The manifests: one place for versions, lints for every crate, one binary of integration tests.

use crate::report;
use crate::source::{File, files};

fn manifests() -> Vec<File> {
    files().into_iter().filter(|f| f.path.ends_with("Cargo.toml")).collect()
}

/// Lines of a manifest with their number and section.
fn entries(manifest: &File) -> Vec<(usize, String, String)> {
    let mut section = String::new();
    let mut found = Vec::new();
    for (number, line) in manifest.text.lines().enumerate() {
        let line = line.split(" #").next().unwrap_or(line).trim();
        if line.starts_with('[') {
            section = line.trim_matches(['[', ']']).to_owned();
        }
        if !line.is_empty() && !line.starts_with('#') {
            found.push((number + 1, section.clone(), line.to_owned()));
        }
    }
    found
}

#[test]
fn versions_stand_in_the_root_manifest_only() {
    let mut offenders = Vec::new();
    for manifest in manifests() {
        for (number, section, line) in entries(&manifest) {
            let location = format!("{}:{number}", manifest.path);
            let dependencies = section.rsplit('.').next().unwrap_or(&section);
            let listed =
                dependencies.ends_with("dependencies") && section != "workspace.dependencies";
            if section.contains("dependencies.") && line.starts_with('[') {
                offenders.push(format!("{location}: `{line}`: a dependency takes one line"));
            } else if listed && !line.starts_with('[') {
                let inherited = line.contains("workspace = true");
                let own_path = line.contains("path =") && !line.contains("version");
                if !inherited && !own_path {
                    offenders.push(format!("{location}: `{line}`: use `workspace = true`"));
                }
            }
        }
    }
    report("Versions stand in [workspace.dependencies] only.", &offenders);
}

#[test]
fn no_version_is_listed_in_vain() {
    let manifests = manifests();
    let used = |name: &str| {
        manifests.iter().flat_map(entries).any(|(_, section, line)| {
            section != "workspace.dependencies"
                && line.strip_prefix(name).is_some_and(|rest| rest.starts_with(['.', ' ', '=']))
        })
    };
    let mut offenders = Vec::new();
    for (number, section, line) in
        manifests.iter().filter(|m| m.path == "Cargo.toml").flat_map(entries)
    {
        let name = line.split([' ', '=']).next().unwrap_or(&line);
        if section == "workspace.dependencies" && !line.starts_with('[') && !used(name) {
            offenders.push(format!("Cargo.toml:{number}: `{name}` is used by no crate"));
        }
    }
    report("Every listed version is used.", &offenders);
}

#[test]
fn the_crates_below_stand_without_the_server() {
    let walls: [(&str, &[&str]); 7] = [
        (
            "solvers/Cargo.toml",
            &[
                "tokio",
                "tonic",
                "prost",
                "async",
                "futures",
                "covis ",
                "covis-client",
                "covis-dense",
                "covis-front",
                "covis-map",
            ],
        ),
        ("reports/Cargo.toml", &["tokio", "tonic", "prost", "covis ", "covis-map", "covis-client"]),
        ("store/Cargo.toml", &["tonic", "hyper", "covis ", "covis-front"]),
        (
            "map/Cargo.toml",
            &[
                "tokio",
                "tonic",
                "prost",
                "async",
                "futures",
                "covis ",
                "covis-client",
                "covis-dense",
                "covis-front",
            ],
        ),
        ("client/Cargo.toml", &["covis", "faer", "nalgebra", "rayon"]),
        (
            "dense/Cargo.toml",
            &[
                "tokio",
                "tonic",
                "prost",
                "async",
                "futures",
                "covis ",
                "covis-client",
                "covis-front",
                "covis-map",
            ],
        ),
        ("frontend/Cargo.toml", &["tonic", "covis ", "covis-map"]),
    ];
    let mut offenders = Vec::new();
    for manifest in manifests() {
        let Some((_, barred)) = walls.iter().find(|(path, _)| *path == manifest.path) else {
            continue;
        };
        for (number, section, line) in entries(&manifest) {
            if section.ends_with("dependencies") && barred.iter().any(|b| line.starts_with(b)) {
                offenders.push(format!("{}:{number}: `{line}`", manifest.path));
            }
        }
    }
    report("A crate has a dependency that it must not have.", &offenders);
}

#[test]
fn every_crate_takes_the_workspace_lints() {
    let lacks = |m: &File| {
        !entries(m)
            .iter()
            .any(|(_, section, line)| section == "lints" && line == "workspace = true")
    };
    let offenders: Vec<String> =
        manifests().into_iter().filter(|m| lacks(m)).map(|m| m.path).collect();
    report("Every crate has `[lints] workspace = true`.", &offenders);
}

/// A file beside `main.rs` in a tests folder would be found by cargo as a binary of its own and be
/// built and run twice; `autotests = false` keeps it a module.
#[test]
fn integration_tests_are_one_binary() {
    let mut offenders = Vec::new();
    for (folder, manifest) in [
        ("client/tests/", "client/Cargo.toml"),
        ("dense/tests/", "dense/Cargo.toml"),
        ("frontend/tests/", "frontend/Cargo.toml"),
        ("map/tests/", "map/Cargo.toml"),
        ("solvers/tests/", "solvers/Cargo.toml"),
        ("store/tests/", "store/Cargo.toml"),
        ("tests/", "Cargo.toml"),
    ] {
        let listed = manifests()
            .iter()
            .any(|m| m.path == manifest && m.text.lines().any(|l| l == "autotests = false"));
        let alone = |path: &str| {
            let name = path.strip_prefix(folder).filter(|name| !name.contains('/'));
            name.is_some_and(|n| n.ends_with(".rs") && n != "main.rs" && n != "tidy.rs")
        };
        if !listed {
            offenders.extend(files().into_iter().map(|f| f.path).filter(|path| alone(path)));
        }
    }
    report("Integration tests are modules of one binary.", &offenders);
}

/// A file in the benches' folder that no crate lists would not be compiled, and one that two list
/// would be compiled twice, by one of them without what it needs.
#[test]
fn every_bench_is_listed_by_one_crate() {
    let named: Vec<String> = manifests()
        .iter()
        .flat_map(entries)
        .filter(|(_, section, _)| section == "bench")
        .filter_map(|(_, _, line)| Some(line.strip_prefix("name = ")?.trim_matches('"').to_owned()))
        .collect();
    let mut offenders = Vec::new();
    for path in files().into_iter().map(|f| f.path) {
        let Some(inner) = path.strip_prefix("benches/") else { continue };
        let bench = match inner.split_once('/') {
            None => inner.strip_suffix(".rs"),
            Some((folder, "main.rs")) => Some(folder),
            Some(_) => None,
        };
        if let Some(bench) = bench {
            let crates = named.iter().filter(|name| *name == bench).count();
            if crates != 1 {
                offenders.push(format!("{path}: {crates} `[[bench]]` name it"));
            }
        }
    }
    let discovers =
        |m: &File| m.path == "Cargo.toml" && !m.text.contains("\nautobenches = false\n");
    if manifests().iter().any(discovers) {
        offenders.push("Cargo.toml: `autobenches = false` is missing".to_owned());
    }
    report("Every bench is listed by one crate.", &offenders);
}

/// Where a profile differs, the fuzz targets' build compiles the dependencies once more; where a lint
/// does, the targets are held to other rules.
#[test]
fn the_fuzz_targets_have_the_profiles_and_lints_of_the_root() {
    /// What the targets do not build, and what is compiled for them apart, instrumented.
    const APART: [&str; 13] = [
        "async-nats",
        "covis",
        "covis-client",
        "covis-dense",
        "covis-frontend",
        "covis-fuzz",
        "covis-map",
        "covis-reports",
        "covis-solvers",
        "covis-store",
        "criterion",
        "prost-reflect",
        "redb",
    ];
    let shared = |path: &str| -> Vec<(String, String)> {
        manifests()
            .iter()
            .filter(|m| m.path == path)
            .flat_map(entries)
            .map(|(_, section, line)| (section, line))
            .filter(|(section, _)| {
                let package = section.strip_prefix("profile.dev.package.");
                let both = package.is_none_or(|name| !APART.contains(&name));
                both && (section.starts_with("profile.dev")
                    || section.starts_with("workspace.lints"))
            })
            .collect()
    };
    let (root, fuzz) = (shared("Cargo.toml"), shared("fuzz/Cargo.toml"));
    let lacks = |of: &[(String, String)], by: &[(String, String)], path: &str| -> Vec<String> {
        let missing = of.iter().filter(|entry| !by.contains(entry));
        missing.map(|(section, line)| format!("{path}: `[{section}]` lacks `{line}`")).collect()
    };
    let mut offenders = lacks(&root, &fuzz, "fuzz/Cargo.toml");
    offenders.extend(lacks(&fuzz, &root, "Cargo.toml"));
    report("The root's profiles and lints are those of the fuzz targets.", &offenders);
}

/// A crate that is not named there is fuzzed blindly: the fuzzer sees none of its branches.
#[test]
fn what_is_fuzzed_is_instrumented() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let instrument = std::fs::read_to_string(root.join("fuzz/instrument")).unwrap_or_default();
    let mut offenders = Vec::new();
    for manifest in manifests() {
        let Some(name) = manifest.path.strip_suffix("/Cargo.toml") else { continue };
        let has_targets = manifest.text.lines().any(|line| line.starts_with("fuzzing = "));
        if has_targets && !instrument.contains(&format!("--crate-name covis_{name} ")) {
            offenders.push(format!("{}: not in fuzz/instrument", manifest.path));
        }
    }
    report("Every crate with the feature `fuzzing` is instrumented.", &offenders);
}
