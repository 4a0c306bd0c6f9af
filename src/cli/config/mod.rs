//! The configuration: flags over `COVIS_*` environment over `covis.toml` over defaults.
//!
//! The file gives a [`Config`]; a variable of the environment and then a flag is laid over it as
//! the text of the flag of its name. `covis.toml` is read from the working folder, or from where
//! `--config` or `COVIS_CONFIG` says. A key that is not known is an error in the file (with its
//! line), and a warning in the environment, where a neighbor's variable may stray in. An empty
//! variable counts as absent. `COVIS_TEST_*` belong to the tests and never warn.

mod settings;
#[cfg(test)]
mod tests;

use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

use clap::builder::{BoolishValueParser, ValueParser};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command, FromArgMatches};
use covis_solvers::simd;
use serde::de::DeserializeOwned;

use crate::client::Token;

pub use settings::{CONNECTION, Config, LOG, LogFormat, flags};

/// The file that is read when no other is named.
const DEFAULT_FILE: &str = "covis.toml";

/// Longest file, bytes. The parser of TOML may take a hundred times as much.
const MAX_BYTES: usize = 256 << 10;

/// The two keys of one setting: who says where maps are kept says all of it.
const STORAGE: [&str; 2] = ["data_dir", "in_memory"];

/// Settings by name with their values as text.
pub type Texts = Vec<(String, OsString)>;

/// A configuration that cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// The file is not TOML, holds an unknown key or a value of another type.
    #[error("{}, line {line}: {reason} (`{text}`)", path.display())]
    File {
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        reason: String,
        text: String,
    },
    /// A variable of the environment, or a flag, cannot be read as its setting.
    #[error("{name}: {expected} is needed, not `{value}`")]
    Value { name: String, value: String, expected: String },
    /// A setting is out of its range.
    #[error("setting {key}: {reason}")]
    OutOfRange { key: &'static str, reason: &'static str },
}

/// The `COVIS_*` variables that are not empty, by name, in order.
#[derive(Clone, Default)]
pub struct Environment(Vec<(String, String)>);

/// Names only: a value may be a token.
impl fmt::Debug for Environment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|(name, _)| name)).finish()
    }
}

impl Environment {
    /// Keeps what is ours of `variables`; the process has them in `std::env::vars_os`.
    pub fn new(variables: impl IntoIterator<Item = (OsString, OsString)>) -> Self {
        let text = |s: OsString| s.to_string_lossy().into_owned();
        let variables = variables.into_iter().map(|(name, value)| (text(name), text(value)));
        let is_ours =
            |(name, value): &(String, String)| name.starts_with("COVIS_") && !value.is_empty();
        let mut variables: Vec<_> = variables.filter(is_ours).collect();
        variables.sort_unstable();
        Self(variables)
    }
}

/// Whether kernels can use the instruction set that the variable names.
fn check_simd(value: &str) -> Result<(), ConfigError> {
    let is_available = value.parse().is_ok_and(simd::Class::is_available);
    let available = simd::Class::ALL.into_iter().filter(|class| class.is_available());
    let available = available.map(|class| class.to_string()).collect::<Vec<_>>().join(", ");
    let (name, value) = (format!("environment variable {}", simd::VARIABLE), value.to_owned());
    let expected = format!("an instruction set of this processor ({available})");
    is_available.then_some(()).ok_or(ConfigError::Value { name, value, expected })
}

impl Config {
    /// Lays `flags` over `environment` over the file over the defaults. `file` is what `--config`
    /// names. Returns the warnings as well, one sentence each.
    ///
    /// # Errors
    /// [`ConfigError`] names the source, the key and, in a file, the line.
    pub fn load(
        flags: Texts,
        mut file: Option<PathBuf>,
        environment: Environment,
    ) -> Result<(Self, Vec<String>), ConfigError> {
        let command = Self::command().mut_args(with_value).no_binary_name(true);
        let (mut variables, mut warnings, mut token) = (Texts::new(), Vec::new(), None);
        #[cfg(feature = "faults")]
        let mut test_fault = None;
        for (name, value) in environment.0 {
            let setting = command.get_arguments().find(|s| settings::variable(s) == name);
            match (setting, name.as_str()) {
                (Some(setting), _) => {
                    // Names of files may begin or end with spaces, numbers and switches may not.
                    let is_text = setting.get_value_parser().type_id()
                        == ValueParser::string().type_id()
                        || setting.get_value_parser().type_id()
                            == ValueParser::path_buf().type_id();
                    let value = if is_text { value.as_str() } else { value.trim() };
                    variables.push((setting.get_id().to_string(), value.into()));
                }
                (None, "COVIS_CONFIG") => file = file.or(Some(value.into())),
                (None, "COVIS_TOKEN") => token = Some(Token::new(&value)),
                // The solvers read it themselves, and pass over what they cannot follow.
                (None, simd::VARIABLE) => check_simd(&value)?,
                #[cfg(feature = "faults")]
                (None, "COVIS_TEST_FAULT") => test_fault = Some(value),
                (None, _) if name.starts_with("COVIS_TEST_") => {}
                (None, _) => {
                    warnings.push(format!("unknown environment variable {name} is ignored"));
                }
            }
        }
        let file =
            file.or_else(|| Some(DEFAULT_FILE.into()).filter(|path: &PathBuf| path.is_file()));
        let mut config = file.map_or_else(|| Ok(Self::default()), |path| Self::read(&path))?;
        config.token = token;
        #[cfg(feature = "faults")]
        {
            config.test_fault = test_fault;
        }
        config.names_server = flags.iter().any(|(key, _)| key == "server");
        let name = |setting: &Arg| format!("environment variable {}", settings::variable(setting));
        config.lay_over(&variables, &command, name)?;
        let name = |setting: &Arg| format!("--{}", setting.get_long().unwrap_or_default());
        config.lay_over(&flags, &command, name)?;
        match config.out_of_range() {
            Some((key, reason)) => Err(ConfigError::OutOfRange { key, reason }),
            None => Ok((config, warnings)),
        }
    }

    /// Replaces the settings that `texts` names; `name` is what an error calls one of them.
    fn lay_over(
        &mut self,
        texts: &Texts,
        command: &clap::Command,
        name: impl Fn(&Arg) -> String,
    ) -> Result<(), ConfigError> {
        if texts.iter().any(|(key, _)| STORAGE.contains(&key.as_str())) {
            (self.data_dir, self.in_memory) = (None, false);
        }
        for (key, value) in texts {
            let Some(setting) = command.get_arguments().find(|s| s.get_id() == key.as_str()) else {
                continue;
            };
            let mut argument = OsString::from(format!("--{}=", setting.get_long().unwrap_or(key)));
            argument.push(value);
            let matches = command.clone().try_get_matches_from([argument]);
            matches.and_then(|matches| self.update_from_arg_matches(&matches)).map_err(
                |_error| {
                    let value = value.to_string_lossy().into_owned();
                    ConfigError::Value { name: name(setting), value, expected: expected(setting) }
                },
            )?;
        }
        Ok(())
    }

    fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = fs_err::read_to_string(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Parses a TOML text, over the defaults; `path` names it in errors. Ranges are not checked.
    ///
    /// # Errors
    /// [`ConfigError::File`] with the line.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        parse_toml(text, path)
    }
}

/// Parses a TOML text of at most 256 KiB; `path` names it in errors.
///
/// # Errors
/// [`ConfigError::File`] with the line.
pub(super) fn parse_toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, ConfigError> {
    if text.len() > MAX_BYTES {
        return Err(ConfigError::File {
            path: path.to_owned(),
            line: 1,
            reason: format!("the file has {} bytes, at most {MAX_BYTES} are read", text.len()),
            text: "...".to_owned(),
        });
    }
    toml::from_str(text).map_err(|error| {
        let line = line_of(text, error.span().map_or(0, |span| span.start));
        let shown = text.lines().nth(line - 1).unwrap_or_default().trim();
        // A token does not belong here, and no less into a log.
        let key = shown.split('=').next().unwrap_or_default().trim().trim_matches(['"', '\'']);
        let shown = if key == "token" { "token = ..." } else { shown };
        ConfigError::File {
            path: path.to_owned(),
            line,
            reason: error.message().to_owned(),
            text: shown.to_owned(),
        }
    })
}

/// The line of a place in a text, from 1.
pub(super) fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&b| b == b'\n').count()
}

/// A switch as a flag with a value, so that a variable can turn it off too.
fn with_value(setting: Arg) -> Arg {
    if matches!(setting.get_action(), ArgAction::SetTrue) {
        setting.action(ArgAction::Set).num_args(1).value_parser(BoolishValueParser::new())
    } else {
        setting
    }
}

/// What the value of a setting must be. Texts and paths are all taken; the rest are numbers.
fn expected(setting: &Arg) -> String {
    let values = setting.get_possible_values();
    let names: Vec<&str> =
        values.iter().filter(|value| !value.is_hide_set()).map(|value| value.get_name()).collect();
    if names.is_empty() { "a whole number".to_owned() } else { names.join(" or ") }
}

/// The settings among the flags that were given. Flags of settings are global; an argument of a
/// command with the name of a setting (`run --threads`) is none.
#[must_use]
pub fn given(command: &Command, matches: &ArgMatches) -> Texts {
    let (mut level, mut innermost) = (command, matches);
    let mut flags: Vec<&Arg> = command.get_arguments().collect();
    while let Some((name, inner)) = innermost.subcommand() {
        innermost = inner;
        let Some(next) = level.find_subcommand(name) else { break };
        level = next;
        flags.extend(level.get_arguments());
    }
    flags.retain(|flag| flag.is_global_set());
    let settings = Config::command();
    let is_given = |id: &&str| {
        settings.get_arguments().any(|setting| setting.get_id() == *id)
            && flags.iter().any(|flag| flag.get_id() == *id)
            && innermost.value_source(id) == Some(ValueSource::CommandLine)
    };
    let ids = innermost.ids().map(clap::Id::as_str).filter(is_given);
    ids.filter_map(|id| Some((id.to_owned(), innermost.get_raw(id)?.next()?.to_owned()))).collect()
}
