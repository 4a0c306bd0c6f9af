//! A server with tokens in a process of its own, with as many descriptors as the system gives, and what
//! it takes.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::Context;
use covis::client::{Client, ClientError, Credentials, Token};
use sha2::{Digest, Sha256};

/// Who may come in: the token is `secret-of-NAME`.
const CALLERS: [(&str, &str, &str); 3] =
    [("robot", "acme", "admin"), ("reader", "acme", "read"), ("foe", "foes", "admin")];

/// A server process; dropped, it is killed.
pub(crate) struct Server {
    process: Child,
    log: PathBuf,
    pub(crate) url: String,
}

impl Server {
    /// Starts a server over a folder, configured by a file if there is one, and waits until it serves.
    pub(crate) fn start(folder: &Path, config: Option<&Path>) -> anyhow::Result<Self> {
        let mut tokens = String::new();
        for (name, tenant, role) in CALLERS {
            let digest = Sha256::digest(secret(name));
            let sha256: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
            write!(tokens, "[[token]]\nname = '{name}'\nsha256 = '{sha256}'\n")?;
            write!(tokens, "tenant = '{tenant}'\nrole = '{role}'\n")?;
        }
        let (file, log) = (folder.join("tokens.toml"), folder.join("log"));
        fs_err::write(&file, tokens)?;
        let mut command = Command::new("sh");
        command
            .args(["-c", "ulimit -n $(ulimit -Hn); exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_covis"))
            .args(["--log", "off", "serve", "--listen", "127.0.0.1:0", "--data-dir"])
            .arg(folder.join("maps"))
            .arg("--tokens")
            .arg(file)
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(&log)?);
        if let Some(file) = config {
            command.arg("--config").arg(file);
        }
        let process = command.spawn()?;
        // From here on the process ends with the value, also where an error is returned.
        let mut server = Self { process, log, url: String::new() };
        let output = server.process.stdout.take().context("the server's output")?;
        let mut line = String::new();
        BufReader::new(output).read_line(&mut line)?;
        let url = line.trim().strip_prefix("listening on ").context("the server's address")?;
        url.clone_into(&mut server.url);
        Ok(server)
    }

    /// A new connection of one of the callers.
    pub(crate) async fn client(&self, name: &str) -> Result<Client, ClientError> {
        connect(&self.url, name).await
    }

    /// Resident memory now and at its highest, megabytes; `None` once the process is gone.
    pub(crate) fn memory(&self) -> Option<(u64, u64)> {
        let path = format!("/proc/{}/status", self.process.id());
        let status = fs_err::read_to_string(path).ok()?;
        let of = |key: &str| {
            let line = status.lines().find(|line| line.starts_with(key))?;
            line.split_whitespace().nth(1)?.parse::<u64>().ok()
        };
        Some((of("VmRSS:")? / 1000, of("VmHWM:")? / 1000))
    }

    /// Lines of its log, which is the audit's alone.
    pub(crate) fn log_lines(&self) -> usize {
        fs_err::read(&self.log).map_or(0, |log| log.iter().filter(|&&byte| byte == b'\n').count())
    }

    /// How the process ended, if it has.
    pub(crate) fn ended(&mut self) -> Option<String> {
        self.process.try_wait().ok().flatten().map(|status| status.to_string())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // What is still running has nothing to finish: the data are thrown away.
        let _ended = self.process.kill();
        let _ended = self.process.wait();
    }
}

pub(crate) fn secret(name: &str) -> String {
    format!("secret-of-{name}")
}

pub(crate) async fn connect(url: &str, name: &str) -> Result<Client, ClientError> {
    let token = Some(Token::new(&secret(name)));
    Client::connect_with(url, &Credentials { token, ..Credentials::default() }).await
}
