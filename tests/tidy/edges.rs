//! Who may use whom: the floors of `covis-solvers` and the rooms of `covis`.

use crate::report;
use crate::source::rust_files;

/// The modules of `solvers/src`, lowest floor first. A file uses its own module and lower floors.
const FLOORS: [&[&str]; 15] = [
    &["simd", "lists", "interrupt", "order", "parallel"],
    &["price", "geometry"],
    &["information", "loss"],
    &["factors", "lanes"],
    &["problem"],
    &["linear"],
    &["optimizer"],
    &["initialization"],
    &["bundle_adjustment", "pose_graph", "pose_refinement", "relative_motion"],
    &["robust", "certificate", "marginalization"],
    &["evaluation", "point_matching"],
    &["graph_optimization", "geometric_verification"],
    &["reconstruction", "similarity"],
    &["io"],
    &["testing"],
];

/// Modules that may not even use some of the floors below them.
const APART: [(&str, &[&str], &str); 3] = [
    (
        "linear",
        &["geometry", "information", "loss", "factors", "problem"],
        "linear systems know nothing of poses and factors",
    ),
    (
        "marginalization",
        &[
            "linear",
            "optimizer",
            "initialization",
            "bundle_adjustment",
            "pose_graph",
            "pose_refinement",
        ],
        "marginalization runs no solver",
    ),
    (
        "evaluation",
        &[
            "lanes",
            "linear",
            "optimizer",
            "initialization",
            "bundle_adjustment",
            "pose_graph",
            "pose_refinement",
            "robust",
            "certificate",
            "marginalization",
        ],
        "the evaluator shares nothing with the fast paths",
    ),
];

/// A part of the sources and what it may not name. A trailing `*` matches the rest of a word.
struct Room {
    rooms: &'static [&'static str],
    except: &'static [&'static str],
    forbidden: &'static [&'static str],
    but: &'static [&'static str],
    why: &'static str,
}

const ROOMS: [Room; 25] = [
    Room {
        rooms: &["store/src/meter"],
        except: &[],
        forbidden: &["tokio*", "tonic*", "prost*", "hyper*", "opentelemetry*", "crate"],
        but: &["crate::meter"],
        why: "instruments are plain atomics that every room can hold",
    },
    Room {
        rooms: &["src"],
        except: &["src/lib"],
        forbidden: &[
            "covis_client",
            "covis_dense",
            "covis_frontend",
            "covis_map",
            "covis_reports",
            "covis_store",
        ],
        but: &[],
        why: "here their names are crate::client, crate::wire, crate::frontend, crate::map and crate::store, which the walls know",
    },
    Room {
        rooms: &["src/service"],
        except: &[],
        forbidden: &["crate::frontend"],
        but: &[],
        why: "a server does not know the frontend",
    },
    Room {
        rooms: &["src", "client", "dense", "frontend", "map", "store"],
        except: &["src/service/telemetry", "src/cli/spans"],
        forbidden: &["hyper*", "opentelemetry*", "tracing_opentelemetry"],
        // Bodies of requests are the transport's.
        but: &["hyper::body"],
        why: "monitoring systems are known in two places",
    },
    Room {
        rooms: &["map"],
        except: &["map/src/place", "map/src/loop_closing"],
        forbidden: &["crate::place", "crate::loop_closing"],
        but: &[],
        why: "the map is below place recognition and loop closing",
    },
    Room {
        rooms: &["map"],
        except: &[],
        forbidden: &[
            "tokio*",
            "tonic*",
            "prost*",
            "covis",
            "covis_client",
            "covis_dense",
            "covis_frontend",
            "std::time",
            "std::fs",
            "fs_err",
        ],
        but: &[],
        why: "the map is a function of its events: no async, no wire, no clock, no files",
    },
    Room {
        rooms: &["map/src/place"],
        except: &[],
        forbidden: &["crate"],
        but: &["crate::place", "crate::EntityId", "crate::ClientIndex"],
        why: "place recognition knows descriptors and ids, no poses",
    },
    Room {
        rooms: &["store"],
        except: &[],
        forbidden: &["tonic*", "covis", "covis_frontend", "covis_client"],
        but: &["covis_client::decoding"],
        why: "the store knows events and nothing of the edge",
    },
    Room {
        rooms: &["store"],
        except: &["store/src/encoding"],
        forbidden: &["prost*"],
        but: &[],
        why: "how events and maps are encoded is known in one place",
    },
    Room {
        rooms: &["src", "client", "dense", "frontend", "map", "store"],
        except: &["store/src/replicated"],
        forbidden: &["async_nats*"],
        but: &[],
        why: "how servers share maps is known in one place",
    },
    Room {
        rooms: &["src/service/engine"],
        except: &[],
        forbidden: &[
            "tonic*",
            "prost*",
            "crate::wire",
            "crate::client",
            "crate::cli",
            "crate::service",
        ],
        but: &["crate::service::engine"],
        why: "the engine knows neither the wire nor the edge",
    },
    Room {
        rooms: &["src/service"],
        except: &[],
        forbidden: &["crate::client", "crate::cli"],
        but: &[],
        why: "a server does not know its clients",
    },
    Room {
        rooms: &["src/service"],
        except: &["src/service/jobs"],
        forbidden: &["crate::evaluation"],
        but: &[],
        why: "trajectories are compared by jobs alone",
    },
    Room {
        rooms: &["src/service"],
        except: &[
            "src/service/jobs",
            "src/service/job_service",
            "src/service/routes",
            "src/service/server",
            "src/service/telemetry/http",
            "src/service/telemetry/page",
        ],
        forbidden: &["crate::service::jobs"],
        but: &[],
        why: "jobs know the context and the calls, which know no jobs",
    },
    Room {
        rooms: &["frontend"],
        except: &["frontend/src/mapping"],
        forbidden: &["tokio*", "tonic*", "prost*", "covis_client"],
        but: &[],
        why: "vision is synchronous and knows no server",
    },
    Room {
        rooms: &["dense"],
        except: &[],
        forbidden: &[
            "tokio*",
            "tonic*",
            "prost*",
            "covis",
            "covis_client",
            "covis_frontend",
            "covis_map",
        ],
        but: &[],
        why: "dense mapping is synchronous and knows neither server nor tracking",
    },
    Room {
        rooms: &["reports/src/evaluation"],
        except: &[],
        forbidden: &["tokio*", "tonic*", "prost*", "crate"],
        but: &["crate::evaluation"],
        why: "trajectory errors are plain functions of trajectories",
    },
    Room {
        rooms: &["reports/src/html"],
        except: &[],
        forbidden: &[
            "tokio*",
            "tonic*",
            "prost*",
            "crate",
            "covis_solvers",
            "std::time",
            "std::fs",
            "fs_err",
        ],
        but: &["crate::html"],
        why: "a page is a function of numbers and text: no clock, no files",
    },
    Room {
        rooms: &["src", "client", "dense", "frontend", "map", "reports", "solvers", "store"],
        except: &["src/cli/record/sink"],
        forbidden: &["mcap"],
        but: &[],
        why: "the format of recordings is known in one place",
    },
    Room {
        rooms: &["src", "client", "dense", "frontend", "map", "reports", "solvers", "store"],
        except: &["frontend/src/input/recording/storage/database"],
        forbidden: &["rusqlite*"],
        but: &[],
        why: "that some bags are databases is known in one place",
    },
    Room {
        rooms: &["src"],
        except: &["src/service", "src/cli"],
        forbidden: &["crate::wire"],
        but: &[],
        why: "wire types stay at the edge",
    },
    Room {
        rooms: &["map", "src/service/engine"],
        except: &["map/src/problem"],
        forbidden: &["covis_solvers::problem::BundleProblem", "covis_solvers::problem::PoseGraph"],
        but: &[],
        why: "map/src/problem is the only place that turns a map into a solver problem",
    },
    Room {
        rooms: &["src", "client", "dense", "frontend", "map", "reports", "solvers", "store"],
        except: &["src/cli", "src/main"],
        forbidden: &["anyhow"],
        but: &[],
        why: "libraries have typed errors",
    },
    Room {
        rooms: &["solvers"],
        except: &[],
        forbidden: &[
            "tokio*",
            "tonic*",
            "prost*",
            "covis",
            "covis_client",
            "covis_dense",
            "covis_frontend",
            "covis_map",
        ],
        but: &[],
        why: "the solver crate is synchronous and stands alone",
    },
    Room {
        rooms: &[
            "src",
            "client/src",
            "dense/src",
            "frontend/src",
            "map/src",
            "solvers/src",
            "store/src",
        ],
        except: &["src/cli", "src/main"],
        forbidden: &["println", "eprintln", "print", "eprint", "dbg", "std::process::exit"],
        but: &[],
        why: "only the command line speaks to the terminal",
    },
];

/// How a `tonic::Status` is made; `Status::from` turns a domain error into one through `status.rs`.
const STATUS_MAKERS: [&str; 23] = [
    "new",
    "ok",
    "cancelled",
    "unknown",
    "invalid_argument",
    "deadline_exceeded",
    "not_found",
    "already_exists",
    "permission_denied",
    "resource_exhausted",
    "failed_precondition",
    "aborted",
    "out_of_range",
    "unimplemented",
    "internal",
    "unavailable",
    "data_loss",
    "unauthenticated",
    "with_details",
    "with_metadata",
    "with_details_and_metadata",
    "with_error_details",
    "with_error_details_vec",
];

fn floor_of(module: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&module))
}

#[test]
fn solver_modules_use_only_lower_floors() {
    let mut offenders = Vec::new();
    for file in rust_files() {
        let Some(inside) = file.path.strip_prefix("solvers/src/") else { continue };
        let module = inside.split('/').next().unwrap_or(inside).trim_end_matches(".rs");
        if module == "lib" || file.is_test() {
            continue;
        }
        let Some(floor) = floor_of(module) else {
            offenders.push(format!("{}: module `{module}` stands on no floor", file.path));
            continue;
        };
        for reference in file.references() {
            let [root, used, ..] = &reference.to[..] else { continue };
            if root != "crate" || used == module {
                continue;
            }
            let location = format!("{}:{}", file.path, reference.line);
            match floor_of(used) {
                None => offenders.push(format!("{location}: `crate::{used}` stands on no floor")),
                Some(other) if other >= floor => offenders.push(format!(
                    "{location}: {module} uses {used}, which does not stand below it"
                )),
                Some(_) => {}
            }
            for (apart, forbidden, why) in APART {
                if apart == module && forbidden.contains(&used.as_str()) {
                    offenders.push(format!("{location}: {module} uses {used}: {why}"));
                }
            }
        }
    }
    report("A solver module uses only lower floors.", &offenders);
}

#[test]
fn solver_crate_tells_its_floors() {
    let files = rust_files();
    let Some(lib) = files.iter().find(|f| f.path == "solvers/src/lib.rs") else {
        panic!("solvers/src/lib.rs is missing");
    };
    let mut offenders = Vec::new();
    let mut last = 0;
    // Not linked from the table: behind a feature, and private.
    let mut told = vec!["testing", "simd", "lists", "lanes", "order", "parallel"];
    for row in lib.text.lines().filter(|line| line.starts_with("//! |") && line.contains("[`")) {
        for name in row.split("[`").skip(1).filter_map(|rest| rest.split('`').next()) {
            told.push(name);
            match floor_of(name) {
                None => offenders.push(format!("the table has `{name}`, the rule does not")),
                Some(floor) if floor < last => {
                    offenders.push(format!("the table has `{name}` above floors that use it"));
                }
                Some(floor) => last = floor,
            }
        }
    }
    for name in FLOORS.iter().flat_map(|floor| floor.iter()) {
        if !told.contains(name) {
            offenders.push(format!("the table lacks `{name}`"));
        }
        if !lib.text.contains(&format!("mod {name};")) {
            offenders.push(format!("there is no `mod {name}`"));
        }
    }
    report("The table in solvers/src/lib.rs and the floors agree.", &offenders);
}

#[test]
fn rooms_keep_to_themselves() {
    let mut offenders = Vec::new();
    for file in rust_files().iter().filter(|f| !f.is_test()) {
        let references = file.references();
        for room in &ROOMS {
            if !room.rooms.iter().any(|r| file.is_in(r))
                || room.except.iter().any(|r| file.is_in(r))
            {
                continue;
            }
            for reference in &references {
                let named = |pattern: &&&str| names(&reference.to, pattern);
                if let Some(pattern) = room.forbidden.iter().find(named)
                    && !room.but.iter().any(|b| names(&reference.to, b))
                {
                    offenders.push(format!(
                        "{}:{}: `{}` ({pattern}): {}",
                        file.path,
                        reference.line,
                        reference.to.join("::"),
                        room.why
                    ));
                }
            }
        }
    }
    report("Each room uses only what it may.", &offenders);
}

#[test]
fn a_status_is_made_in_one_place() {
    let mut offenders = Vec::new();
    for file in rust_files().iter().filter(|f| f.is_in("src/service") && !f.is_test()) {
        if file.path == "src/service/status.rs" {
            continue;
        }
        for reference in file.references() {
            let [.., kind, maker] = &reference.to[..] else { continue };
            if kind == "Status" && STATUS_MAKERS.contains(&maker.as_str()) {
                offenders.push(format!("{}:{}: `Status::{maker}`", file.path, reference.line));
            }
        }
    }
    report("Only src/service/status.rs makes a tonic::Status.", &offenders);
}

#[test]
fn errors_carry_data() {
    let mut offenders = Vec::new();
    for file in rust_files().iter().filter(|f| !f.is_test()) {
        for (number, line) in file.text.lines().enumerate() {
            let line = line.trim_start();
            let is_bare = |name: &str| {
                let text = line.strip_prefix(name);
                text.is_some_and(|t| {
                    ["(String)", "(&'static str)"].iter().any(|b| t.starts_with(b))
                })
            };
            if is_bare("Other") || is_bare("Unknown") {
                offenders.push(format!("{}:{}: {line}", file.path, number + 1));
            }
        }
    }
    report("No error variant is a bare sentence.", &offenders);
}

/// Whether `path` begins with `pattern`.
fn names(path: &[String], pattern: &str) -> bool {
    let mut segments = path.iter();
    pattern.split("::").all(|wanted| {
        segments.next().is_some_and(|segment| match wanted.strip_suffix('*') {
            Some(stem) => segment == stem || segment.starts_with(&format!("{stem}_")),
            None => segment == wanted,
        })
    })
}
