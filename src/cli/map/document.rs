//! A map as `covis map` prints it: a row of a table, a page of details, or JSON.
//!
//! It only converts the server's answers; it asks nothing and prints nothing itself.

use serde::Serialize;

use crate::client::MapDigests;
use crate::wire::v1;

/// A map in `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    pub(super) map: String,
    display_name: String,
    pub(super) state: &'static str,
    /// Why it takes no changes.
    #[serde(skip_serializing_if = "String::is_empty")]
    state_reason: String,
    uid: String,
    revision: i64,
    cameras: i64,
    keyframes: i64,
    landmarks: i64,
    positioned_landmarks: i64,
    observations: i64,
    constraints: i64,
    switched_off_constraints: i64,
    size_bytes: i64,
    clients: Vec<ClientDocument>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    merged_maps: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pending: Option<PendingDocument>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    hints: Vec<HintDocument>,
    #[serde(skip_serializing_if = "Option::is_none")]
    landmark_bounds: Option<[[f64; 3]; 2]>,
    /// What `show` adds: SHA-256 in hex, as `GetMapResponse` describes them.
    #[serde(skip_serializing_if = "Option::is_none")]
    keyframe_ids_digest: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    state_hash: Option<String>,
}

#[derive(Debug, Serialize)]
struct ClientDocument {
    client: String,
    epoch: i64,
    next_sequence: i64,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<NoiseDocument>,
}

/// How uncertain what a client sends is.
#[derive(Debug, Serialize)]
struct NoiseDocument {
    odometry_translation_share: f64,
    odometry_rotation_rad: f64,
    pixel_factor: f64,
    depth_factor: f64,
    outlier_share: f64,
}

impl NoiseDocument {
    fn text(&self) -> String {
        let share = 100.0 * self.odometry_translation_share;
        let degrees = self.odometry_rotation_rad.to_degrees();
        let (pixels, depths) = (self.pixel_factor, self.depth_factor);
        let outliers = 100.0 * self.outlier_share;
        format!(
            "odometry {share:.2} % of the way and {degrees:.3}° a keyframe; \
             pixels {pixels:.2}, depths {depths:.2} of the stated sigmas; \
             {outliers:.1} % of the views do not fit"
        )
    }
}

/// What the server still does to the map by itself.
#[derive(Debug, Serialize)]
struct PendingDocument {
    unoptimized_items: i64,
    place_searches: i64,
    closure_adjustment: bool,
    optimization: bool,
}

/// A mistake that the data of a client look like.
#[derive(Debug, Serialize)]
struct HintDocument {
    hint: String,
    client: String,
    text: String,
}

impl From<v1::MapHint> for HintDocument {
    fn from(hint: v1::MapHint) -> Self {
        let name = hint.kind().as_str_name();
        let name = name.strip_prefix("MAP_HINT_KIND_").unwrap_or(name);
        Self { hint: name.to_lowercase(), client: hint.client_id, text: hint.text }
    }
}

impl PendingDocument {
    /// For people; `None` where nothing is pending.
    fn text(&self) -> Option<String> {
        let count = |count: i64, what: &str| (count > 0).then(|| format!("{count} {what}"));
        let flag = |is_set: bool, what: &str| is_set.then(|| what.to_owned());
        let parts = [
            count(self.unoptimized_items, "items to be optimized"),
            count(self.place_searches, "places to be searched"),
            flag(self.closure_adjustment, "an adjustment after closures"),
            flag(self.optimization, "a requested optimization"),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

impl Document {
    /// A map with its digests.
    pub(super) fn with_digests(map: v1::Map, digests: &MapDigests) -> Self {
        let keyframe_ids_digest = Some(hex(&digests.keyframe_ids_digest));
        let state_hash = Some(hex(&digests.state_hash));
        Self { keyframe_ids_digest, state_hash, ..Self::from(map) }
    }
}

impl From<v1::Map> for Document {
    fn from(map: v1::Map) -> Self {
        let counts = map.counts.unwrap_or_default();
        let state = match map.state() {
            v1::MapState::Open => "open",
            v1::MapState::Frozen => "frozen",
            v1::MapState::Poisoned => "poisoned",
            v1::MapState::Unspecified => "unknown",
        };
        let corner = |v: Option<v1::Vector3>| v.map(|v| [v.x, v.y, v.z]);
        let bounds = map.landmark_bounds;
        Self {
            map: map.map_id,
            display_name: map.display_name,
            state,
            state_reason: map.state_reason,
            uid: map.uid,
            revision: map.revision,
            cameras: counts.camera_count,
            keyframes: counts.keyframe_count,
            landmarks: counts.landmark_count,
            positioned_landmarks: counts.positioned_landmark_count,
            observations: counts.observation_count,
            constraints: counts.constraint_count,
            switched_off_constraints: counts.switched_off_constraint_count,
            size_bytes: counts.size_bytes,
            clients: map
                .clients
                .into_iter()
                .map(|c| ClientDocument {
                    client: c.client_id,
                    epoch: c.epoch,
                    next_sequence: c.next_sequence,
                    noise: c.noise.map(|noise| NoiseDocument {
                        odometry_translation_share: noise.odometry_translation_share,
                        odometry_rotation_rad: noise.odometry_rotation_rad,
                        pixel_factor: noise.pixel_factor,
                        depth_factor: noise.depth_factor,
                        outlier_share: noise.outlier_share,
                    }),
                })
                .collect(),
            merged_maps: map.merged_maps.into_iter().map(|merged| merged.map_id).collect(),
            pending: map.pending_work.map(|pending| PendingDocument {
                unoptimized_items: pending.unoptimized_item_count,
                place_searches: pending.place_search_count,
                closure_adjustment: pending.closure_adjustment,
                optimization: pending.optimization,
            }),
            hints: map.hints.into_iter().map(HintDocument::from).collect(),
            landmark_bounds: bounds.and_then(|b| Some([corner(b.min)?, corner(b.max)?])),
            keyframe_ids_digest: None,
            state_hash: None,
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(super) fn table(maps: &[Document]) -> String {
    if maps.is_empty() {
        return "no maps".to_owned();
    }
    let width = maps.iter().map(|m| m.map.len()).max().unwrap_or(0).max(3);
    let mut text = format!(
        "{:<width$}  {:>9}  {:>9}  {:>12}  {:>9}  {:>8}",
        "map", "keyframes", "landmarks", "observations", "revision", "state"
    );
    for m in maps {
        text.push_str(&format!(
            "\n{:<width$}  {:>9}  {:>9}  {:>12}  {:>9}  {:>8}",
            m.map, m.keyframes, m.landmarks, m.observations, m.revision, m.state
        ));
    }
    text
}

pub(super) fn details(map: &Document) -> String {
    let constraints = match map.switched_off_constraints {
        0 => map.constraints.to_string(),
        off => format!("{} ({off} found false)", map.constraints),
    };
    let state = match map.state_reason.as_str() {
        "" => map.state.to_owned(),
        reason => format!("{}: {reason}", map.state),
    };
    let mut rows = vec![
        ("map", map.map.clone()),
        ("state", state),
        ("revision", map.revision.to_string()),
        ("cameras", map.cameras.to_string()),
        ("keyframes", map.keyframes.to_string()),
        ("landmarks", format!("{} ({} with a position)", map.landmarks, map.positioned_landmarks)),
        ("observations", map.observations.to_string()),
        ("constraints", constraints),
        ("memory", format!("{} KiB", map.size_bytes.div_euclid(1024))),
    ];
    if let Some([min, max]) = map.landmark_bounds {
        let corner = |c: [f64; 3]| format!("({:.3}, {:.3}, {:.3})", c[0], c[1], c[2]);
        rows.push(("bounds (m)", format!("{} to {}", corner(min), corner(max))));
    }
    rows.extend(map.state_hash.clone().map(|hash| ("state hash", hash)));
    for c in &map.clients {
        let text = format!("{}, epoch {}, continues at {}", c.client, c.epoch, c.next_sequence);
        rows.push(("client", text));
        rows.extend(c.noise.as_ref().map(|noise| ("noise", noise.text())));
    }
    rows.extend(map.pending.as_ref().and_then(PendingDocument::text).map(|text| ("pending", text)));
    for hint in &map.hints {
        rows.push(("hint", format!("{} ({}): {}", hint.hint, hint.client, hint.text)));
    }
    if !map.merged_maps.is_empty() {
        rows.push(("merged maps", map.merged_maps.join(", ")));
    }
    let lines: Vec<String> =
        rows.into_iter().map(|(name, value)| format!("{name:<13} {value}")).collect();
    lines.join("\n")
}
