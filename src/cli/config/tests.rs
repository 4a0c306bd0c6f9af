//! Precedence of the sources and what each of them refuses.

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;

use super::{Config, Environment, Texts};
use crate::service::engine::Resource;

fn environment(variables: &[(&str, &str)]) -> Environment {
    Environment::new(variables.iter().map(|&(k, v)| (OsString::from(k), OsString::from(v))))
}

fn file(text: &str) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    file
}

#[test]
fn flags_win_over_environment_over_file_over_defaults() {
    let file = file("listen = \"[::1]:1\"\nthreads = 2\nlog = \"warn\"\nlock_step = true\n");
    let variables = [("COVIS_THREADS", "3"), ("COVIS_LISTEN", "host:2"), ("COVIS_LOG", "")];
    let flags = vec![("threads".to_owned(), OsString::from("4"))];
    let path = Some(file.path().to_owned());
    let (config, warnings) = Config::load(flags, path, environment(&variables)).unwrap();
    assert_eq!((config.threads, config.listen.as_deref()), (Some(4), Some("host:2")));
    assert_eq!((config.log.as_deref(), config.lock_step), (Some("warn"), true));
    let server = crate::cli::serve::server_config(&config);
    assert_eq!((server.threads, server.max_message_bytes), (4, 4 * 1024 * 1024));
    assert_eq!(warnings, Vec::<String>::new());
}

#[test]
fn the_environment_may_name_the_file() {
    let file = file("queue_capacity = 7\n");
    let path = file.path().to_str().unwrap();
    let environment = environment(&[("COVIS_CONFIG", path)]);
    let (config, _) = Config::load(Texts::new(), None, environment).unwrap();
    assert_eq!(config.queue_capacity, Some(7));
}

#[test]
fn an_instruction_set_that_the_processor_lacks_is_an_error() {
    let load = |name| Config::load(Texts::new(), None, environment(&[("COVIS_SIMD", name)]));
    let (config, warnings) = load("scalar").unwrap();
    assert_eq!((config, warnings.len()), (Config::default(), 0));
    let foreign = if cfg!(target_arch = "aarch64") { "avx2" } else { "neon" };
    for name in ["sse", foreign] {
        let text = load(name).unwrap_err().to_string();
        let start = "environment variable COVIS_SIMD: an instruction set of this processor (";
        assert!(text.starts_with(start) && text.contains("scalar"), "{text}");
        assert!(text.ends_with(&format!("is needed, not `{name}`")), "{text}");
    }
}

#[test]
fn an_unknown_variable_warns_and_a_switch_of_the_tests_does_not() {
    let variables = [("COVIS_THREDS", "3"), ("COVIS_TEST_DATA", "x"), ("COVIS_TEST_FAULT", "f")];
    let (config, warnings) = Config::load(Texts::new(), None, environment(&variables)).unwrap();
    assert_eq!(warnings, ["unknown environment variable COVIS_THREDS is ignored"]);
    #[cfg(feature = "faults")]
    assert_eq!(config.test_fault.as_deref(), Some("f"));
}

#[test]
fn a_file_that_cannot_be_used_is_named_with_the_line() {
    let check = |text: &str, parts: &[&str]| {
        let message = Config::parse(text, Path::new("covis.toml")).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part), "`{part}` in `{message}`");
        }
        assert!(!message.contains('\n'), "{message}");
    };
    check("threads = 2\n\nthreds = 3\n", &["covis.toml, line 3", "threds"]);
    check("threads = \"two\"\n", &["line 1", "threads"]);
    check("threads = 2\nlisten = \n", &["line 2", "listen"]);
    check("threads = 2\nthreads = 3\n", &["line 2", "threads"]);
    check("[server]\nurl = 1\n", &["line 1", "server"]);
    check(&"# \n".repeat(100_000), &["line 1", "at most 262144 are read"]);
}

#[test]
fn values_out_of_range_name_their_setting() {
    let check = |variables: &[(&str, &str)], part: &str| {
        let loaded = Config::load(Texts::new(), None, environment(variables));
        let message = loaded.unwrap_err().to_string();
        assert!(message.contains(part), "`{part}` in `{message}`");
    };
    check(&[("COVIS_THREADS", "many")], "COVIS_THREADS");
    check(&[("COVIS_THREADS", "0")], "setting threads");
    check(&[("COVIS_LOCK_STEP", "perhaps")], "COVIS_LOCK_STEP");
    check(&[("COVIS_LISTEN", "here")], "setting listen");
    check(&[("COVIS_LOG", "inof")], "setting log");
    check(&[("COVIS_JWKS", "keys.json"), ("COVIS_JWT_ISSUER", "i")], "setting jwks");
    check(&[("COVIS_JWT_AUDIENCE", "covis")], "setting jwks");
    check(&[("COVIS_MAX_MESSAGE_BYTES", "12")], "setting max_message_bytes");
    check(&[("COVIS_MAX_CONNECTIONS", "1")], "setting max_connections");
    check(&[("COVIS_MAX_STRANGERS", "0")], "setting max_strangers");
    let missing = Config::load(Texts::new(), Some("no/such.toml".into()), environment(&[]));
    assert!(missing.unwrap_err().to_string().contains("no/such.toml"));
}

#[test]
fn certificates_come_with_keys_and_a_token_is_never_shown() {
    let check = |variables: &[(&str, &str)], part: &str| {
        let loaded = Config::load(Texts::new(), None, environment(variables));
        let message = loaded.unwrap_err().to_string();
        assert!(message.contains(part), "`{part}` in `{message}`");
    };
    check(&[("COVIS_TLS_CERT", "a.pem")], "setting tls_cert");
    check(&[("COVIS_TLS_KEY", "a.key")], "setting tls_cert");
    check(&[("COVIS_TLS_CLIENT_CA", "a.pem")], "setting tls_client_ca");
    let variables = environment(&[("COVIS_TOKEN", "secret")]);
    assert!(!format!("{variables:?}").contains("secret"));
    let (config, warnings) = Config::load(Texts::new(), None, variables).unwrap();
    assert!(config.token.is_some());
    assert_eq!(warnings, Vec::<String>::new());
    assert!(!format!("{config:?}").contains("secret"));
    // A file would be copied about: it may name the token's file only.
    let quoted = Config::parse("\"token\" = 'secret'\n", Path::new("covis.toml")).unwrap_err();
    assert!(!quoted.to_string().contains("secret"), "{quoted}");
    let message = Config::parse("token = 'secret'\n", Path::new("covis.toml")).unwrap_err();
    let message = message.to_string();
    assert!(message.contains("token") && !message.contains("secret"), "{message}");
}

#[test]
fn limits_of_the_server_stand_over_their_defaults() {
    let file = file(
        "[server_limits]\nmax_bytes = 1000\nmax_watchers = 2\n\n[map_limits]\nmax_cameras = 3\n",
    );
    let path = Some(file.path().to_owned());
    let (config, _) = Config::load(Texts::new(), path, environment(&[])).unwrap();
    let (limits, default) = (config.server_limits, crate::service::default_limits());
    let limits = limits.over(&default);
    assert_eq!((limits.held.bytes, limits.of(Resource::Watchers)), (Some(1000), Some(2)));
    assert_eq!(limits.of(Resource::Streams), default.of(Resource::Streams));
    let limits = config.map_limits.over(&crate::service::default_map_limits());
    assert_eq!((limits.cameras, limits.keyframes), (Some(3), Some(100_000)));
}

#[test]
fn limits_of_a_solve_stand_over_their_defaults() {
    let file = file("[solve_limits]\nmax_gflops = 20\n");
    let path = Some(file.path().to_owned());
    let (config, _) = Config::load(Texts::new(), path, environment(&[])).unwrap();
    let engine = crate::cli::serve::server_config(&config).engine;
    assert_eq!((engine.max_solve_gflops, engine.max_solve_bytes), (20, 1 << 30));
}

#[test]
fn arguments_of_a_command_are_no_settings() {
    let command = crate::cli::command();
    let given = |line: &str| {
        let matches = command.clone().try_get_matches_from(line.split(' ')).unwrap();
        super::given(&command, &matches)
    };
    let threads = vec![("threads".to_owned(), OsString::from("2"))];
    assert_eq!(given("covis run synthetic:static --threads 2"), Texts::new());
    assert_eq!(given("covis doctor folder"), Texts::new());
    assert_eq!(given("covis serve --threads 2"), threads);
    assert_eq!(given("covis solve --threads 2 bundle file"), threads);
    assert_eq!(given("covis solve bundle file --threads 2"), threads);
    let log = vec![("log".to_owned(), OsString::from("warn"))];
    assert_eq!(given("covis --log warn doctor folder"), log);
    assert_eq!(given("covis doctor folder --log warn"), log);
}

#[test]
fn names_of_files_keep_their_spaces_and_numbers_do_not() {
    let variables = [("COVIS_DATA_DIR", "maps "), ("COVIS_THREADS", " 3 ")];
    let (config, _) = Config::load(Texts::new(), None, environment(&variables)).unwrap();
    assert_eq!((config.data_dir.as_deref(), config.threads), (Some(Path::new("maps ")), Some(3)));
}
