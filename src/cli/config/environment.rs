//! The `COVIS_*` variables: each setting's name in capitals, and `COVIS_CONFIG`.
//!
//! An empty variable counts as absent. `COVIS_TEST_*` belong to the tests and never warn;
//! `COVIS_TEST_FAULT` reaches the server where the feature `faults` is on, else nothing knows it.

use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::{ConfigError, Layer, LogFormat};
use crate::client::Token;

const PREFIX: &str = "COVIS_";
const TEST_PREFIX: &str = "COVIS_TEST_";

/// Variables by name, in order.
#[derive(Clone, Default)]
pub struct Environment {
    variables: Vec<(String, String)>,
}

/// Names only: a value may be a token.
impl fmt::Debug for Environment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.variables.iter().map(|(name, _)| name)).finish()
    }
}

/// What the variables say.
#[derive(Debug, Default)]
pub(super) struct Variables {
    /// The settings.
    pub(super) layer: Layer,
    /// `COVIS_CONFIG`.
    pub(super) config: Option<PathBuf>,
    /// `COVIS_TOKEN`.
    pub(super) token: Option<Token>,
    /// `COVIS_TEST_FAULT`.
    #[cfg(feature = "faults")]
    pub(super) test_fault: Option<String>,
    /// One sentence for each variable that is not known.
    pub(super) warnings: Vec<String>,
}

impl Environment {
    /// The process' own variables.
    #[must_use]
    pub fn of_process() -> Self {
        Self::new(std::env::vars_os())
    }

    /// Keeps those of `variables` whose name begins with `COVIS_` and whose value is not empty.
    pub fn new(variables: impl IntoIterator<Item = (OsString, OsString)>) -> Self {
        let text = |s: OsString| s.to_string_lossy().into_owned();
        let mut variables: Vec<(String, String)> = variables
            .into_iter()
            .map(|(name, value)| (text(name), text(value)))
            .filter(|(name, value)| name.starts_with(PREFIX) && !value.is_empty())
            .collect();
        variables.sort();
        Self { variables }
    }

    pub(super) fn read(&self) -> Result<Variables, ConfigError> {
        let mut out = Variables::default();
        for (name, value) in &self.variables {
            let layer = &mut out.layer;
            match name.as_str() {
                "COVIS_CONFIG" => out.config = Some(PathBuf::from(value)),
                "COVIS_LISTEN" => layer.listen = Some(value.clone()),
                "COVIS_SERVER" => layer.server = Some(value.clone()),
                "COVIS_THREADS" => layer.threads = Some(number(name, value)?),
                "COVIS_LOCK_STEP" => layer.lock_step = Some(flag(name, value)?),
                "COVIS_MAX_MESSAGE_BYTES" => layer.max_message_bytes = Some(number(name, value)?),
                "COVIS_MAX_CONCURRENT_STREAMS" => {
                    layer.max_concurrent_streams = Some(number(name, value)?);
                }
                "COVIS_MAX_CONNECTIONS" => layer.max_connections = Some(number(name, value)?),
                "COVIS_MAX_STRANGERS" => layer.max_strangers = Some(number(name, value)?),
                "COVIS_QUEUE_CAPACITY" => layer.queue_capacity = Some(number(name, value)?),
                "COVIS_METRICS_LISTEN" => layer.metrics_listen = Some(value.clone()),
                "COVIS_DRAIN_BUDGET" => layer.drain_budget = Some(number(name, value)?),
                "COVIS_LOG_FORMAT" => layer.log_format = Some(log_format(name, value)?),
                "COVIS_OTLP_ENDPOINT" => layer.otlp_endpoint = Some(value.clone()),
                "COVIS_LOG" => layer.log = Some(value.clone()),
                "COVIS_DATA_DIR" => layer.data_dir = Some(PathBuf::from(value)),
                "COVIS_IN_MEMORY" => layer.in_memory = Some(flag(name, value)?),
                "COVIS_CA" => layer.ca = Some(PathBuf::from(value)),
                "COVIS_CERT" => layer.cert = Some(PathBuf::from(value)),
                "COVIS_KEY" => layer.key = Some(PathBuf::from(value)),
                "COVIS_TOKEN_FILE" => layer.token_file = Some(PathBuf::from(value)),
                "COVIS_TOKEN" => out.token = Some(Token::new(value)),
                "COVIS_TLS_CERT" => layer.tls_cert = Some(PathBuf::from(value)),
                "COVIS_TLS_KEY" => layer.tls_key = Some(PathBuf::from(value)),
                "COVIS_TLS_CLIENT_CA" => layer.tls_client_ca = Some(PathBuf::from(value)),
                "COVIS_TOKENS" => layer.tokens = Some(PathBuf::from(value)),
                "COVIS_JWKS" => layer.jwks = Some(PathBuf::from(value)),
                "COVIS_JWT_ISSUER" => layer.jwt_issuer = Some(value.clone()),
                "COVIS_JWT_AUDIENCE" => layer.jwt_audience = Some(value.clone()),
                "COVIS_INSECURE_PLAIN_TEXT" => {
                    layer.insecure_plain_text = Some(flag(name, value)?);
                }
                #[cfg(feature = "faults")]
                "COVIS_TEST_FAULT" => out.test_fault = Some(value.clone()),
                _ if name.starts_with(TEST_PREFIX) => {}
                _ => out.warnings.push(format!("unknown environment variable {name} is ignored")),
            }
        }
        Ok(out)
    }
}

fn number<T: FromStr>(variable: &str, value: &str) -> Result<T, ConfigError> {
    value.trim().parse().map_err(|_error| invalid(variable, value, "a whole number"))
}

fn flag(variable: &str, value: &str) -> Result<bool, ConfigError> {
    match value.trim() {
        "1" | "true" => Ok(true),
        "0" | "false" => Ok(false),
        _ => Err(invalid(variable, value, "true or false")),
    }
}

fn log_format(variable: &str, value: &str) -> Result<LogFormat, ConfigError> {
    match value.trim() {
        "text" => Ok(LogFormat::Text),
        "json" => Ok(LogFormat::Json),
        _ => Err(invalid(variable, value, "text or json")),
    }
}

fn invalid(variable: &str, value: &str, expected: &'static str) -> ConfigError {
    ConfigError::Variable { variable: variable.to_owned(), value: value.to_owned(), expected }
}
