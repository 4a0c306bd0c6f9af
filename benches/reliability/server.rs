//! A server in a process of its own, and what it takes: memory and disk.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::Context;

use crate::lock;

/// A server process; dropped, it is killed.
pub(crate) struct Server {
    pub(crate) process: Child,
    pub(crate) url: String,
}

impl Server {
    /// Starts a server over `data` and waits until it serves.
    pub(crate) fn start(data: &Path) -> anyhow::Result<Self> {
        let process = Command::new(env!("CARGO_BIN_EXE_covis"))
            .args(["serve", "--listen", "127.0.0.1:0", "--data-dir"])
            .arg(data)
            .stdout(Stdio::piped())
            .spawn()?;
        // From here on the process ends with the value, also where an error is returned.
        let mut server = Self { process, url: String::new() };
        let output = server.process.stdout.take().context("the server's output")?;
        let mut line = String::new();
        BufReader::new(output).read_line(&mut line)?;
        let url = line.trim().strip_prefix("listening on ").context("the server's address")?;
        url.clone_into(&mut server.url);
        Ok(server)
    }

    /// Resident memory in bytes.
    pub(crate) fn resident(&self) -> anyhow::Result<u64> {
        resident(self.process.id())
    }
}

/// Resident memory of a process in bytes.
fn resident(process: u32) -> anyhow::Result<u64> {
    let status = fs_err::read_to_string(format!("/proc/{process}/status"))?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).context("VmRSS")?;
    let kib = line.split_whitespace().nth(1).context("VmRSS")?;
    Ok(kib.parse::<u64>()? * 1024)
}

/// A server's resident memory, looked at twenty times a second for as long as it runs.
pub(crate) struct Samples(Arc<Mutex<Vec<f64>>>);

impl Samples {
    pub(crate) fn of(server: &Server) -> Self {
        let (samples, process) = (Arc::default(), server.process.id());
        let taken: Arc<Mutex<Vec<f64>>> = Arc::clone(&samples);
        std::thread::spawn(move || {
            while let Ok(bytes) = resident(process) {
                lock(&taken).push(bytes as f64 / 1e6);
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        Self(samples)
    }

    /// Mean and most since the last time, megabytes.
    pub(crate) fn take(&self) -> Option<(f64, f64)> {
        let samples = std::mem::take(&mut *lock(&self.0));
        let most = samples.iter().copied().reduce(f64::max)?;
        Some((samples.iter().sum::<f64>() / samples.len() as f64, most))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // What is still running has nothing to finish: the data are thrown away.
        let _ended = self.process.kill();
        let _ended = self.process.wait();
    }
}

/// Bytes of all files below a folder.
pub(crate) fn walk(folder: &Path) -> anyhow::Result<u64> {
    let mut bytes = 0;
    for entry in fs_err::read_dir(folder)? {
        let entry = entry?;
        // A file may go while we look.
        let Ok(found) = entry.metadata() else { continue };
        bytes += if found.is_dir() { walk(&entry.path())? } else { found.len() };
    }
    Ok(bytes)
}
