//! Processes that tests start. A test that ends, also by a panic, kills each of its processes and waits
//! for it. Signals are sent by the system call, so that no program has to be installed for them.

use std::io::Read;
use std::ops::{Deref, DerefMut};
use std::process::{Child, Command, Output};

#[cfg(unix)]
pub(crate) use rustix::process::Signal;

/// A process that is killed and reaped when it is dropped.
pub(crate) struct Process(Child);

impl Process {
    /// Starts a command.
    pub(crate) fn spawn(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    /// Sends a signal.
    #[cfg(unix)]
    pub(crate) fn signal(&self, signal: Signal) {
        send(self.0.id(), signal);
    }

    /// Kills the process and waits for it: no handler of its runs.
    pub(crate) fn end(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    /// Waits until the process has ended, and returns what it wrote to the pipes that nobody took.
    pub(crate) fn output(mut self) -> Output {
        drop(self.0.stdin.take());
        let (mut stdout, stderr) = (Vec::new(), self.0.stderr.take());
        // Both pipes are read at once, so that the process never waits for room in one of them.
        let stderr = std::thread::spawn(move || {
            let mut text = Vec::new();
            stderr.map(|mut pipe| pipe.read_to_end(&mut text).unwrap());
            text
        });
        self.0.stdout.take().map(|mut pipe| pipe.read_to_end(&mut stdout).unwrap());
        Output { status: self.0.wait().unwrap(), stdout, stderr: stderr.join().unwrap() }
    }
}

impl Deref for Process {
    type Target = Child;

    fn deref(&self) -> &Child {
        &self.0
    }
}

impl DerefMut for Process {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // A process that has ended already is only reaped.
        let _ended = self.0.kill();
        let _status = self.0.wait();
    }
}

/// Sends a signal to a process by its id.
#[cfg(unix)]
pub(crate) fn send(process: u32, signal: Signal) {
    let id = rustix::process::Pid::from_raw(process.try_into().unwrap()).unwrap();
    rustix::process::kill_process(id, signal).unwrap();
}

#[cfg(unix)]
#[test]
fn a_test_that_panics_leaves_no_process() {
    let id = std::sync::OnceLock::new();
    let panicked = std::panic::catch_unwind(|| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_covis"));
        command.args(["serve", "--in-memory", "--listen", "127.0.0.1:0"]);
        let mut process = Process::spawn(command.stdout(std::process::Stdio::piped()));
        let mut said = [0];
        process.stdout.as_mut().unwrap().read_exact(&mut said).unwrap();
        id.set(process.id()).unwrap();
        std::panic::resume_unwind(Box::new("staged by a test"));
    });
    assert!(panicked.is_err());
    let id = rustix::process::Pid::from_raw(i32::try_from(*id.get().unwrap()).unwrap()).unwrap();
    // The process is reaped: its id is nobody's.
    let gone = rustix::process::test_kill_process(id);
    assert_eq!(gone, Err(rustix::io::Errno::SRCH));
}
