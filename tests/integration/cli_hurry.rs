//! What a user in a hurry meets: wrong files, no server, full disks. Each error says what happened, to
//! what, and what to do next.

#[cfg(unix)]
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use covis_solvers::testing::skip;

use crate::cli_support::{Ran, Running, Workspace, golden};
#[cfg(unix)]
use crate::common::{TestServer, occupy, run};
#[cfg(unix)]
use crate::job_support::Jobs;
#[cfg(unix)]
use crate::process::{Process, Signal};

const WINDOW: &str = "twins/window-6-80.txt";

#[test]
fn a_file_of_another_kind_is_told_with_the_command_that_takes_it() {
    let workspace = Workspace::new();
    workspace.file("graph.txt", "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n");
    workspace
        .run("solve bundle graph.txt", &[])
        .expect_failure(&["graph.txt, line 1", "`covis solve pose-graph` takes"]);
    workspace
        .run("solve pose-graph {}", &[&golden(WINDOW)])
        .expect_failure(&["line 1: unknown tag", "`covis solve bundle` takes"]);
    workspace.file("poses.kitti", "0.6 0 0.8 5 0 1 0 6 -0.8 0 0.6 7\n");
    workspace.run("solve bundle poses.kitti", &[]).expect_failure(&[
        "poses.kitti, line 1",
        "kitti",
        "`covis eval` takes",
    ]);
    workspace.file("text.txt", "hello\n");
    let ran = workspace.run("solve bundle text.txt", &[]);
    ran.expect_failure(&["text.txt, line 1: camera count cannot be `hello`"]);
    assert!(!ran.stderr.contains("looks like"), "{}", ran.stderr);
    workspace.run("mesh text.txt out.ply", &[]).expect_failure(&["text.txt", "covis fuse"]);
}

#[test]
fn a_compressed_file_is_told_with_what_unpacks_it() {
    let workspace = Workspace::new();
    for (head, kind, with) in
        [(&b"BZh91AY&SY"[..], "bzip2", "bunzip2"), (b"\x1f\x8b\x08\0", "gzip", "gunzip")]
    {
        let path = workspace.path("problem.txt.bz2");
        fs_err::write(&path, head).unwrap();
        let wanted = format!("problem.txt.bz2: is compressed ({kind}); `{with} ");
        workspace.run("solve bundle {}", &[&path]).expect_failure(&[&wanted]);
        workspace.run("solve pose-graph {}", &[&path]).expect_failure(&[&wanted]);
        workspace.run("eval ape {} {}", &[&path, &path]).expect_failure(&[&wanted]);
    }
}

#[test]
fn a_folder_that_is_not_there_is_told_before_the_solve() {
    let workspace = Workspace::new();
    for arguments in ["solve bundle {} --out none/out.txt", "solve bundle {} --out none/x --json"] {
        let ran = workspace.run(arguments, &[&golden(WINDOW)]);
        ran.expect_failure(&["cannot be written: there is no folder none"]);
        assert_eq!(ran.stdout, "", "nothing was solved");
    }
}

#[test]
fn a_full_disk_leaves_the_file_that_was_there_as_it_was() {
    // A limit of the size of files stands for the disk; both end a write early.
    let workspace = Workspace::new();
    let out = workspace.file("out.txt", "what was there\n");
    let program = workspace.command().get_program().to_owned();
    let script =
        "ulimit -f 1; trap '' XFSZ; exec \"$0\" solve bundle \"$1\" --out \"$2\" --force --json";
    let Ok(output) = Command::new("sh")
        .args(["-c", script])
        .arg(program)
        .args([&golden(WINDOW), &out])
        .stdin(Stdio::null())
        .output()
    else {
        skip("no sh");
        return;
    };
    let ran = Ran::of(output);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(ran.stderr.contains("out.txt: cannot be written"), "{}", ran.stderr);
    assert_eq!(fs_err::read_to_string(&out).unwrap(), "what was there\n");
    assert!(!workspace.path("out.txt.partial").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn output_without_room_is_an_error_with_the_next_step() {
    let full = || fs_err::OpenOptions::new().write(true).open("/dev/full").unwrap();
    if !fs_err::metadata("/dev/full").is_ok_and(|there| !there.is_file()) {
        skip("no /dev/full");
        return;
    }
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args(["solve", "bundle"]).arg(golden(WINDOW)).arg("--json").stdout(full().into_file());
    let ran = Ran::of(command.stderr(Stdio::piped()).output().unwrap());
    ran.expect_failure(&["standard output", "No space left", "make room"]);
}

#[test]
fn an_export_into_a_pipe_leaves_the_pipe_a_pipe() {
    let workspace = Workspace::new();
    let pipe = workspace.path("pipe");
    if !Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
        skip("no mkfifo");
        return;
    }
    let server = Running::start(&workspace, &workspace.path("data"));
    let on = format!("--server {}", server.url);
    workspace.file("walk.tum", "1 0 0 0 0 0 0 1\n");
    workspace.json(&format!("map import walk walk.tum --json {on}"), &[]);
    for write in ["map export walk --format tum --out {}", "convert walk.tum {} --to kitti"] {
        let reader = {
            let pipe = pipe.clone();
            std::thread::spawn(move || fs_err::read_to_string(pipe).unwrap())
        };
        let server = if write.starts_with("map") { &on } else { "" };
        let ran = workspace.run(&format!("{write} {server}"), &[&pipe]);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        assert!(reader.join().unwrap().contains('1'));
        assert!(!fs_err::metadata(&pipe).unwrap().is_file(), "the pipe was replaced by a file");
    }
}

#[test]
fn no_server_and_a_wrong_scheme_are_told_with_the_next_step() {
    let workspace = Workspace::new();
    // Nobody listens on a port that was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    for command in [
        "map list --server-wait 0",
        "job list --server-wait 0",
        "health",
        "load --maps 1 --seconds 0.1 --server-wait 0",
    ] {
        let ran = workspace.run(&format!("{command} --server http://127.0.0.1:{port}"), &[]);
        ran.expect_failure(&["no server answers", "`covis serve` starts one, --server URL"]);
    }
    let server = Running::start(&workspace, &workspace.path("data"));
    let https = server.url.replace("http:", "https:");
    workspace
        .run(&format!("map list --server {https}"), &[])
        .expect_failure(&["does not use TLS: its URL begins with http://"]);
    workspace
        .run(&format!("map show attic --server {}", server.url), &[])
        .expect_failure(&["\"attic\" does not exist", "`covis map list` lists"]);
    workspace
        .run(&format!("job show none --server {}", server.url), &[])
        .expect_failure(&["\"none\" does not exist", "`covis job list` lists"]);
    let listen = server.url.strip_prefix("http://").unwrap();
    workspace
        .run(&format!("serve --in-memory --listen {listen}"), &[])
        .expect_failure(&["cannot listen on", "--listen sets another"]);
    workspace
        .run("serve --listen 127.0.0.1:0 --data-dir {}", &[&workspace.path("data")])
        .expect_failure(&["in use by another server", "stop that server"]);
}

#[test]
fn a_server_tells_its_health_by_the_exit_code() {
    let workspace = Workspace::new();
    let mut server = Running::start(&workspace, &workspace.path("data"));
    let told = workspace.json(&format!("health --json --server {}", server.url), &[]);
    assert_eq!(told["serving"], true);
    server.kill();
    let gone = workspace.run(&format!("health --server {}", server.url), &[]);
    gone.expect_failure(&["no server answers"]);
}

#[test]
fn a_folder_without_maps_is_distinguished_from_a_damaged_one() {
    let workspace = Workspace::new();
    for command in ["doctor none", "backup none copy"] {
        workspace
            .run(command, &[])
            .expect_failure(&["none: is not a folder in which a server keeps maps", "covis serve"]);
    }
    assert!(!workspace.path("copy").exists());
}

#[cfg(unix)]
#[test]
fn waiting_for_a_job_can_be_interrupted_and_the_job_goes_on() {
    run(async {
        let server = TestServer::start().await;
        // The job waits for a thread until the interrupt has come.
        let busy = occupy(&server).await;
        let url = format!("http://{}", server.running.local_addr());
        let workspace = Workspace::new();
        let mut command = workspace.command();
        command.args(["job", "submit", "solve", "--id", "long", "--server", &url]);
        command.arg("--file").arg(golden(WINDOW));
        let submitted = tokio::task::spawn_blocking(move || command.output()).await.unwrap();
        assert_eq!(Ran::of(submitted.unwrap()).code, Some(0));

        let mut command = workspace.command();
        command.args(["job", "watch", "long", "--server", &url]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = Process::spawn(&mut command);
        let ran = tokio::task::spawn_blocking(move || {
            // Its first line says that it waits, and signals are caught before that.
            let mut line = String::new();
            BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
            child.signal(Signal::INT);
            (line, Ran::of(child.output()))
        });
        let (line, ran) = ran.await.unwrap();
        assert!(line.contains("long"), "{line}");
        ran.expect_failure(&["interrupt; job long continues", "covis job watch long"]);
        drop(busy);
        Jobs::of(&server).success("long").await;
    });
}

#[test]
fn the_version_tells_how_the_program_was_built() {
    let workspace = Workspace::new();
    let long = workspace.run("--version", &[]).stdout;
    for fact in ["commit: ", "target: ", "profile: ", "features: ", "compiler: rustc "] {
        assert!(long.contains(fact), "{long}");
    }
    assert!(long.contains("opentelemetry"), "what this build has: {long}");
    let short = workspace.run("-V", &[]).stdout;
    assert_eq!(short, format!("covis {}\n", env!("CARGO_PKG_VERSION")));
    let help = workspace.run("--help", &[]).stdout;
    assert!(help.contains("Exit codes: 0 success; 1 failure"), "{help}");
}

#[test]
fn a_terminal_gets_a_progress_bar_and_a_pipe_none() {
    let workspace = Workspace::new();
    let out = workspace.path("seq");
    let program = workspace.command().get_program().to_string_lossy().into_owned();
    let synth = format!(
        "'{program}' --log warn synth rgbd '{}' --scene static --frames 3 --no-noise",
        out.display()
    );
    // `script` runs a command on a terminal of its own.
    let on_terminal = Command::new("script")
        .args(["--quiet", "--return", "--command", &synth, "/dev/null"])
        // A dumb one would get no bar.
        .env("TERM", "xterm")
        .stdin(Stdio::null())
        .output();
    let Ok(on_terminal) = on_terminal else {
        skip("no script, which makes a terminal");
        return;
    };
    let shown = String::from_utf8_lossy(&on_terminal.stdout).into_owned();
    assert!(shown.contains("frames [") && shown.contains("3/3"), "{shown}");
    let piped = workspace
        .run("synth rgbd {} --force --scene static --frames 3 --no-noise", &[Path::new(&out)]);
    assert_eq!(piped.code, Some(0), "{}", piped.stderr);
    assert_eq!(piped.stderr, "");
}

#[test]
fn what_is_there_is_replaced_only_where_the_user_says_so() {
    let workspace = Workspace::new();
    let window = golden(WINDOW);
    workspace.file("out.txt", "what was there\n");
    fs_err::create_dir(workspace.path("room")).unwrap();
    workspace.file("room/mine.txt", "mine\n");
    for (arguments, taken) in [
        ("solve bundle {} --out out.txt", "out.txt: exists"),
        ("convert {} out.txt", "out.txt: exists"),
        ("synth rgbd room --scene static --frames 1", "room: is not empty"),
        ("run synthetic:static --frames 2 --out room", "room: is not empty"),
    ] {
        let files: &[&Path] = if arguments.contains("{}") { &[&window] } else { &[] };
        workspace.run(arguments, files).expect_failure(&[taken, "--force"]);
    }
    assert_eq!(fs_err::read_to_string(workspace.path("out.txt")).unwrap(), "what was there\n");
    workspace.json("solve bundle {} --out out.txt --force --json", &[&window]);
    assert!(fs_err::read_to_string(workspace.path("out.txt")).unwrap().starts_with("6 80 "));
}

#[test]
fn a_terminal_gets_no_colors_where_its_user_wants_none() {
    let workspace = Workspace::new();
    let program = workspace.command().get_program().to_string_lossy().into_owned();
    let missing = workspace.path("missing.g2o");
    // An unknown variable makes a line of the log.
    let line = format!("COVIS_THREDS=1 '{program}' solve '{}'", missing.display());
    let shown = |no_color: Option<&str>| {
        let mut script = Command::new("script");
        script.args(["--quiet", "--command", &line, "/dev/null"]).env("TERM", "xterm");
        script.env_remove("NO_COLOR").envs(no_color.map(|value| ("NO_COLOR", value)));
        let output = script.stdin(Stdio::null()).output().ok()?;
        Some(String::from_utf8_lossy(&output.stdout).into_owned())
    };
    // `script` runs a command on a terminal of its own.
    let (Some(colored), Some(plain), Some(empty)) =
        (shown(None), shown(Some("1")), shown(Some("")))
    else {
        skip("no script, which makes a terminal");
        return;
    };
    // The spinner behind it clears its own line, which is no color.
    let has_color = |shown: &str| {
        let line = shown.lines().find(|line| line.contains("COVIS_THREDS"));
        line.unwrap_or_else(|| panic!("{shown}")).contains("\u{1b}[")
    };
    assert!(has_color(&colored), "{colored}");
    assert!(!has_color(&plain), "{plain}");
    assert!(has_color(&empty), "an empty value says nothing: {empty}");
}
