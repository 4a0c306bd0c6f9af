//! The library that traces a server's changes (shim.c): built, loaded, told what to do, read.

use std::collections::BTreeMap;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use super::model::Disk;

/// The library, built once a run; `None` where there is no C compiler, which is said once.
pub(super) fn library() -> Option<&'static Path> {
    static BUILT: OnceLock<Option<PathBuf>> = OnceLock::new();
    let built = BUILT.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let (path, new) =
            (folder.join("disk.so"), folder.join(format!("disk-{}.so", std::process::id())));
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration/power/shim.c");
        let mut command = Command::new("cc");
        command.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&new).arg(source);
        match command.args(["-lpthread", "-ldl"]).output() {
            Ok(output) => {
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "the library does not build: {said}");
                fs_err::rename(new, &path).unwrap();
                Some(path)
            }
            Err(error) => {
                covis_solvers::testing::skip(&format!("no C compiler ({error})"));
                None
            }
        }
    });
    built.as_deref()
}

/// A field of `struct stage` in shim.c.
#[derive(Clone, Copy, Debug)]
pub(super) enum Field {
    SyncDelayUs,
    IsHeld,
    Permits,
    SyncErrno,
    SyncKind,
    SyncSkip,
    WriteErrno,
    OpenErrno,
    Waiting,
    Syncs,
}

/// How many there are.
const FIELDS: usize = 10;

/// Faults of a disk that a process has; they can be changed while it runs.
#[derive(Debug)]
pub(super) struct Stage(std::fs::File);

impl Stage {
    pub(super) fn new(path: &Path) -> Self {
        fs_err::write(path, [0; FIELDS * 8]).unwrap();
        Self(std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap())
    }

    pub(super) fn set(&self, field: Field, value: i64) {
        self.0.write_all_at(&value.to_le_bytes(), field as u64 * 8).unwrap();
    }

    pub(super) fn get(&self, field: Field) -> i64 {
        let mut bytes = [0; 8];
        self.0.read_exact_at(&mut bytes, field as u64 * 8).unwrap();
        i64::from_le_bytes(bytes)
    }

    /// Every fault taken away.
    pub(super) fn heal(&self) {
        use Field::{IsHeld, OpenErrno, Permits, SyncDelayUs, SyncErrno, SyncSkip, WriteErrno};
        for field in [SyncErrno, WriteErrno, OpenErrno, SyncDelayUs, SyncSkip, Permits, IsHeld] {
            self.set(field, 0);
        }
    }
}

/// What `enum` of shim.c begins with.
const MAGIC: u32 = 0x6b73_6964;
/// Bytes of `struct record`.
const HEAD: usize = 40;

/// Plays a trace on a model; a record that the kill cut short is left out. Returns how many were played.
pub(super) fn play(trace: &[u8], disk: &mut Disk) -> usize {
    let mut open = BTreeMap::new();
    let (mut rest, mut count) = (trace, 0);
    while let Some((record, after)) = Record::read(rest) {
        record.play(disk, &mut open);
        (rest, count) = (after, count + 1);
    }
    count
}

#[derive(Debug)]
struct Record<'a> {
    op: u32,
    fd: i32,
    flags: i32,
    offset: usize,
    first: &'a str,
    second: &'a str,
    data: &'a [u8],
}

impl<'a> Record<'a> {
    /// The first record and what follows it.
    fn read(bytes: &'a [u8]) -> Option<(Self, &'a [u8])> {
        let (head, rest) = bytes.split_at_checked(HEAD)?;
        let four = |at: usize| <[u8; 4]>::try_from(&head[at..at + 4]).unwrap();
        let eight = |at: usize| <[u8; 8]>::try_from(&head[at..at + 8]).unwrap();
        assert_eq!(u32::from_le_bytes(four(0)), MAGIC, "the trace is out of step");
        let length = |at| u32::from_le_bytes(four(at)) as usize;
        let (first, rest) = rest.split_at_checked(length(24))?;
        let (second, rest) = rest.split_at_checked(length(28))?;
        let (data, rest) = rest.split_at_checked(u64::from_le_bytes(eight(32)) as usize)?;
        let record = Self {
            op: u32::from_le_bytes(four(4)),
            fd: i32::from_le_bytes(four(8)),
            flags: i32::from_le_bytes(four(12)),
            offset: i64::from_le_bytes(eight(16)) as usize,
            first: std::str::from_utf8(first).unwrap(),
            second: std::str::from_utf8(second).unwrap(),
            data,
        };
        Some((record, rest))
    }

    fn play(&self, disk: &mut Disk, open: &mut BTreeMap<i32, usize>) {
        let opened = |open: &BTreeMap<i32, usize>| {
            *open.get(&self.fd).unwrap_or_else(|| panic!("not open: {self:?}"))
        };
        match self.op {
            1 => {
                let id = if self.flags & 1 == 0 {
                    let found = disk.find(self.first);
                    found.unwrap_or_else(|| panic!("the trace does not know {:?}", self.first))
                } else {
                    disk.create_file(self.first)
                };
                if self.flags & 3 == 2 {
                    disk.cut(id, 0);
                }
                open.insert(self.fd, id);
            }
            2 => disk.write(opened(open), self.offset, self.data),
            3 => disk.cut(opened(open), self.offset),
            4 if self.flags == 0 => disk.sync(opened(open)),
            4 => disk.fail_sync(opened(open)),
            5 => {
                open.remove(&self.fd);
            }
            6 => disk.rename(self.first, self.second),
            7 | 9 => disk.remove(self.first),
            8 => disk.create_folder(self.first),
            10 => disk.link(self.first, self.second),
            11 => {
                let id = *open.get(&self.flags).expect("a copy of what is open");
                open.insert(self.fd, id);
            }
            op => panic!("unknown record {op}"),
        }
    }
}
