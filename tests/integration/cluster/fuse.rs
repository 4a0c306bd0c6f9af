//! The protocol of FUSE: what a filesystem in this process needs of it to serve databases.
//!
//! The crates that speak it turn a feature of `libc` on, and with it all dependencies would be built twice.
//! Layouts are those of the kernel's `include/uapi/linux/fuse.h`. Mounting takes root and `mount`.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::process::Command;

/// What a call is refused with.
#[derive(Clone, Copy, Debug)]
pub(super) enum Errno {
    Missing = 2,
    NoFolder = 20,
    Unserved = 38,
    Full = 39,
}

/// The kernel's error for a read after the folder was unmounted.
const UNMOUNTED: i32 = 19;
/// A version of the protocol that kernels since 5.2 speak; later ones add nothing that is used here.
const VERSION: [u32; 2] = [7, 31];
/// Bytes of a write at most, and of the buffer for a request.
const WRITE: u32 = 128 << 10;
const BUFFER: usize = 1 << 20;
/// Bytes before a request's own, and before an answer's.
const REQUEST: usize = 40;
const ANSWER: usize = 16;
/// The bit that O_SYNC and O_DSYNC have both.
const SYNCED_WRITES: u32 = 0o10000;
/// Seconds for which the kernel may remember names and sizes: it makes all changes itself.
const REMEMBERED: u64 = 3600;
/// Size of a block, and how many are said to be free.
const BLOCK: u32 = 4096;
const FREE: u64 = 1 << 24;

/// A call of the kernel for an inode.
#[derive(Debug)]
pub(super) struct Request<'a> {
    pub(super) inode: u64,
    pub(super) call: Call<'a>,
}

/// What is asked of the inode of a [`Request`].
#[derive(Debug)]
pub(super) enum Call<'a> {
    Lookup {
        name: &'a str,
    },
    /// Perhaps with a new length first.
    Attributes {
        cut: Option<u64>,
    },
    CreateFolder {
        name: &'a str,
    },
    CreateFile {
        name: &'a str,
    },
    Remove {
        name: &'a str,
        folder: bool,
    },
    Rename {
        name: &'a str,
        folder: u64,
        to: &'a str,
    },
    /// A further name in the inode's folder, of another inode.
    Link {
        inode: u64,
        name: &'a str,
    },
    Read {
        offset: u64,
        most: usize,
    },
    Write {
        offset: u64,
        bytes: &'a [u8],
        syncs: bool,
    },
    Sync,
    OpenFolder,
    List {
        handle: u64,
        offset: u64,
        most: usize,
    },
    CloseFolder {
        handle: u64,
    },
}

/// Mounts a filesystem on a folder. Returns the kernel's end, or why it is refused.
pub(super) fn mount(folder: &Path) -> Result<File, String> {
    let open = File::options().read(true).write(true).open("/dev/fuse");
    let kernel = open.map_err(|error| format!("/dev/fuse: {error}"))?;
    let mut command = Command::new("mount");
    // The descriptor goes along as standard input.
    command.stdin(kernel.try_clone().unwrap());
    command.args(["-i", "-t", "fuse", "-o", "fd=0,rootmode=40000,user_id=0,group_id=0"]);
    let output = command.arg("covis-test").arg(folder).output();
    let output = output.map_err(|error| format!("mount: {error}"))?;
    match output.status.success() {
        true => Ok(kernel),
        false => {
            let said = String::from_utf8_lossy(&output.stderr);
            Err(said.lines().next().unwrap_or("mount failed").to_owned())
        }
    }
}

/// Answers the kernel until the folder is unmounted.
pub(super) fn serve(mut kernel: File, mut play: impl FnMut(Request<'_>) -> Result<Answer, Errno>) {
    let mut buffer = vec![0; BUFFER];
    loop {
        let length = match kernel.read(&mut buffer) {
            Ok(length) => length,
            Err(error) if error.raw_os_error() == Some(UNMOUNTED) => return,
            // The caller was killed before its call was read.
            Err(error) if matches!(error.kind(), ErrorKind::Interrupted | ErrorKind::NotFound) => {
                continue;
            }
            Err(error) => panic!("{error}"),
        };
        let (head, body) = buffer[..length].split_at(REQUEST);
        let answer = match number(head, 4) {
            FORGET | FORGET_SEVERAL | INTERRUPT => continue,
            INIT => Ok(Answer::init()),
            STATFS => Ok(Answer::space()),
            // Of open files nothing is kept.
            OPEN => Ok(Answer::default().opened(0)),
            RELEASE | DESTROY => Ok(Answer::default()),
            code => match Call::parse(code, body) {
                Some(call) => play(Request { inode: long(head, 16), call }),
                None => Err(Errno::Unserved),
            },
        };
        let (error, bytes) = match answer {
            Ok(answer) => (0, answer.0),
            Err(error) => (-(error as i32), Vec::new()),
        };
        let mut whole = Vec::with_capacity(ANSWER + bytes.len());
        whole.extend(u32::try_from(ANSWER + bytes.len()).unwrap().to_ne_bytes());
        whole.extend(error.to_ne_bytes());
        whole.extend(&head[8..16]);
        whole.extend(bytes);
        match kernel.write(&whole) {
            // The caller was killed meanwhile, or the folder unmounted, which the next read tells.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) if error.raw_os_error() == Some(UNMOUNTED) => {}
            written => assert_eq!(written.unwrap(), whole.len()),
        }
    }
}

const LOOKUP: u32 = 1;
const FORGET: u32 = 2;
const GETATTR: u32 = 3;
const SETATTR: u32 = 4;
const MKDIR: u32 = 9;
const UNLINK: u32 = 10;
const RMDIR: u32 = 11;
const RENAME: u32 = 12;
const LINK: u32 = 13;
const OPEN: u32 = 14;
const READ: u32 = 15;
const WRITE_TO: u32 = 16;
const STATFS: u32 = 17;
const RELEASE: u32 = 18;
const FSYNC: u32 = 20;
const INIT: u32 = 26;
const OPENDIR: u32 = 27;
const READDIR: u32 = 28;
const RELEASEDIR: u32 = 29;
const FSYNCDIR: u32 = 30;
const CREATE: u32 = 35;
const INTERRUPT: u32 = 36;
const DESTROY: u32 = 38;
const FORGET_SEVERAL: u32 = 42;

fn number(bytes: &[u8], at: usize) -> u32 {
    u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_ne_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// The first of names that end with a zero, and what follows.
fn name(bytes: &[u8]) -> (&str, &[u8]) {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap();
    (std::str::from_utf8(&bytes[..end]).unwrap(), &bytes[end + 1..])
}

impl<'a> Call<'a> {
    /// `None` where the kernel must do without; it takes that well.
    fn parse(code: u32, body: &'a [u8]) -> Option<Self> {
        let name_at = |at: usize| name(&body[at..]).0;
        let most = || number(body, 16) as usize;
        let call = match code {
            LOOKUP => Self::Lookup { name: name_at(0) },
            GETATTR => Self::Attributes { cut: None },
            SETATTR => {
                let has_size = number(body, 0) & 8 != 0;
                Self::Attributes { cut: has_size.then(|| long(body, 16)) }
            }
            MKDIR => Self::CreateFolder { name: name_at(8) },
            CREATE => Self::CreateFile { name: name_at(16) },
            UNLINK => Self::Remove { name: name_at(0), folder: false },
            RMDIR => Self::Remove { name: name_at(0), folder: true },
            RENAME => {
                let (from, rest) = name(&body[8..]);
                Self::Rename { name: from, folder: long(body, 0), to: name(rest).0 }
            }
            LINK => Self::Link { inode: long(body, 0), name: name_at(8) },
            READ => Self::Read { offset: long(body, 8), most: most() },
            WRITE_TO => Self::Write {
                offset: long(body, 8),
                bytes: &body[40..40 + most()],
                syncs: number(body, 32) & SYNCED_WRITES != 0,
            },
            FSYNC | FSYNCDIR => Self::Sync,
            OPENDIR => Self::OpenFolder,
            READDIR => Self::List { handle: long(body, 0), offset: long(body, 8), most: most() },
            RELEASEDIR => Self::CloseFolder { handle: long(body, 0) },
            _ => return None,
        };
        Some(call)
    }
}

/// What a call is answered with, byte by byte.
#[derive(Debug, Default)]
pub(super) struct Answer(Vec<u8>);

impl Answer {
    fn numbers(mut self, numbers: &[u32]) -> Self {
        self.0.extend(numbers.iter().flat_map(|number| number.to_ne_bytes()));
        self
    }

    fn longs(mut self, longs: &[u64]) -> Self {
        self.0.extend(longs.iter().flat_map(|long| long.to_ne_bytes()));
        self
    }

    fn init() -> Self {
        let [major, minor] = VERSION;
        // Readahead, the feature of writes of more than a page, the grain of times; 64 bytes in all.
        let mut answer = Self::default().numbers(&[major, minor, WRITE, 32, 0, WRITE, 1]);
        answer.0.resize(64, 0);
        answer
    }

    fn space() -> Self {
        let answer = Self::default().longs(&[FREE; 5]);
        answer.numbers(&[BLOCK, 255, BLOCK, 0, 0, 0, 0, 0, 0, 0])
    }

    /// Attributes of a file of a size, or of a folder.
    fn stat(self, inode: u64, size: Option<u64>) -> Self {
        let mode = if size.is_some() { 0o100_644 } else { 0o40_755 };
        let size = size.unwrap_or(0);
        // Inode, size, blocks and three times; parts of a second; mode, links, owner, group, device.
        let answer = self.longs(&[inode, size, size.div_ceil(512), 0, 0, 0]);
        answer.numbers(&[0, 0, 0, mode, 1, 0, 0, 0, BLOCK, 0])
    }

    pub(super) fn attributes(inode: u64, size: Option<u64>) -> Self {
        Self::default().longs(&[REMEMBERED, 0]).stat(inode, size)
    }

    /// What a name stands for.
    pub(super) fn entry(inode: u64, size: Option<u64>) -> Self {
        Self::default().longs(&[inode, 0, REMEMBERED, REMEMBERED, 0]).stat(inode, size)
    }

    /// Open from now on, by a handle.
    pub(super) fn opened(self, handle: u64) -> Self {
        self.longs(&[handle, 0])
    }

    pub(super) fn bytes(bytes: &[u8]) -> Self {
        Self(bytes.to_vec())
    }

    pub(super) fn written(count: usize) -> Self {
        Self::default().numbers(&[u32::try_from(count).unwrap(), 0])
    }

    /// A further entry of a folder, and where the list goes on behind it. False where there is no room.
    pub(super) fn list(
        &mut self,
        name: &str,
        inode: u64,
        folder: bool,
        next: usize,
        most: usize,
    ) -> bool {
        let length = (24 + name.len()).next_multiple_of(8);
        let has_room = self.0.len() + length <= most;
        if has_room {
            let whole = self.0.len() + length;
            let kind = if folder { 4 } else { 8 };
            let answer = std::mem::take(self).longs(&[inode, u64::try_from(next).unwrap()]);
            *self = answer.numbers(&[u32::try_from(name.len()).unwrap(), kind]);
            self.0.extend(name.as_bytes());
            self.0.resize(whole, 0);
        }
        has_room
    }
}
