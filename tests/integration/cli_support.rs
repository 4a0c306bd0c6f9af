//! Runs the real binary and finds the data that tests read.
//!
//! Every run starts in an empty folder and with no `COVIS_*` variable but those it is given, so that
//! neither a developer's `covis.toml` nor the environment leaks into a test.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use serde_json::Value;
use tempfile::TempDir;
use tokio::net::TcpSocket;

use crate::process::Process;

/// A folder of its own for one test, gone at the end.
pub(crate) struct Workspace {
    folder: TempDir,
}

/// What a run left.
pub(crate) struct Ran {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Workspace {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// A path in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file in the folder.
    pub(crate) fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs_err::write(&path, text).unwrap();
        path
    }

    /// The binary, ready to run in the folder.
    pub(crate) fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_covis"));
        command.current_dir(self.folder.path());
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("COVIS_") {
                command.env_remove(name);
            }
        }
        command
    }

    /// Runs the binary with arguments that are separated by spaces; `{}` stands for the next path.
    pub(crate) fn run(&self, arguments: &str, paths: &[&Path]) -> Ran {
        let mut paths = paths.iter();
        let mut command = self.command();
        for word in arguments.split_whitespace() {
            if word == "{}" {
                command.arg(paths.next().unwrap());
            } else {
                command.arg(word);
            }
        }
        assert!(paths.next().is_none(), "{arguments}: a path too many");
        Ran::of(command.output().unwrap())
    }

    /// Draws `frames` exact frames of a room at rest into the folder `seq`.
    pub(crate) fn room(&self, frames: usize) -> PathBuf {
        let out = self.path("seq");
        let arguments =
            format!("--log warn synth rgbd {{}} --scene static --frames {frames} --no-noise");
        let ran = self.run(&arguments, &[&out]);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        out
    }

    /// Runs, expects success and parses the JSON object on standard output.
    pub(crate) fn json(&self, arguments: &str, paths: &[&Path]) -> Value {
        let ran = self.run(arguments, paths);
        assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
        serde_json::from_str(&ran.stdout).unwrap()
    }
}

impl Ran {
    pub(crate) fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self {
            code: output.status.code(),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Expects exit code 1 and one line that begins with `error: ` and holds all `parts`.
    pub(crate) fn expect_failure(&self, parts: &[&str]) {
        assert_eq!(self.code, Some(1), "{}", self.stderr);
        assert_eq!(self.stderr.lines().count(), 1, "{}", self.stderr);
        assert!(self.stderr.starts_with("error: "), "{}", self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` in `{}`", self.stderr);
        }
    }
}

/// A port of 127.0.0.1 for a server that a test starts, and may start again.
///
/// On Linux a bound socket that does not listen keeps its port: a process that asks for any free port
/// gets another one, and a server that asks for this number gets it.
#[derive(Clone)]
pub(crate) struct Port {
    pub(crate) number: u16,
    _bound: Option<Arc<TcpSocket>>,
}

impl Port {
    pub(crate) fn reserve() -> Self {
        let socket = TcpSocket::new_v4().unwrap();
        socket.set_reuseaddr(true).unwrap();
        socket.bind(([127, 0, 0, 1], 0).into()).unwrap();
        let number = socket.local_addr().unwrap().port();
        // Elsewhere a bound port is refused to everybody.
        Self { number, _bound: cfg!(target_os = "linux").then(|| Arc::new(socket)) }
    }
}

/// A server of its own process, with its maps in a folder.
pub(crate) struct Running {
    pub(crate) child: Process,
    pub(crate) url: String,
    pub(crate) port: Port,
    log: tempfile::NamedTempFile,
}

impl Running {
    /// A server on a free port.
    pub(crate) fn start(workspace: &Workspace, folder: &Path) -> Self {
        Self::with(workspace, folder, &[])
    }

    /// A server on a free port, with more arguments.
    pub(crate) fn with(workspace: &Workspace, folder: &Path, arguments: &[&str]) -> Self {
        Self::spawn(workspace.command(), Port::reserve(), folder, arguments)
    }

    /// A server on the port of one that has ended.
    pub(crate) fn again(&self, workspace: &Workspace, folder: &Path) -> Self {
        Self::spawn(workspace.command(), self.port.clone(), folder, &[])
    }

    /// A server by a command that has nothing but its environment yet.
    pub(crate) fn spawn(
        mut command: Command,
        port: Port,
        folder: &Path,
        arguments: &[&str],
    ) -> Self {
        let address = format!("127.0.0.1:{}", port.number);
        command.args(["serve", "--listen", &address, "--threads", "1", "--data-dir"]);
        command.arg(folder).args(arguments);
        let log = tempfile::NamedTempFile::new().unwrap();
        command.stdout(Stdio::piped()).stderr(log.reopen().unwrap());
        let mut child = Process::spawn(&mut command);
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let Some(line) = lines.next() else {
            let why = fs_err::read_to_string(log.path()).unwrap();
            panic!("the server ended, {}: {why}", child.wait().unwrap());
        };
        let url = line.unwrap().strip_prefix("listening on ").unwrap().to_owned();
        let kept = lines.next().unwrap().unwrap();
        assert_eq!(kept, format!("maps are kept in {}", folder.display()));
        Self { child, url, port, log }
    }

    /// What it has logged so far.
    pub(crate) fn log(&self) -> String {
        fs_err::read_to_string(self.log.path()).unwrap()
    }

    /// SIGTERM: drained, and the exit code.
    #[cfg(unix)]
    pub(crate) fn terminate(&mut self) -> Option<i32> {
        self.child.signal(crate::process::Signal::TERM);
        self.child.wait().unwrap().code()
    }

    /// SIGKILL: no handler runs.
    pub(crate) fn kill(&mut self) {
        self.child.end();
    }
}

/// A file under `tests/golden`.
pub(crate) fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

/// A golden record.
pub(crate) fn golden_json(name: &str) -> Value {
    serde_json::from_slice(&fs_err::read(golden(name)).unwrap()).unwrap()
}

pub(crate) use covis_solvers::testing::data;

/// A number of a JSON object by its key.
pub(crate) fn number(object: &Value, key: &str) -> f64 {
    object[key].as_f64().unwrap_or_else(|| panic!("no number `{key}` in {object}"))
}

/// Whether `a` and `b` differ by at most `relative` of `b`.
pub(crate) fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}
