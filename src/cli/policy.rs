//! The policy of a map as TOML: the fields of `MapPolicy` by their names, values as the flags of other
//! commands name them.
//!
//! A file names the fields that it is about. What it does not name stays as it is, or has the server's
//! default in a new map. Types and names are checked here, ranges by the server.

use std::path::{Path, PathBuf};

use anyhow::Context;
use fs_err as fs;
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, DeValue};

use super::config::{ConfigError, line_of, parse_toml};
use crate::wire::v1;

/// The fields that are messages whose fields are changed one by one.
const IN_PARTS: [&str; 2] = ["limits", "place_recognition"];

/// An enum of the wire by the names of its values.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident { $($value:ident,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        enum $name {
            $($value,)*
        }

        impl $name {
            fn to_wire(self) -> i32 {
                match self {
                    $(Self::$value => v1::$name::$value.into(),)*
                }
            }

            /// `None` for the default, and for a value of a later server.
            fn of_wire(value: i32) -> Option<Self> {
                match v1::$name::try_from(value) {
                    $(Ok(v1::$name::$value) => Some(Self::$value),)*
                    Ok(v1::$name::Unspecified) | Err(_) => None,
                }
            }
        }
    };
}

named! {
    /// See `Gauge` of the wire.
    Gauge { FirstKeyframeFixed, Free, Priors, FixedPoses, }
}
named! {
    /// See `WhenFull` of the wire.
    WhenFull { Reject, Marginalize, Sparsify, }
}
named! {
    /// See `LossKind` of the wire.
    LossKind { Trivial, Huber, Cauchy, Tukey, GemanMcclure, }
}
named! {
    /// See `RobustKernel` of the wire.
    RobustKernel { None, GncTls, GncGm, }
}

/// A policy, or the fields of one that a file names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Policy {
    window_keyframe_count: Option<i32>,
    min_shared_landmark_count: Option<i32>,
    gauge: Option<Gauge>,
    local_bundle_adjustment: Option<bool>,
    loop_closure_optimization: Option<bool>,
    max_iteration_count: Option<i32>,
    when_full: Option<WhenFull>,
    closure_adjustment: Option<bool>,
    odometry: Option<bool>,
    metric_odometry: Option<bool>,
    observation_loss: Option<Loss>,
    constraint_loss: Option<Loss>,
    loop_closure_robustness: Option<ClosureRobustness>,
    geodetic_anchor: Option<GeodeticPosition>,
    place_recognition: Option<PlaceRecognition>,
    limits: Option<Limits>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Loss {
    kind: LossKind,
    width: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClosureRobustness {
    kernel: RobustKernel,
    threshold: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GeodeticPosition {
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceRecognition {
    enabled: Option<bool>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Limits {
    max_keyframe_count: Option<i64>,
    max_landmark_count: Option<i64>,
    max_observation_count: Option<i64>,
    max_size_bytes: Option<i64>,
    max_queued_item_count: Option<i32>,
    max_client_count: Option<i64>,
    max_camera_count: Option<i64>,
    max_constraint_count: Option<i64>,
    max_prior_count: Option<i64>,
}

impl From<&Loss> for v1::Loss {
    fn from(loss: &Loss) -> Self {
        Self { kind: loss.kind.to_wire(), width: loss.width }
    }
}

impl Loss {
    fn of_wire(loss: &v1::Loss) -> Option<Self> {
        Some(Self { kind: LossKind::of_wire(loss.kind)?, width: loss.width })
    }
}

impl Policy {
    /// The policy that a server answers.
    pub(super) fn of_wire(policy: &v1::MapPolicy) -> Self {
        let robustness = policy.loop_closure_robustness.and_then(|robustness| {
            let kernel = RobustKernel::of_wire(robustness.kernel)?;
            Some(ClosureRobustness { kernel, threshold: robustness.threshold })
        });
        Self {
            window_keyframe_count: policy.window_keyframe_count,
            min_shared_landmark_count: policy.min_shared_landmark_count,
            gauge: Gauge::of_wire(policy.gauge),
            local_bundle_adjustment: policy.local_bundle_adjustment,
            loop_closure_optimization: policy.loop_closure_optimization,
            max_iteration_count: policy.max_iteration_count,
            when_full: WhenFull::of_wire(policy.when_full),
            closure_adjustment: policy.closure_adjustment,
            odometry: policy.odometry,
            metric_odometry: policy.metric_odometry,
            observation_loss: policy.observation_loss.as_ref().and_then(Loss::of_wire),
            constraint_loss: policy.constraint_loss.as_ref().and_then(Loss::of_wire),
            loop_closure_robustness: robustness,
            geodetic_anchor: policy.geodetic_anchor.map(|place| GeodeticPosition {
                latitude_deg: place.latitude_deg,
                longitude_deg: place.longitude_deg,
                height_m: place.height_m,
            }),
            place_recognition: policy
                .place_recognition
                .map(|recognition| PlaceRecognition { enabled: recognition.enabled }),
            limits: policy.limits.map(|limits| Limits {
                max_keyframe_count: limits.max_keyframe_count,
                max_landmark_count: limits.max_landmark_count,
                max_observation_count: limits.max_observation_count,
                max_size_bytes: limits.max_size_bytes,
                max_queued_item_count: limits.max_queued_item_count,
                max_client_count: limits.max_client_count,
                max_camera_count: limits.max_camera_count,
                max_constraint_count: limits.max_constraint_count,
                max_prior_count: limits.max_prior_count,
            }),
        }
    }

    /// The message of the fields that are named.
    pub(super) fn to_wire(&self) -> v1::MapPolicy {
        v1::MapPolicy {
            window_keyframe_count: self.window_keyframe_count,
            min_shared_landmark_count: self.min_shared_landmark_count,
            gauge: self.gauge.map_or(0, Gauge::to_wire),
            local_bundle_adjustment: self.local_bundle_adjustment,
            loop_closure_optimization: self.loop_closure_optimization,
            max_iteration_count: self.max_iteration_count,
            when_full: self.when_full.map_or(0, WhenFull::to_wire),
            closure_adjustment: self.closure_adjustment,
            odometry: self.odometry,
            metric_odometry: self.metric_odometry,
            observation_loss: self.observation_loss.as_ref().map(v1::Loss::from),
            constraint_loss: self.constraint_loss.as_ref().map(v1::Loss::from),
            loop_closure_robustness: self.loop_closure_robustness.as_ref().map(|robustness| {
                let kernel = robustness.kernel.to_wire();
                v1::ClosureRobustness { kernel, threshold: robustness.threshold }
            }),
            geodetic_anchor: self.geodetic_anchor.as_ref().map(|place| v1::GeodeticPosition {
                latitude_deg: place.latitude_deg,
                longitude_deg: place.longitude_deg,
                height_m: place.height_m,
            }),
            place_recognition: self
                .place_recognition
                .as_ref()
                .map(|recognition| v1::PlaceRecognition { enabled: recognition.enabled }),
            limits: self.limits.as_ref().map(|limits| v1::MapLimits {
                max_keyframe_count: limits.max_keyframe_count,
                max_landmark_count: limits.max_landmark_count,
                max_observation_count: limits.max_observation_count,
                max_size_bytes: limits.max_size_bytes,
                max_queued_item_count: limits.max_queued_item_count,
                max_client_count: limits.max_client_count,
                max_camera_count: limits.max_camera_count,
                max_constraint_count: limits.max_constraint_count,
                max_prior_count: limits.max_prior_count,
            }),
        }
    }

    /// The text that [`PolicyFile::parse`] reads.
    ///
    /// # Errors
    /// A number that TOML cannot hold.
    pub(crate) fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

/// A policy as a file gives it.
#[derive(Debug)]
pub(crate) struct PolicyFile {
    path: PathBuf,
    /// What it gives.
    pub(crate) policy: Policy,
    /// The path of each field that it names, as in an update mask, and its line, from 1.
    pub(crate) named: Vec<(String, usize)>,
}

impl PolicyFile {
    /// Reads a file.
    ///
    /// # Errors
    /// As [`PolicyFile::parse`], and where the file cannot be read.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let text = fs::read_to_string(path).context("the policy")?;
        Ok(Self::parse(&text, path)?)
    }

    /// Reads a text; `path` names it in errors.
    ///
    /// # Errors
    /// [`ConfigError::File`] with the line: no TOML, a key that is no field of a policy, a value of another
    /// type.
    pub(crate) fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let policy = parse_toml(text, path)?;
        // It has been read once, so that it is TOML.
        let table = DeTable::parse(text).map(|table| table.into_inner()).unwrap_or_default();
        let mut named = Vec::new();
        for (key, value) in &table {
            let line = |span: std::ops::Range<usize>| line_of(text, span.start);
            if let DeValue::Table(inner) = value.get_ref()
                && IN_PARTS.contains(&&**key.get_ref())
            {
                let path = |part: &str| format!("policy.{}.{part}", key.get_ref());
                named.extend(inner.keys().map(|part| (path(part.get_ref()), line(part.span()))));
            } else {
                named.push((format!("policy.{}", key.get_ref()), line(key.span())));
            }
        }
        Ok(Self { path: path.to_owned(), policy, named })
    }

    /// The mask of an update that changes what the file names.
    pub(super) fn paths(&self) -> impl Iterator<Item = String> {
        self.named.iter().map(|(path, _)| path.clone())
    }

    /// The line of the field that a server has refused, as the context of its error.
    pub(super) fn blame(&self, error: anyhow::Error) -> anyhow::Error {
        let text = error.to_string();
        let at = self.named.iter().find(|(path, _)| text.contains(path.as_str()));
        match at {
            Some((_, line)) => error.context(format!("{}, line {line}", self.path.display())),
            None => error,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;
    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::*;

    fn parse(text: &str) -> Result<PolicyFile, ConfigError> {
        PolicyFile::parse(text, Path::new("policy.toml"))
    }

    /// A policy that has every field.
    fn full(count: i32, width: f64, is_on: bool) -> Policy {
        let limit = Some(i64::from(count));
        let loss = Loss { kind: LossKind::GemanMcclure, width: Some(width) };
        Policy {
            window_keyframe_count: Some(count),
            min_shared_landmark_count: Some(count),
            gauge: Some(Gauge::FixedPoses),
            local_bundle_adjustment: Some(is_on),
            loop_closure_optimization: Some(is_on),
            max_iteration_count: Some(count),
            when_full: Some(WhenFull::Sparsify),
            closure_adjustment: Some(is_on),
            odometry: Some(is_on),
            metric_odometry: Some(is_on),
            observation_loss: Some(loss.clone()),
            constraint_loss: Some(loss),
            loop_closure_robustness: Some(ClosureRobustness {
                kernel: RobustKernel::GncTls,
                threshold: Some(width),
            }),
            geodetic_anchor: Some(GeodeticPosition {
                latitude_deg: width,
                longitude_deg: -width,
                height_m: 0.0,
            }),
            place_recognition: Some(PlaceRecognition { enabled: Some(is_on) }),
            limits: Some(Limits {
                max_keyframe_count: limit,
                max_landmark_count: limit,
                max_observation_count: limit,
                max_size_bytes: Some(i64::MAX),
                max_queued_item_count: Some(count),
                max_client_count: limit,
                max_camera_count: limit,
                max_constraint_count: limit,
                max_prior_count: limit,
            }),
        }
    }

    #[test]
    fn every_field_of_a_policy_has_its_name_in_a_file() {
        let set = FileDescriptorSet::decode(v1::FILE_DESCRIPTOR_SET).unwrap();
        let messages: Vec<_> = set.file.iter().flat_map(|file| &file.message_type).collect();
        let fields = |name: &str| {
            let message = messages.iter().find(|message| message.name() == name).unwrap();
            message.field.iter().map(|field| field.name().to_owned()).collect::<Vec<_>>()
        };
        let mut paths: BTreeSet<String> = BTreeSet::new();
        for field in fields("MapPolicy") {
            match field.as_str() {
                "limits" => {
                    paths.extend(fields("MapLimits").iter().map(|f| format!("policy.limits.{f}")))
                }
                "place_recognition" => paths.extend(
                    fields("PlaceRecognition")
                        .iter()
                        .map(|f| format!("policy.place_recognition.{f}")),
                ),
                field => assert!(paths.insert(format!("policy.{field}"))),
            }
        }
        let file = parse(&full(7, 2.5, true).to_toml().unwrap()).unwrap();
        assert_eq!(file.paths().collect::<BTreeSet<_>>(), paths);
    }

    #[test]
    fn a_file_names_only_what_it_is_about() {
        let text = "# why\nodometry = false\n\n[limits]\nmax_keyframe_count = 10\n";
        let file = parse(text).unwrap();
        let named = [("policy.odometry", 2), ("policy.limits.max_keyframe_count", 5)];
        let named: BTreeSet<_> = named.map(|(path, line)| (path.to_owned(), line)).into();
        assert_eq!(file.named.into_iter().collect::<BTreeSet<_>>(), named);
        assert_eq!(parse("[limits]\n").unwrap().named, []);
    }

    #[test]
    fn what_is_no_policy_is_refused_with_its_name_and_line() {
        for (text, line, part) in [
            ("odometry = true\nodometri = true\n", 2, "odometri"),
            ("[limits]\nmax_keyframes = 3\n", 2, "max_keyframes"),
            ("\nwindow_keyframe_count = \"many\"\n", 2, "window_keyframe_count"),
            ("gauge = \"first\"\n", 1, "first-keyframe-fixed"),
            ("observation_loss = { kind = \"huber\", with = 2.0 }\n", 1, "with"),
            ("max_iteration_count = 1e3\n", 1, "max_iteration_count"),
            ("odometry = \n", 1, "odometry"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with(&format!("policy.toml, line {line}: ")), "{text}: {error}");
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn a_policy_is_the_same_after_it_was_written_and_read(
            count in any::<i32>(),
            width in proptest::num::f64::NORMAL,
            is_on in any::<bool>(),
        ) {
            let policy = full(count, width, is_on);
            let read = parse(&policy.to_toml().unwrap()).unwrap().policy;
            prop_assert_eq!(&read, &policy);
            prop_assert_eq!(Policy::of_wire(&policy.to_wire()), policy);
        }
    }
}
