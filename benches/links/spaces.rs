//! Two network namespaces that a relay joins, made for one run and removed with it.
//!
//! The relay is relay.c, built by the system's C compiler. Making devices and namespaces takes root,
//! /dev/net/tun and `ip` (iproute2); without one of them there are no spaces, and the error says which.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context;

use crate::Profile;

/// Addresses of the server's and the robot's end.
const ENDS: [&str; 2] = ["10.213.77.1", "10.213.77.2"];

/// What went through one direction of the relay.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Passed {
    pub(crate) packets: u64,
    pub(crate) bytes: u64,
    pub(crate) lost: u64,
    pub(crate) overflown: u64,
}

/// The namespaces and the relay; dropped, they are gone.
pub(crate) struct Spaces {
    names: [String; 2],
    relay: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Spaces {
    /// Makes them; `folder` takes the relay's program.
    pub(crate) fn make(folder: &Path, profile: &Profile, seed: u64) -> anyhow::Result<Self> {
        let program = folder.join("relay");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/links/relay.c");
        let mut compiler = Command::new("cc");
        run(compiler.args(["-O2", "-o"]).arg(&program).arg(source)).context("the relay")?;
        let id = std::process::id();
        let names = ["s", "r"].map(|end| format!("covis-{end}-{id}"));
        let devices = ["s", "r"].map(|end| format!("cvs{end}{id}"));
        let numbers = [
            profile.delay_ms,
            profile.jitter_ms,
            profile.loss,
            profile.mbit,
            profile.gap_s,
            profile.period_s,
        ];
        let mut relay = Command::new(program)
            .args(&devices)
            .args(numbers.map(|number| number.to_string()))
            .arg(seed.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let input = relay.stdin.take();
        let output = BufReader::new(relay.stdout.take().context("the relay's output")?);
        let mut made = Self { names, relay, input, output };
        let mut line = String::new();
        made.output.read_line(&mut line)?;
        anyhow::ensure!(line == "ready\n", "the relay makes no devices");
        for (end, device) in devices.iter().enumerate() {
            let name = &made.names[end];
            let address = format!("{}/30", ENDS[end]);
            ip(&["netns", "add", name])?;
            ip(&["link", "set", device, "netns", name])?;
            ip(&["-n", name, "addr", "add", &address, "dev", device])?;
            ip(&["-n", name, "link", "set", "lo", "up"])?;
            ip(&["-n", name, "link", "set", device, "up"])?;
        }
        Ok(made)
    }

    /// Where the server listens.
    pub(crate) fn listen() -> String {
        format!("{}:0", ENDS[0])
    }

    /// A command in the server's namespace (0) or the robot's (1).
    pub(crate) fn command(&self, end: usize, program: &Path) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.names[end]]).arg(program);
        command
    }

    /// Ends the relay. What went from the server to the robot, and from the robot to the server.
    pub(crate) fn end(mut self) -> anyhow::Result<[Passed; 2]> {
        self.input = None;
        let mut said = String::new();
        self.output.read_to_string(&mut said)?;
        let passed = |line: Option<&str>| -> anyhow::Result<Passed> {
            let numbers: Vec<u64> = line
                .context("the relay's counts")?
                .split(' ')
                .map(str::parse)
                .collect::<Result<_, _>>()?;
            let [packets, bytes, lost, overflown] = numbers[..] else { anyhow::bail!("{said}") };
            Ok(Passed { packets, bytes, lost, overflown })
        };
        let mut lines = said.lines();
        Ok([passed(lines.next())?, passed(lines.next())?])
    }
}

impl Drop for Spaces {
    fn drop(&mut self) {
        self.input = None;
        let _ended = self.relay.kill();
        let _ended = self.relay.wait();
        for name in &self.names {
            let _missing = Command::new("ip").args(["netns", "del", name]).output();
        }
    }
}

fn ip(words: &[&str]) -> anyhow::Result<()> {
    run(Command::new("ip").args(words)).with_context(|| format!("ip {}", words.join(" ")))
}

fn run(command: &mut Command) -> anyhow::Result<()> {
    let output = command.output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "{}", said.trim());
    Ok(())
}
