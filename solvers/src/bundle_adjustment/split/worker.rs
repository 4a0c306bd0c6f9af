//! A worker: sections in, answers out. It decides nothing and knows no other section.
//!
//! What a request needs and is not at hand is made again from the section and the values that it names,
//! so that an answer does not depend on what the worker kept. Sections that do not fit what it may keep
//! are read and built for each request and let go again.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::interrupt::Interrupt;
use crate::price::{Ceiling, Limits};
use crate::simd::Class;

use super::super::system::BorderedSystem;
use super::file::read_section;
use super::kept::Kept;
use super::message::{Answer, Linearize, Motion, Reply, Request, START, Source, StepPart, Version};
use super::section::{Section, Values};

/// Serves sections, one request at a time.
#[derive(Default)]
pub struct Worker {
    settings: Option<Settings>,
    sections: BTreeMap<u32, Slot>,
    /// Bytes of the systems that are kept.
    kept_bytes: u64,
}

#[derive(Clone, Copy)]
struct Settings {
    class: Class,
    ceiling: Ceiling,
    keep_bytes: u64,
}

/// One section.
struct Slot {
    source: Source,
    values: Kept<Values>,
    is_kept: bool,
    system: Option<Built>,
}

/// A section's system and what was done with it last.
struct Built {
    system: BorderedSystem,
    bytes: u64,
    /// The version that it is at.
    at: Option<Version>,
    eliminated: Option<Linearize>,
    step: Option<(Linearize, Vec<f64>, StepPart)>,
}

/// Why a request is refused.
type Refusal = String;

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").field("sections", &self.sections.len()).finish_non_exhaustive()
    }
}

impl Worker {
    /// A worker without sections.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Answers a request. Once `interrupt` is due an answer may be anything.
    pub fn answer(&mut self, request: Request, interrupt: &Interrupt) -> Answer {
        let start = Instant::now();
        let reply = self.reply(request, interrupt).unwrap_or_else(Reply::Refused);
        Answer { seconds: start.elapsed().as_secs_f64(), peak_bytes: peak_bytes(), reply }
    }

    fn reply(&mut self, request: Request, interrupt: &Interrupt) -> Result<Reply, Refusal> {
        match request {
            Request::Open { class, ceiling_bytes, ceiling_flops, keep_bytes } => {
                if !class.is_available() {
                    return Err(format!("this processor has no {class:?} instructions"));
                }
                let ceiling = Ceiling { bytes: ceiling_bytes, flops_per_iteration: ceiling_flops };
                *self = Self::default();
                self.settings = Some(Settings { class, ceiling, keep_bytes });
                Ok(Reply::Opened(class))
            }
            Request::Load { section, source } => self.load(section, source, interrupt),
            Request::SetValues { section, version, values } => {
                let slot = slot(&mut self.sections, section)?;
                let like = slot.values.newest();
                if !values.is_finite() || like.is_none_or(|like| !values.is_like(like)) {
                    return Err(format!("values that are not those of section {section}"));
                }
                slot.values.push(version, values);
                Ok(Reply::Done)
            }
            Request::Cost { section, base } => {
                self.with(section, base, interrupt, |built, values| {
                    built.set(base, values);
                    Ok(Reply::Cost(built.system.cost()))
                })
            }
            Request::Contribute { section, linearize } => {
                self.with(section, linearize.base, interrupt, |built, values| {
                    built.set(linearize.base, values);
                    let contribution =
                        built.system.contribute(linearize.damping, linearize.stiffness);
                    built.eliminated = Some(linearize);
                    Ok(Reply::Contributed(contribution))
                })
            }
            Request::Move { section, linearize, step, motion, version } => {
                let base = linearize.base;
                let reply = self.with(section, base, interrupt, |built, values| {
                    built.step(linearize, step, motion, values)
                })?;
                let slot = slot(&mut self.sections, section)?;
                if let Reply::Moved { values, .. } = &reply {
                    slot.values.push_beside(base, version, values.clone());
                    if let Some(built) = &mut slot.system {
                        built.at = Some(version);
                    }
                }
                Ok(reply)
            }
        }
    }

    fn load(
        &mut self,
        section: u32,
        source: Source,
        interrupt: &Interrupt,
    ) -> Result<Reply, Refusal> {
        let settings = self.settings.ok_or("no session was opened")?;
        if let Some(old) = self.sections.remove(&section)
            && old.is_kept
        {
            self.kept_bytes -= old.system.map_or(0, |built| built.bytes);
        }
        let found = read(&source)?;
        let mut values = Kept::default();
        values.push(START, Values::of(&found.problem));
        let built = Built::new(found, settings, interrupt)?;
        let border = built.system.border();
        let bytes = built.bytes;
        let is_kept = self.kept_bytes.saturating_add(bytes) <= settings.keep_bytes;
        let slot = Slot { source, values, is_kept, system: is_kept.then_some(built) };
        if is_kept {
            self.kept_bytes += bytes;
        }
        self.sections.insert(section, slot);
        Ok(Reply::Loaded { border, bytes })
    }

    /// Does `work` with a section's system and the values of a version.
    fn with(
        &mut self,
        section: u32,
        base: Version,
        interrupt: &Interrupt,
        work: impl FnOnce(&mut Built, &Values) -> Result<Reply, Refusal>,
    ) -> Result<Reply, Refusal> {
        let settings = self.settings.ok_or("no session was opened")?;
        let slot = slot(&mut self.sections, section)?;
        let unknown = || format!("section {section} has no values of version {base}");
        let values = slot.values.get(base).ok_or_else(unknown)?;
        let mut built = match slot.system.take() {
            Some(built) => built,
            None => Built::new(read(&slot.source)?, settings, interrupt)?,
        };
        built.system.set_interrupt(interrupt);
        let reply = work(&mut built, values);
        if slot.is_kept {
            slot.system = Some(built);
        }
        reply
    }
}

impl Built {
    fn new(section: Section, settings: Settings, interrupt: &Interrupt) -> Result<Self, Refusal> {
        let Section { problem, cameras_apart, border_poses, border_cameras } = section;
        let limits = Limits { ceiling: settings.ceiling, interrupt };
        let marks = (&cameras_apart[..], &border_poses[..], &border_cameras[..]);
        let (system, bytes) = BorderedSystem::new(Box::new(problem), marks, settings.class, limits)
            .map_err(|error| error.to_string())?;
        Ok(Self { system, bytes, at: Some(START), eliminated: None, step: None })
    }

    /// Brings the system to a version.
    fn set(&mut self, version: Version, values: &Values) {
        if self.at != Some(version) {
            self.system.set_values(values);
            self.at = Some(version);
            self.eliminated = None;
        }
    }

    fn step(
        &mut self,
        linearize: Linearize,
        step: Vec<f64>,
        motion: Motion,
        values: &Values,
    ) -> Result<Reply, Refusal> {
        let expected = self.system.border_dimension();
        if step.len() != expected {
            return Err(format!("a step of {} unknowns for {expected}", step.len()));
        }
        let part = match self.step.take() {
            Some((of, known, part)) if of == linearize && known == step => {
                self.set(linearize.base, values);
                part
            }
            _ => {
                self.set(linearize.base, values);
                if self.eliminated != Some(linearize) {
                    self.system.contribute(linearize.damping, linearize.stiffness);
                }
                self.system.step(linearize.damping, &step)
            }
        };
        let cost = self.system.move_along(motion);
        let values = self.system.values();
        // The elimination is of the base; the system is elsewhere now.
        self.eliminated = None;
        self.at = None;
        self.step = Some((linearize, step, part.clone()));
        Ok(Reply::Moved { part, cost, values })
    }
}

fn slot(sections: &mut BTreeMap<u32, Slot>, section: u32) -> Result<&mut Slot, Refusal> {
    sections.get_mut(&section).ok_or_else(|| format!("section {section} was not loaded"))
}

fn read(source: &Source) -> Result<Section, Refusal> {
    let section = match source {
        Source::Here(section) => Section::clone(section),
        Source::File { path, offset, length } => {
            read_section(path, *offset, *length).map_err(|error| error.to_string())?
        }
    };
    section.validate().map_err(|error| error.to_string())?;
    Ok(section)
}

/// Most memory that this process ever had, in bytes; 0 where the system does not tell.
#[must_use]
pub fn peak_bytes() -> u64 {
    let status = fs_err::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kibibytes = line.and_then(|line| line.trim().strip_suffix("kB"));
    kibibytes.and_then(|number| number.trim().parse::<u64>().ok()).map_or(0, |kib| kib * 1024)
}
