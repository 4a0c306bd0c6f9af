//! Real NATS servers on loopback ports, and servers of covis that share maps over them.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use covis_solvers::testing::skip;

use crate::cli_support::{Port, Running, Workspace};
use crate::process::Process;

/// The program of NATS, or why there is none.
fn program() -> Result<PathBuf, String> {
    let named = std::env::var_os("NATS_SERVER").map(PathBuf::from);
    let program = named.unwrap_or_else(|| PathBuf::from("nats-server"));
    let answer = Command::new(&program).arg("--version").output();
    let answer = answer.map_err(|error| format!("{}: {error}", program.display()))?;
    let text = String::from_utf8_lossy(&answer.stdout).into_owned();
    let version = text.trim().rsplit('v').next().unwrap_or_default();
    let mut numbers = version.split('.').map(|number| number.parse::<u32>().unwrap_or(0));
    match (numbers.next(), numbers.next()) >= (Some(2), Some(10)) {
        true => Ok(program),
        false => Err(format!("{} is {text:?}, 2.10 is needed", program.display())),
    }
}

/// One NATS server: where it listens, and the process while it runs.
pub(super) struct Node {
    config: PathBuf,
    pub(super) port: Port,
    monitoring: Port,
    /// Where the others reach it.
    _cluster: Port,
    process: Option<Process>,
}

impl Node {
    fn start(&mut self, program: &Path) {
        let mut command = Command::new(program);
        command.arg("-c").arg(&self.config).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut process = Process::spawn(&mut command);
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let mut said = Vec::new();
        while said.last().is_none_or(|line: &String| !line.contains("Server is ready")) {
            let Some(line) = lines.next() else { panic!("nats-server ended: {said:#?}") };
            said.push(line.unwrap());
        }
        // What it says from here on is read, so that it never waits for a reader.
        std::thread::spawn(move || lines.map_while(Result::ok).for_each(drop));
        self.process = Some(process);
    }

    fn kill(&mut self) {
        // Dropping it kills it.
        self.process = None;
    }
}

/// NATS servers that form a cluster.
pub(super) struct Nats {
    program: PathBuf,
    pub(super) nodes: Vec<Node>,
    /// Removed with the test.
    _folder: tempfile::TempDir,
}

impl Nats {
    /// So many servers, which sync before they acknowledge or not; `None` where there is no NATS.
    pub(super) fn start(count: usize, syncs: bool) -> Option<Self> {
        Self::start_on(None, count, syncs)
    }

    /// As [`Nats::start`], with what they keep below a folder.
    pub(super) fn start_on(disk: Option<&Path>, count: usize, syncs: bool) -> Option<Self> {
        let program = match program() {
            Ok(program) => program,
            Err(why) => {
                let required = std::env::var_os("COVIS_TEST_NATS_REQUIRED");
                let is_required = required.is_some_and(|value| value == "1");
                assert!(!is_required, "no NATS server ({why}), and COVIS_TEST_NATS_REQUIRED is 1");
                skip(&format!("no NATS server ({why})"));
                return None;
            }
        };
        let folder = tempfile::tempdir().unwrap();
        let cluster: Vec<_> = (0..count).map(|_| Port::reserve()).collect();
        let routes: Vec<String> =
            cluster.iter().map(|port| format!("nats://127.0.0.1:{}", port.number)).collect();
        let nodes = cluster.into_iter().enumerate().map(|(index, cluster)| {
            let (port, monitoring) = (Port::reserve(), Port::reserve());
            let store = disk.unwrap_or(folder.path()).join(format!("node-{index}"));
            let sync = if syncs { "sync_interval: always" } else { "" };
            let mut text = format!(
                "server_name: n{index}\nlisten: \"127.0.0.1:{}\"\nhttp: \"127.0.0.1:{}\"\n\
                 jetstream {{ store_dir: \"{}\", {sync} }}\n",
                port.number,
                monitoring.number,
                store.display(),
            );
            if count > 1 {
                // Clients are told of no other server, so that a test decides whom they reach.
                text += &format!(
                    "cluster {{ name: c, listen: \"127.0.0.1:{}\", no_advertise: true, routes: [{}] }}\n",
                    cluster.number,
                    routes.join(", "),
                );
            }
            let config = folder.path().join(format!("node-{index}.conf"));
            std::fs::write(&config, text).unwrap();
            Node { config, port, monitoring, _cluster: cluster, process: None }
        });
        let mut nats = Self { program, nodes: nodes.collect(), _folder: folder };
        nats.restart();
        Some(nats)
    }

    /// Starts every server that does not run.
    pub(super) fn restart(&mut self) {
        for node in self.nodes.iter_mut().filter(|node| node.process.is_none()) {
            node.start(&self.program);
        }
    }

    /// SIGKILL to all of them.
    pub(super) fn kill(&mut self) {
        self.nodes.iter_mut().for_each(Node::kill);
    }

    /// All URLs, as `--nats` takes them.
    pub(super) fn urls(&self) -> String {
        let urls: Vec<_> = self
            .nodes
            .iter()
            .map(|node| format!("nats://127.0.0.1:{}", node.port.number))
            .collect();
        urls.join(",")
    }

    /// All monitoring addresses, as `--nats-monitoring` takes them.
    pub(super) fn monitoring(&self) -> String {
        let urls: Vec<_> = self
            .nodes
            .iter()
            .map(|node| format!("http://127.0.0.1:{}", node.monitoring.number))
            .collect();
        urls.join(",")
    }

    /// A server of covis with a folder of its own.
    pub(super) fn covis(&self, workspace: &Workspace, name: &str) -> Running {
        self.covis_over(&self.urls(), workspace, name, &[])
    }

    /// As [`Nats::covis`], on the port of a server that has ended.
    pub(super) fn covis_at(&self, port: &Port, workspace: &Workspace, name: &str) -> Running {
        self.start_covis(port.clone(), &self.urls(), workspace, name, &[])
    }

    /// As [`Nats::covis`], by other URLs of NATS and with more arguments.
    pub(super) fn covis_over(
        &self,
        urls: &str,
        workspace: &Workspace,
        name: &str,
        arguments: &[&str],
    ) -> Running {
        self.start_covis(Port::reserve(), urls, workspace, name, arguments)
    }

    pub(super) fn start_covis(
        &self,
        port: Port,
        urls: &str,
        workspace: &Workspace,
        name: &str,
        arguments: &[&str],
    ) -> Running {
        let replicas = if self.nodes.len() < 3 { "1" } else { "3" };
        let monitoring = self.monitoring();
        let mut all = vec!["--nats", urls, "--nats-monitoring", &monitoring];
        all.extend(["--nats-replicas", replicas]);
        if !arguments.contains(&"--lease-seconds") {
            all.extend(["--lease-seconds", "2"]);
        }
        all.extend(arguments);
        Running::spawn(workspace.command(), port, &workspace.path(name), &all)
    }
}
